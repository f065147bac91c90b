"""An experiment leads to rest whatever happens, and its commands begin and end at neutral."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from crane_interfaces.action import RunExcitation
from crane_model import load_machine
from crane_model.machine_files import machine_file
from crane_trajectory import Experiment, FourierTrajectory, Motion, Outcome, load_clearance, plan
from crane_trajectory.control.controller import (
    BLEND,
    ControlCondition,
    PdDeadBand,
    SensorReading,
    Tuning,
    Wanted,
    load_gains,
)
from crane_trajectory.experiment import RELEASE_TIME_S, PeriodicError, Stage
from crane_trajectory.motion.motion import BRAKE_TIME, LONGEST_STEP, Phase
from crane_trajectory.motion.periodic import JointSeries

JOINTS = load_machine().joint_names
PERIOD = 0.01  # s
TIMEOUT = 0.06  # s
START = np.array([0.2, 0.35, -1.5, 0.4])
TRAJECTORY = FourierTrajectory(
    name="short",
    period=5.0,
    joints={
        "inner_boom": JointSeries(offset=0.35, sine=(0.06,), cosine=(0.02,)),
        "outer_boom": JointSeries(offset=-1.5, sine=(0.0, 0.06), cosine=(0.1, 0.0)),
        "telescope": JointSeries(offset=0.4, sine=(0.1,), cosine=(0.05,)),
    },
)
MOTION = plan(
    load_machine(None), TRAJECTORY, START, 1, load_clearance(machine_file("clearance.yaml"))
)
TUNING = Tuning(
    load_gains(machine_file("controller.yaml"), load_machine()).arrays, 1.0, np.full(4, 0.2)
)


class Crane:
    """A crane that follows its commands as slow integrators, and an experiment with it."""

    def __init__(self, motion: Motion = MOTION) -> None:
        self.now = 100.0
        self.q, self.v = motion.start.copy(), np.zeros(4)
        self.experiment = Experiment(motion, TUNING, TIMEOUT, self.now)
        self.commands: list[np.ndarray] = []
        self.path: list[np.ndarray] = []

    def cycle(self) -> None:
        """The valve opens beyond its dead band; the joint moves with 1 rad/s or m/s at most."""
        self.now += PERIOD
        u = self.experiment.sample(self.now, self.q, self.v, self.now)
        if u is not None:
            self.commands.append(u.copy())
            self.v = np.sign(u) * np.maximum(np.abs(u) - 0.05, 0.0)
        self.q = self.q + PERIOD * self.v
        if self.experiment.target is not None:
            self.path.append(self.experiment.target.position)

    def silence(self) -> None:
        """A cycle without a joint state."""
        self.now += PERIOD
        u = self.experiment.watch(self.now)
        if u is not None:
            self.commands.append(u.copy())

    def until(self, seconds: float) -> "Crane":
        while self.experiment.elapsed < seconds:
            self.cycle()
        return self

    def to_the_end(self) -> "Crane":
        for _ in range(round(MOTION.duration / PERIOD) + 2000):
            if self.experiment.over:
                return self
            self.cycle()
        raise AssertionError("not over")


def ends_well(crane: Crane) -> None:
    """The crane is at rest, and the last commands are exactly neutral."""
    assert np.abs(crane.v).max() < 0.02
    assert not np.any(crane.commands[-15:])
    assert np.abs(crane.commands[0]).max() == 0.0
    before = crane.q.copy()
    for _ in range(100):
        crane.cycle()
    np.testing.assert_array_equal(crane.q, before)  # holds still, and no more commands


def test_numbers_are_those_of_the_action() -> None:
    for outcome in Outcome:
        assert getattr(RunExcitation.Result, outcome.name) == outcome
    for phase in (Phase.APPROACH, Phase.EXCITATION, Phase.STOP):
        assert getattr(RunExcitation.Feedback, phase.name) == phase


def test_a_whole_experiment_is_completed_at_rest() -> None:
    crane = Crane().to_the_end()
    assert crane.experiment.outcome is Outcome.COMPLETED
    assert (crane.experiment.rms[1:] > 1e-4).all()
    assert (crane.experiment.rms < 0.1).all()
    assert crane.q[0] == pytest.approx(START[0], abs=1e-6)  # slew is held
    np.testing.assert_allclose(crane.q, MOTION.reference(np.array([1e3])).position[0], atol=0.01)
    ends_well(crane)


@settings(max_examples=5)
@given(st.floats(0.0, MOTION.duration - 0.1))
def test_canceled_at_any_time_it_stops_on_its_path_smoothly(seconds: float) -> None:
    crane = Crane().until(seconds)
    crane.experiment.stop(Outcome.CANCELED, "canceled")
    crane.to_the_end()
    assert crane.experiment.outcome is Outcome.CANCELED
    ends_well(crane)
    assert crane.experiment.elapsed <= seconds + BRAKE_TIME / 2 + 2 * PERIOD
    fastest = np.abs(MOTION.reference(np.linspace(0, MOTION.duration, 2000)).velocity).max(axis=0)
    for before, after in pairwise(crane.path):  # never faster than the motion that was checked
        assert (np.abs(after - before) <= fastest * PERIOD * 1.01 + 1e-9).all()


def test_the_braking_reference_is_consistent() -> None:
    """Its velocity and acceleration are the derivatives of its position."""
    crane = Crane().until(MOTION.excitation_start + 1.0)
    crane.experiment.stop(Outcome.CANCELED, "canceled")
    targets = []
    while crane.experiment.stage is Stage.BRAKING:
        crane.cycle()
        targets.append(crane.experiment.target)
    position, velocity, acceleration = (
        np.array([getattr(target, name) for target in targets])
        for name in ("position", "velocity", "acceleration")
    )
    central = (position[2:] - position[:-2]) / (2 * PERIOD)
    np.testing.assert_allclose(central, velocity[1:-1], atol=1e-3)
    central = (velocity[2:] - velocity[:-2]) / (2 * PERIOD)
    np.testing.assert_allclose(central[:-1], acceleration[1:-2], atol=3e-2)
    assert np.abs(velocity[-1]).max() < 1e-6
    assert {target.phase for target in targets} == {Phase.STOP}


@settings(max_examples=5)
@given(st.floats(0.5, MOTION.duration - 0.1))
def test_lost_states_ramp_to_neutral(seconds: float) -> None:
    crane = Crane().until(seconds)
    for _ in range(round(TIMEOUT / PERIOD) - 1):
        crane.silence()
    assert crane.experiment.stage is not Stage.RELEASING
    count = len(crane.commands)
    largest = np.abs(crane.commands[-1]).max()
    while not crane.experiment.over:
        crane.silence()
    assert crane.experiment.outcome is Outcome.STATES_LOST
    assert "limit 60 ms" in crane.experiment.message
    ramp = np.abs(crane.commands[count:])
    assert (np.diff(ramp, axis=0) <= 0.0).all()
    assert ramp[0].max() <= largest
    assert not ramp[round(RELEASE_TIME_S / PERIOD) + 1 :].any()


def test_a_velocity_that_is_not_known_is_a_lost_state() -> None:
    crane = Crane().until(3.0)
    velocity = np.array([0.0, np.nan, 0.0, 0.0])
    crane.experiment.sample(crane.now + PERIOD, crane.q, velocity, crane.now + PERIOD)
    assert crane.experiment.outcome is Outcome.STATES_LOST
    assert "inner_boom: velocity must be finite" in crane.experiment.message


@pytest.mark.parametrize("joint", range(4))
def test_tracking_lost_names_joint_error_and_tolerance(joint: int) -> None:
    crane = Crane().until(4.0)
    crane.q[joint] += 0.3
    crane.cycle()
    assert crane.experiment.outcome is Outcome.TRACKING_LOST
    assert crane.experiment.message.startswith(f"{JOINTS[joint]}: tracking error -0.")
    assert "beyond the tolerance 0.2" in crane.experiment.message
    crane.to_the_end()
    ends_well(crane)


def test_what_ends_it_first_is_its_outcome() -> None:
    crane = Crane().until(4.0)
    crane.experiment.stop(Outcome.CANCELED, "canceled")
    crane.experiment.stop(Outcome.DEACTIVATED, "deactivated")
    assert crane.experiment.outcome is Outcome.CANCELED
    crane.experiment.release(Outcome.DRIVER_FAULT, "fault", crane.now)  # worse, while it brakes
    crane.experiment.release(Outcome.STATES_LOST, "lost", crane.now)
    assert crane.experiment.outcome is Outcome.DRIVER_FAULT


@settings(max_examples=5)
@given(st.floats(-1e6, 1e6))
def test_a_leap_of_the_stamps_never_makes_the_reference_leap(leap: float) -> None:
    crane = Crane().until(6.0)
    before = crane.path[-1]
    stamp = crane.now + leap
    crane.experiment.sample(stamp, crane.q, crane.v, crane.now)
    assert crane.experiment.target is not None
    assert np.abs(crane.experiment.target.position - before).max() <= 0.5 * LONGEST_STEP


@pytest.mark.parametrize("back", [0.2, 3600.0])
def test_a_clock_that_is_set_back_ends_the_experiment_and_opens_no_valve_further(
    back: float,
) -> None:
    """Twice; what a controller adds at its start decays, and would grow by a time that is < 0."""
    controller = PdDeadBand(TUNING.gains)
    crane = led_by(controller).until(6.0)
    for _ in range(2):
        before = crane.commands[-1]
        u = crane.experiment.sample(crane.now - back, crane.q, crane.v, crane.now)
        assert u is not None
        np.testing.assert_allclose(u, before, atol=0.02)
        crane.cycle()
    crane.to_the_end()
    assert crane.experiment.outcome is Outcome.STATES_LOST
    assert f"was set back by {back:.2f} s" in crane.experiment.message
    ends_well(crane)


def test_new_gains_come_without_a_jump() -> None:
    """Beside a twin whose gains are left alone."""
    crane, twin = (Crane().until(MOTION.excitation_start + 1.0) for _ in range(2))
    gains = TUNING.gains._replace(kp=2.0 * TUNING.gains.kp)
    crane.experiment.retune(Tuning(gains, 0.1, TUNING.tolerance))
    jump = np.abs(gains.kp - TUNING.gains.kp) * np.abs(crane.experiment.tracking_error)
    crane.cycle()
    twin.cycle()
    difference = np.abs(crane.commands[-1] - twin.commands[-1])
    assert jump.max() > 0.05  # what there would be otherwise
    assert difference.max() < 2 * PERIOD / BLEND * jump.max()
    for _ in range(round(BLEND / PERIOD)):
        crane.cycle()
    assert np.abs(crane.commands[-1]).max() <= 0.1 < np.abs(twin.commands[-1]).max()


def test_the_error_counts_over_whole_periods_alone() -> None:
    error = PeriodicError(4, start=1.0, period=2.0, periods=2)
    assert np.isnan(error.rms).all()
    for time in np.arange(0.0, 4.0, 0.01):
        error.add(time, np.full(4, 100.0 if time < 1.0 or time >= 3.0 else 2.0))
    np.testing.assert_allclose(error.rms, 2.0)
    for time in np.arange(4.0, 8.0, 0.01):
        error.add(time, np.full(4, 100.0))
    np.testing.assert_allclose(error.rms, np.sqrt((4.0 + 1e4) / 2), rtol=1e-2)


class Echo:
    """A controller that leads the crane well enough, and notes what it was shown."""

    preview = 0.03
    by_model = np.ones(4, dtype=bool)

    def __init__(self) -> None:
        self.conditions = (ControlCondition.NOT_INITIALISED,) * 4
        self.wanted: list[Wanted] = []

    def start(self, command: np.ndarray) -> None:
        assert not command.any()
        self.conditions = (ControlCondition.AT_REST,) * 4

    def command(self, dt: float, reading: SensorReading, wanted: Wanted) -> np.ndarray:
        self.wanted.append(wanted)
        error = wanted.now.position - reading.position
        speed = wanted.ahead.velocity + 4.0 * error
        return np.clip(speed + 0.05 * np.sign(speed), -1.0, 1.0)


def led_by(controller: Echo | PdDeadBand) -> Crane:
    crane = Crane()
    crane.experiment = Experiment(MOTION, TUNING, TIMEOUT, crane.now, controller)
    return crane


def test_a_controller_is_shown_the_reference_ahead_and_its_phase() -> None:
    controller = Echo()
    crane = led_by(controller).to_the_end()
    assert crane.experiment.outcome is Outcome.COMPLETED
    assert crane.experiment.rms[1:].max() < 0.01
    steps = round(Echo.preview / PERIOD)
    shown = controller.wanted
    for early, late in zip(shown[:-steps], shown[steps:], strict=True):
        np.testing.assert_allclose(early.ahead.position, late.now.position, atol=1e-9)
    phases = np.array([feedback.phase for feedback in shown])
    assert np.isnan(phases[0])
    assert np.nanmax(phases) == pytest.approx(TRAJECTORY.period, abs=2 * PERIOD)
    ends_well(crane)


def test_the_reference_ahead_brakes_with_the_reference() -> None:
    controller = Echo()
    crane = led_by(controller).until(6.0)
    crane.experiment.stop(Outcome.CANCELED, "asked to")
    begun = len(controller.wanted)
    crane.to_the_end()
    steps, shown = round(Echo.preview / PERIOD), controller.wanted[begun:]
    for early, late in zip(shown[:-steps], shown[steps:], strict=True):
        np.testing.assert_allclose(early.ahead.position, late.now.position, atol=1e-6)


@pytest.mark.parametrize(
    ("condition", "outcome"),
    [
        (ControlCondition.NO_ANSWER, Outcome.TRACKING_LOST),
        (ControlCondition.WRONG_MODEL, Outcome.TRACKING_LOST),
        (ControlCondition.NOT_MEASURED, Outcome.STATES_LOST),
    ],
)
def test_a_controller_that_stops_ends_the_experiment(
    condition: ControlCondition, outcome: Outcome
) -> None:
    controller = Echo()
    crane = led_by(controller).until(6.0)
    controller.conditions = (*controller.conditions[:3], condition)
    crane.to_the_end()
    assert crane.experiment.outcome is outcome
    assert crane.experiment.message == f"{JOINTS[3]}: {condition.text}"
    ends_well(crane)


def test_conditions_of_the_controller_are_reported_at_the_end() -> None:
    controller = Echo()
    crane = led_by(controller).until(6.0)
    lost = ControlCondition.PRESSURES_LOST
    controller.conditions = (*controller.conditions[:2], lost, controller.conditions[3])
    crane.until(7.0)
    controller.conditions = (ControlCondition.FOLLOWING,) * 4
    crane.to_the_end()
    assert crane.experiment.outcome is Outcome.COMPLETED
    assert (
        crane.experiment.account == f"{crane.experiment.message}; {JOINTS[2]} at 6.0 s: {lost.text}"
    )


def test_a_defect_ramps_to_neutral_and_is_over_even_if_it_comes_again_and_again() -> None:
    crane = Crane()
    while not np.any(crane.v):
        crane.cycle()
    before = np.abs(crane.commands[-1]).max()
    crane.experiment.fail("broken", crane.now)
    crane.cycle()
    assert 0.0 < np.abs(crane.commands[-1]).max() < before
    began = crane.now
    while not crane.experiment.over:
        crane.now += PERIOD
        crane.experiment.fail("broken again", crane.now)
        assert crane.now - began < 1.0
    assert (crane.experiment.outcome, crane.experiment.message) == (Outcome.FAILED, "broken")
