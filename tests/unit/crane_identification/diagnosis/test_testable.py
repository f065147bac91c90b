"""Which candidates can be tested at all."""

from pathlib import Path

import numpy as np
import pytest

from crane_identification.diagnosis.candidates import Candidate, ShapedCandidate, at_shape
from crane_identification.diagnosis.constants import VISIBLE_SHARE
from crane_identification.diagnosis.evidence import Evidence, Run
from crane_identification.diagnosis.projection import project, whitened_base, whitener
from crane_identification.diagnosis.visibility import visible
from crane_model import Model, Record, load_model
from crane_model.terms import REGISTRY
from crane_model.terms.force_scale import PressureGain
from crane_model.terms.friction import QuadraticViscous
from crane_model.terms.single_axis import Inertia
from crane_model.terms.term import Setting

N = 400


def test_a_gain_of_the_measured_force_is_not_tested(tmp_path: Path) -> None:
    """Also where another joint lacks something and the joints share a parameter of the base."""
    (tmp_path / "two.yaml").write_text(
        "name: two axes\njoints: {one: m, other: m}\n"
        "terms:\n  - {type: inertia, joint: one}\n  - {type: inertia, joint: other}\n"
    )
    rng = np.random.default_rng(3)
    base = np.zeros((N, 4, 3))
    base[:, 0, 0], base[:, 1, 1] = rng.standard_normal((2, N))
    base[:, :2, 2] = rng.standard_normal((N, 2))
    law = rng.standard_normal((N, 2))
    force = np.zeros((N, 4))
    force[:, :2] = base[:, :2] @ [5.0, 3.0, 2.0] + law + 0.1 * rng.standard_normal((N, 2))
    used = np.zeros((N, 4), dtype=bool)
    used[:, :2] = True
    zeros = np.zeros(N, dtype=int)
    model = load_model(tmp_path / "two.yaml")
    evidence = Evidence(model, (), np.arange(N) * 0.1, zeros, zeros, force, base, used)

    def shaped(candidate: Candidate, column: np.ndarray) -> ShapedCandidate:
        columns = np.zeros((N, 4, 1))
        columns[:, 0, 0] = column
        return ShapedCandidate(candidate, {}, candidate.at({}), columns, np.array([False]))

    gain, loss = Candidate(PressureGain, "one"), Candidate(QuadraticViscous, "one")
    candidates = [shaped(gain, force[:, 0]), shaped(loss, law[:, 0] + rng.standard_normal(N))]
    white = whitener(evidence, np.concatenate([one.columns for one in candidates], axis=2))
    made = project(white, whitened_base(evidence, white), candidates)
    wanted, reasons = visible(made, evidence, white)
    assert wanted.tolist() == [False, True]
    assert reasons == {gain: "its column is the measured force itself"}


@pytest.mark.parametrize(("friction", "tested"), [(0.2, True), (8.0, False)])
def test_friction_of_a_load_that_is_friction_itself_is_not_tested(
    friction: float, tested: bool
) -> None:
    """|tau| sgn(v) of a force that is mostly friction, which the model lacks, is that force."""
    rng = np.random.default_rng(4)
    time, setting = 0.1 * np.arange(N), Setting({"one": "m"}, None)
    velocity = np.sin(time) + 0.5 * np.sin(2.3 * time)
    acceleration = 5.0 * rng.standard_normal(N)
    force = 2.0 * acceleration + friction * np.sign(velocity) * (1.0 + 0.3 * rng.random(N))
    force += 0.1 * rng.standard_normal(N)
    motion = [values[:, np.newaxis] for values in (np.zeros(N), velocity, acceleration)]
    record = Record(("one",), time, *motion, force=force[:, np.newaxis])
    run = Run("bag", 0, record, np.repeat([[1.0, 0.0]], N, axis=0), 1)
    zeros, nothing = np.zeros(N, dtype=int), np.zeros(N)
    evidence = Evidence(
        model=Model("axis", setting, (Inertia(joint="one"),)),
        runs=(run,),
        time=time,
        run=zeros,
        bag=zeros,
        force=np.stack([force, nothing], axis=1),
        base=np.stack([acceleration, nothing], axis=1)[:, :, np.newaxis],
        used=np.repeat([[True, False]], N, axis=0),
    )
    (one,) = [at_shape(evidence, Candidate(REGISTRY["load_friction"], "one"), {})]
    white = whitener(evidence, one.columns)
    wanted, reasons = visible(
        project(white, whitened_base(evidence, white), [one]), evidence, white
    )
    assert wanted.tolist() == [tested]
    assert tested or "force itself" in reasons[one.candidate]


def test_friction_with_memory_is_as_visible_as_close_to_reversals(tmp_path: Path) -> None:
    """Elsewhere it is Coulomb's, which the model has."""
    (tmp_path / "one.yaml").write_text(
        "name: an axis\njoints: {one: m}\nterms:\n  - {type: coulomb, joint: one}\n"
    )
    rng = np.random.default_rng(4)
    base = np.zeros((N, 2, 1))
    base[:, :, 0] = np.sign(rng.standard_normal((N, 2)))
    base[:, 1] *= 0.01  # few samples are close to reversals
    memory = base.copy()
    memory[:, 1, 0] *= 0.3 + 0.7 * (rng.random(N) < 0.5)
    force = base[:, :, 0] + 0.1 * rng.standard_normal((N, 2))
    zeros, used = np.zeros(N, dtype=int), np.ones((N, 2), dtype=bool)
    model = load_model(tmp_path / "one.yaml")
    evidence = Evidence(model, (), np.arange(N) * 0.1, zeros, zeros, force, base, used)
    candidate = Candidate(QuadraticViscous, "one")
    shaped = ShapedCandidate(candidate, {}, candidate.at({}), memory, np.array([False]))
    white = whitener(evidence, memory)
    found = project(white, whitened_base(evidence, white), [shaped])
    overall = float(found.scale[0] / np.linalg.norm(white(memory)))
    assert overall < VISIBLE_SHARE
    assert found.visibility[0] > 0.2
