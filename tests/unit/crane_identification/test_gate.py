import numpy as np

from crane_identification.preparation.run import SETTLING_S, moving, velocity_resolution
from crane_identification.signals.motion import SmoothedMotion

STEP = 0.01
BANDWIDTH = 5.0
GUARD = 20 + round(SETTLING_S / STEP)  # samples: one cycle of 5 Hz at 100 Hz, and the settling


def motion(velocity: np.ndarray, noise: float = 0.01) -> SmoothedMotion:
    columns = velocity.reshape(len(velocity), -1)
    joints = columns.shape[1]
    zero = np.zeros_like(columns)
    return SmoothedMotion(
        zero, columns, zero, np.full(joints, BANDWIDTH), np.zeros(joints), np.full(joints, noise)
    )


def test_reversal_and_its_surroundings_are_left_out() -> None:
    velocity = np.where(np.arange(200) < 100, 1.0, -1.0)  # between samples 99 and 100
    expected = np.ones(200, dtype=bool)
    expected[99 - GUARD : 100 + GUARD + 1] = False
    np.testing.assert_array_equal(moving(motion(velocity), STEP, periodic=False)[:, 0], expected)


def test_standstill_is_left_out_while_it_lasts() -> None:
    velocity = np.ones(300)
    velocity[100:150] = 0.02  # below three standard deviations
    expected = np.ones(300, dtype=bool)
    expected[100 - GUARD : 150 + GUARD] = False
    np.testing.assert_array_equal(moving(motion(velocity), STEP, periodic=False)[:, 0], expected)
    assert velocity_resolution(motion(velocity)) > 0.02


def test_each_joint_has_its_own_reversals() -> None:
    time = STEP * np.arange(400)
    velocity = np.stack([np.sin(2 * np.pi * time / 4), np.full(400, 0.5)], axis=1)
    known = moving(motion(velocity), STEP, periodic=True)
    assert known[:, 1].all()
    assert 0 < known[:, 0].sum() < 400


def test_a_period_continues_over_its_ends() -> None:
    """Started anywhere, the same instants of the period are left out."""
    velocity = np.sin(2 * np.pi * np.arange(400) / 400)
    known = moving(motion(velocity), STEP, periodic=True)
    shifted = moving(motion(np.roll(velocity, 150)), STEP, periodic=True)
    np.testing.assert_array_equal(np.roll(known, 150, axis=0), shifted)
    assert not known[0, 0]
    assert not known[-1, 0]


def test_a_joint_that_stands_still_is_never_known() -> None:
    assert not moving(motion(np.zeros(100)), STEP, periodic=False).any()
