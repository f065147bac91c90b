"""Noise of rows by the scatter of samples, beside noise that is known."""

import numpy as np
import pytest

from crane_identification.diagnosis.evidence import Evidence, Run
from crane_identification.diagnosis.gap import scatter_of_periods, scatter_of_samples
from crane_identification.preparation.run import Preparation
from crane_model import Record, load_model
from crane_model.machine_files import machine_file

TIME = np.arange(0.0, 120.0, 0.005)
MOTION = 0.4 * np.sin(4.0 * np.pi * TIME)  # 2 Hz, as fast as a crane moves
NOISE = 25.0 * np.random.default_rng(5).standard_normal(len(TIME))  # N m


def evidence(force: np.ndarray, factor: int) -> Evidence:
    """Of joints with this force (samples,) each, which rest in the last quarter."""
    model = load_model(machine_file("model.yaml"))
    q, shown = (np.tile(x[:, np.newaxis], len(model.joints)) for x in (MOTION, force))
    gate = np.ones_like(q)
    gate[-len(q) // 4 :] = 0.0
    record = Record(model.joints, TIME, q, q, q, force=shown)
    run = Run("made up", 0, record, gate, factor)
    nothing = np.zeros((1, 1))
    return Evidence(
        model, (run,), nothing[0], nothing[0], nothing[0], nothing, nothing, nothing > 0
    )


@pytest.mark.parametrize("factor", [1, 8, 25])
def test_it_is_the_noise_that_rows_have(factor: int) -> None:
    """Oracle: rows of the noise alone."""
    seen = evidence(40e3 * MOTION + NOISE, factor)
    alone = evidence(NOISE, factor).runs[0]
    assert alone.record.force is not None
    rows = alone.filtered(alone.record.force[..., np.newaxis])[: len(alone.kept) // 2, 0, 0]
    assert scatter_of_samples(seen) == pytest.approx(rows.std(), rel=0.1)


def test_a_joint_at_rest_tells_nothing() -> None:
    """What its valve does to it then is no noise."""
    force = NOISE.copy()
    force[-len(TIME) // 4 + 2 :] *= 1000.0
    assert scatter_of_samples(evidence(force, 1)) == pytest.approx(25.0, rel=0.02)


def averaged(seed: int, *moves: bool) -> Preparation:
    """Three periods of noise of 1 of joints that move or not."""
    periods = np.random.default_rng(seed).standard_normal((3, 4000, len(moves))) * moves
    signed, q = np.tile(moves, (4000, 1)), periods[0]
    record = Record(tuple(f"joint {j}" for j in range(len(moves))), TIME[:4000], q, q, q)
    bandwidth = np.ones(len(moves))
    return Preparation("made up", record, 0.005, signed, signed, bandwidth, None, periods, None)


def test_the_scatter_of_a_joint_that_stands_is_not_known() -> None:
    """It is 0, which says nothing of its noise while it moves."""
    found = scatter_of_periods([averaged(1, True, False)], 1, 2)
    assert found[0] == pytest.approx(1.0, rel=0.05)
    assert np.isnan(found[1])


def test_the_scatter_of_a_joint_is_that_of_recordings_in_which_it_moves() -> None:
    found = scatter_of_periods([averaged(1, True, False), averaged(2, True, True)], 1, 2)
    assert found == pytest.approx([1.0, 1.0], rel=0.05)
