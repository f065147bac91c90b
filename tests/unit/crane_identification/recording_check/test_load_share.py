"""Steps of what a model leaves, of one mass or of one joint, that are known."""

import numpy as np
import pytest

from crane_identification.recording_check.loads import Leftover

CHANGE, END = 20.0, np.inf
MASS = 30.0  # kg
TIME = np.arange(0.0, 40.0, 0.25)
PULL = np.array([4.0, 2.0, 1.0]) * 1e-3 * (1.0 + 0.3 * np.sin(TIME))[:, np.newaxis]


def of(*mass: float) -> Leftover:
    """What steps by these masses [kg], joint by joint, beside a force that stays."""
    stays = np.array([5.0, -12.0, 40.0])
    step = np.array(mass) * (TIME >= CHANGE)[:, np.newaxis]
    return Leftover(TIME, PULL * (stays + step), PULL)


def likeness(leftover: Leftover, weighed: float = MASS) -> float:
    return leftover.likeness(-np.inf, CHANGE, END, weighed)


def test_a_load_pulls_at_all_joints() -> None:
    # Weighed right, all is explained: (16 + 4 + 1) / 16 of the first joint's own.
    assert likeness(of(MASS, MASS, MASS)) == pytest.approx(21.0 / 16.0, rel=0.01)
    assert likeness(of(-MASS, -MASS, -MASS), -MASS) == pytest.approx(21.0 / 16.0, rel=0.01)


@pytest.mark.parametrize("joint", range(3))
def test_a_force_of_one_joint_is_no_load_though_it_explains_all(joint: int) -> None:
    mass = np.where(np.arange(3) == joint, MASS, 0.0)
    assert likeness(of(*mass)) < 0.8
    assert likeness(of(*mass), weighed=1.0) < 0.8
    narrow = np.where(np.arange(3) == joint, 1.0, 0.05)  # the others hardly pull
    left = Leftover(TIME, narrow * PULL * mass * (TIME >= CHANGE)[:, np.newaxis], narrow * PULL)
    assert left.load_share([CHANGE]) > 0.9
    assert likeness(left) < 1.0


def test_a_load_is_not_lost_to_a_force_of_one_joint_as_long_as_others_follow_half_its_step() -> (
    None
):
    assert likeness(of(MASS, 0.6 * MASS, 0.6 * MASS)) > 1.0
    assert likeness(of(MASS, 0.4 * MASS, 0.4 * MASS)) < 1.0


@pytest.mark.parametrize(("weighed", "there"), [(1.9, True), (2.1, False), (-1.0, False)])
def test_what_the_scale_weighed_is_left(weighed: float, there: bool) -> None:
    assert (likeness(of(MASS, MASS, MASS), weighed * MASS) >= 1.0) is there


def test_joints_that_stand_tell_nothing() -> None:
    on_first = np.array([1.0, 0.0, 0.0])
    step = MASS * (TIME >= CHANGE)[:, np.newaxis]
    assert likeness(Leftover(TIME, on_first * PULL * step, on_first * PULL)) == pytest.approx(1.0)
    assert likeness(Leftover(TIME, 0.0 * PULL * step, 0.0 * PULL)) == 0.0
    before = TIME < CHANGE
    assert likeness(Leftover(TIME[before], PULL[before], PULL[before])) == 0.0


@pytest.mark.parametrize("change", [1.7, CHANGE])
def test_no_changes_explain_more_than_the_largest_share(change: float) -> None:
    """Which decides whether a recording is weighed at all."""
    rng = np.random.default_rng(5)
    stays = np.where(change <= TIME, 1.0, -0.4)[:, np.newaxis]
    noise = rng.normal(size=PULL.shape) * np.abs(PULL).max()
    for left in (PULL * stays, PULL * stays + noise, noise):
        leftover = Leftover(TIME, left, PULL)
        most = leftover.largest_share()
        assert leftover.load_share([change]) <= most + 1e-12
        assert leftover.load_share([change, change + 3.0]) <= most + 1e-12
    assert Leftover(TIME, PULL * stays, PULL).largest_share() == pytest.approx(1.0)
    assert Leftover(TIME, noise, PULL).largest_share() < 0.5
