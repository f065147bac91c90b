"""What is in the way of an experiment, as joint states come and grow old."""

import numpy as np
import pytest

from crane_model import load_machine
from crane_model.machine_files import machine_file
from crane_trajectory.control.controller import Tuning, load_gains
from crane_trajectory.experiment import REST_TIME_S, Readiness

JOINTS = load_machine().joint_names
TUNING = Tuning(load_gains(machine_file("controller.yaml"), load_machine()).arrays, 1.0, np.ones(4))
UNITS = load_machine().units
TIMEOUT = 0.1  # s
PLACE, REST = np.zeros(len(JOINTS)), np.zeros(len(JOINTS))
MOVING = np.array([0.0, 0.0, 0.0, 1.0])
NOW = 50.0  # s


@pytest.fixture
def ready() -> Readiness:
    """Nothing is in the way at NOW."""
    readiness = Readiness()
    readiness.sample(PLACE, REST, TUNING, NOW - 2 * REST_TIME_S)
    readiness.sample(PLACE, REST, TUNING, NOW)
    assert readiness.lacking(TIMEOUT, NOW) == ""
    return readiness


def test_nothing_is_known_at_first() -> None:
    assert Readiness().lacking(TIMEOUT, NOW).startswith("no joint states arrive")


def test_joint_states_that_stop_or_are_forgotten(ready: Readiness) -> None:
    assert ready.lacking(TIMEOUT, NOW + 2 * TIMEOUT).startswith("no joint states arrive")
    ready.forget_states()
    assert ready.lacking(TIMEOUT, NOW).startswith("no joint states arrive")


@pytest.mark.parametrize("velocity", [MOVING, MOVING * np.nan], ids=["moving", "unknown"])
def test_a_crane_must_have_rested(velocity: np.ndarray, ready: Readiness) -> None:
    ready.sample(PLACE, velocity, TUNING, NOW)
    ready.sample(PLACE, REST, TUNING, NOW + 0.1)
    assert ready.lacking(TIMEOUT, NOW + 0.1).startswith("the crane is not at rest")
    ready.sample(PLACE, REST, TUNING, NOW + 0.1 + REST_TIME_S)
    assert ready.lacking(TIMEOUT, NOW + 0.1 + REST_TIME_S) == ""


def test_noise_of_the_sensors_is_no_motion_but_a_slow_joint_is() -> None:
    """Inertial sensors of field machines: rates at rest scatter by twice the standstill speed."""
    standstill = TUNING.gains.standstill_speed
    noise = np.random.default_rng(3).normal(size=(50, len(JOINTS)))
    for drift, rests in ((0.0, True), (2.0, False)):
        readiness = Readiness()
        for k, scatter in enumerate(noise):
            velocity = standstill * (drift + 2.0 * (scatter - noise.mean(axis=0)))
            readiness.sample(PLACE, velocity, TUNING, NOW + 0.02 * k)
        assert (readiness.lacking(TIMEOUT, NOW + 0.98) == "") is rests


def test_a_crane_that_was_moved_is_not_where_its_motion_starts(ready: Readiness) -> None:
    ready.sample(PLACE + 0.4 * TUNING.tolerance, REST, TUNING, NOW)
    assert not ready.moved_from(PLACE, TUNING, UNITS)
    ready.sample(PLACE - 0.6 * MOVING * TUNING.tolerance, REST, TUNING, NOW)
    assert ready.moved_from(PLACE, TUNING, UNITS) == (
        "telescope: moved by 0.6 m while its motion was planned, half the tolerance is 0.5 m"
    )
