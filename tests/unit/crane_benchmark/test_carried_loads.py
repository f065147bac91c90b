"""The share of the gap that is closed counts each held-out recording with its own load."""

import numpy as np

from crane_benchmark.scores.score_cases import carrying
from crane_model import load_model
from crane_model.machine_files import machine_file
from crane_model.terms.gravity_and_load import Payload
from crane_model.terms.term import Load


def test_loads_are_those_of_the_held_out_recordings():
    trained = load_model(machine_file("model.yaml")).with_term(
        Payload(loads=(Load(runs=(0, 2)), Load(runs=(1,))))
    )
    count = len(trained.parameters)
    model = trained.with_estimate(np.arange(float(count)), np.ones(count), "made")
    changed = carrying(model, {1: 30.0, 0: 20.0})
    (term,) = (term for term in changed.terms if isinstance(term, Payload))
    assert term.loads == (Load(runs=(1,)), Load(runs=(0,)))
    assert changed.theta[changed.part(term)].tolist() == [30.0, 20.0]
    assert changed.theta[: count - 2].tolist() == list(range(count - 2))
    assert carrying(load_model(machine_file("model.yaml")), {}).terms
