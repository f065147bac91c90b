"""A shape over the measured force of a joint may be that force itself, of any machine."""

from dataclasses import replace

import numpy as np
import pytest
from unit.crane_identification.synthetic import crane_log, crane_model

from crane_identification import Options
from crane_identification.diagnosis.candidates import Candidate
from crane_identification.diagnosis.evidence import Evidence, gather
from crane_identification.diagnosis.search import Shapes
from crane_identification.preparation.prepare import prepare
from crane_model.terms import REGISTRY

FACTOR = 20
SEEDS = range(4)  # of recordings


@pytest.fixture(scope="module")
def evidence() -> Evidence:
    model = crane_model()
    recordings = [
        one
        for seed in SEEDS
        for one in prepare(
            model, replace(crane_log(seed, 1), source=str(seed)), Options(average=False)
        )
    ]
    return gather(model, recordings, FACTOR)


@pytest.mark.parametrize(("kind", "drawn"), [("load_friction", False), ("stribeck", True)])
def test_no_shape_is_drawn_over_a_load_that_pulls_one_way(
    evidence: Evidence, kind: str, drawn: bool
) -> None:
    """Less a constant, it is the force; one over the speed is not."""
    force = np.concatenate([run.record.force for run in evidence.runs])[:, 0]
    assert (force > 0.0).all()
    found = Shapes(evidence).of(Candidate(REGISTRY[kind], "inner_boom"))
    assert (found is not None) is drawn


def test_a_shape_is_drawn_over_a_load_that_pulls_both_ways(evidence: Evidence) -> None:
    """As is that of an outer boom that goes through the vertical."""
    force = np.concatenate([run.record.force for run in evidence.runs])[:, 1]
    assert (force < 0.0).mean() > 0.05
    assert Shapes(evidence).of(Candidate(REGISTRY["load_friction"], "outer_boom")) is not None
