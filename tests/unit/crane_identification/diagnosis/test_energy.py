"""What candidates explain and leave, on columns made up for the purpose with known answers."""

from dataclasses import replace

import numpy as np
import pytest
from unit.crane_identification.diagnosis.made import MASS, ROWS, normal, searched

from crane_identification.diagnosis.candidates import Candidate
from crane_identification.diagnosis.projection import NOTHING, solve
from crane_identification.diagnosis.search import Search
from crane_identification.estimation.autoregression import Autoregression
from crane_identification.thresholds import load_thresholds
from crane_model.terms import REGISTRY

A, B = np.linalg.qr(np.random.default_rng(1).standard_normal((ROWS, 2)))[0].T * np.sqrt(ROWS)
SIZE = 2.0  # of the effect, in units of the noise
BOTH = {"offset": A, "hose_stiffness": B}


def test_what_is_missing_is_left_until_a_set_explains_it() -> None:
    found = searched(BOTH, SIZE * A)
    energy = SIZE**2 * ROWS
    right, wrong = solve(found.projection, (0,)), solve(found.projection, (1,))
    assert right is not None and wrong is not None
    tolerance = 0.05 * energy
    assert found.unexplained(NOTHING) == pytest.approx([energy, 0.0], abs=tolerance)
    assert found.unexplained(right) == pytest.approx([0.0, 0.0], abs=tolerance)
    assert found.unexplained_beside(wrong, 0) == pytest.approx(energy, abs=tolerance)
    assert found.unexplained_beside(right, 0) >= 0.0  # less than noise is nothing


@pytest.mark.parametrize(
    ("kinds", "expected"), [((0,), 0.8), ((1,), 0.2), ((0, 1), 0.0), ((), 0.0)]
)
def test_the_share_that_is_left_is_what_the_others_have(kinds, expected: float) -> None:
    found = searched(BOTH, SIZE * (0.5 * A + B))
    wanted = [found.projection.candidates[kind] for kind in kinds]
    assert found.left_share(wanted) == pytest.approx(expected, abs=0.05)


def test_strength_is_the_rms_of_an_effect_over_that_of_the_force() -> None:
    found = searched({"offset": A}, SIZE * A)
    solved = solve(found.projection, (0,))
    assert solved is not None
    force = np.sqrt(MASS**2 + SIZE**2 + 1.0)
    assert found.strength(0, solved.gain) == pytest.approx(SIZE / force, rel=0.1)
    columns = found.projection.candidates[0].columns
    assert found.evidence.acting(columns, np.array([SIZE])) == pytest.approx(SIZE / force, rel=0.1)


def test_strength_counts_the_same_rows_of_effect_and_force() -> None:
    """Those of both zones, in which the joint slides; the force is smaller close to reversals."""
    found = searched({"offset": A}, SIZE * A)
    force = np.stack([10.0 * A, 2.0 * B], axis=1)
    both = replace(found.evidence, force=force, used=np.ones((ROWS, 2), dtype=bool))
    noise = Autoregression(np.ones(1), 1.0)
    search = replace(found, evidence=both, whitener=replace(found.whitener, noise=(noise, noise)))
    columns = np.stack([A, 0.5 * A], axis=1)[:, :, np.newaxis]
    expected = both.acting(columns, np.array([SIZE]))
    energy = (SIZE * columns[:, :, 0]) ** 2
    assert search.strengths(energy.sum(axis=0))[0] == pytest.approx(expected)


def test_detectable_is_the_strength_that_reaches_the_threshold() -> None:
    """A score of a tenth of the rows is that of an effect with a tenth of the power of noise."""
    found = searched(BOTH, np.zeros(ROWS))
    expected = np.sqrt(0.1) / np.sqrt(MASS**2 + 1.0)
    assert found.detectable(0.1 * ROWS) == pytest.approx(expected, rel=0.1)
    assert found.detectable(0.4 * ROWS) == pytest.approx(2.0 * found.detectable(0.1 * ROWS))


def named_from(made: Search, threshold: float, gate: float) -> float:
    thresholds = load_thresholds()
    gates = thresholds.gates.model_copy(update={"smallest_strength": gate})
    gated = replace(made, thresholds=thresholds.model_copy(update={"gates": gates}))
    return gated.named_from(threshold)["axis"]


def test_an_effect_is_named_from_what_noise_and_gate_permit_of_itself() -> None:
    """Half of the norm of a column is beside the model, and the filter of the rows halves it."""
    base = normal(99) / np.linalg.norm(normal(99))
    half = np.sqrt(ROWS) * base + (A - base * (base @ A)) / np.sqrt(1.0 - (base @ A) ** 2 / ROWS)
    found = searched({"offset": half}, np.zeros(ROWS))
    (one,) = found.projection.candidates
    damped = replace(found, projection=replace(found.projection, candidates=(
        replace(one, damped=0.5),
    )))  # fmt: skip
    visible, force = found.projection.visibility[0], np.sqrt(MASS**2 + 1.0)
    by_noise = np.sqrt(0.1) / visible / force
    assert named_from(found, 0.1 * ROWS, 0.0) == pytest.approx(by_noise, rel=0.1)
    assert named_from(found, 0.1 * ROWS, 0.2) == pytest.approx(0.2 / visible, rel=0.1)
    assert named_from(damped, 0.1 * ROWS, 0.2) == pytest.approx(0.4 / visible, rel=0.1)


def test_what_is_usual_of_an_effect_is_never_named() -> None:
    found = searched({"chamber_gain": A}, np.zeros(ROWS), mass=0.0)
    usual = REGISTRY["chamber_gain"].effect.usual
    assert named_from(found, 1e-9, 0.0) == pytest.approx(usual, rel=0.1)


def test_a_residual_counts_in_units_of_its_noise() -> None:
    found = searched({"offset": A}, np.zeros(ROWS))
    left = np.stack([3.0 * B, B], axis=1)  # of the second channel, no row is used
    assert found.normalized_energy(left) == pytest.approx([9.0 * ROWS, 0.0], rel=0.1)


def test_what_hides_behind_the_model_does_not_show() -> None:
    found = searched(BOTH, np.zeros(ROWS))
    assert found.testable_share == 1.0
    found.untestable[Candidate(REGISTRY["load_friction"], "axis")] = "it hides"
    assert found.testable_share == pytest.approx(2 / 3)
