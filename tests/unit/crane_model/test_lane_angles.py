"""Cosine and sine of a block of samples beside those of the C library."""

from pathlib import Path

import numpy as np
import pytest

from crane_model import load_machine
from crane_model.chain.body_regressor import (
    COS,
    FAR_ANGLE_RAD,
    LANES,
    MOVED,
    SIN,
    regressor,
    set_near_turn,
    set_turn,
)

KUKA = Path(__file__).parents[2] / "machines" / "kuka_kr300.yaml"
ROWS = MOVED + 1
EDGES = np.pi / 4 * np.arange(-12, 13)


def turned(by, angles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """cos and sin, LANES at a time."""
    found = []
    for some in angles.reshape(-1, LANES):
        workspace = np.zeros(ROWS * LANES)
        workspace[MOVED * LANES :] = some
        by(workspace)
        rows = workspace.reshape(ROWS, LANES)
        assert np.all(rows[MOVED] == 0.0)
        found.append((rows[COS], rows[SIN]))
    cos, sin = np.concatenate(found, axis=1)
    return cos, sin


@pytest.mark.parametrize("by", [set_near_turn, set_turn])
@pytest.mark.parametrize("reach", [1e-9, 1.0, 10.0, 1e3, 0.999 * FAR_ANGLE_RAD])
def test_both_are_those_of_the_library(by, reach: float) -> None:
    angles = np.random.default_rng(1).uniform(-reach, reach, 8000)
    cos, sin = turned(by, angles)
    assert np.max(np.abs(cos - np.cos(angles))) < 3e-16
    assert np.max(np.abs(sin - np.sin(angles))) < 3e-16


def test_where_quarter_turns_begin() -> None:
    for nudge in (0.0, 1e-16, -1e-16, 1e-9):
        angles = np.resize(EDGES, 32) * (1.0 + nudge)
        cos, sin = turned(set_near_turn, angles)
        np.testing.assert_allclose(cos, np.cos(angles), rtol=0.0, atol=3e-16)
        np.testing.assert_allclose(sin, np.sin(angles), rtol=0.0, atol=3e-16)


@pytest.mark.parametrize("far", [FAR_ANGLE_RAD, -1e9, np.nan, np.inf])
def test_an_angle_that_is_far_or_no_number_leaves_other_samples_alone(far: float) -> None:
    machine = load_machine(KUKA)
    q, v, a = np.random.default_rng(2).standard_normal((3, 11, len(machine.joints)))
    expected = regressor(machine.chain, q, v, a)
    q[5, 1] = far
    found = regressor(machine.chain, q, v, a)
    np.testing.assert_allclose(np.delete(found, 5, 0), np.delete(expected, 5, 0), atol=1e-12)
    if np.isfinite(far):
        q[5, 1] = np.arctan2(np.sin(far), np.cos(far))
        np.testing.assert_allclose(found[5], regressor(machine.chain, q, v, a)[5], atol=1e-10)
    else:
        assert np.isnan(found[5]).any()
