"""Small motions, on a crane of two joints behind valves with dead bands, without ROS."""

import numpy as np
import pytest

from crane_driver.operator.bringup import motion
from crane_driver.operator.bringup.bench import Bench
from crane_driver.operator.bringup.estimates import JointInstant, Rest, fit_dead_band
from crane_driver.operator.bringup.motion import MotionError, Mover, StoppedError, Tick
from crane_model import DataError

JOINTS = ("inner_boom", "outer_boom")
RESOLUTION = 4.8e-5
PERIOD, PER_TICK = 0.005, 2


class Crane:
    """Every tick 10 ms; `mixed` of the speed goes to the other joint; both sink."""

    def __init__(self, up=0.08, down=0.05, gain=0.8, lag=0.03, polarity=1, mixed=0.0, sinking=0.0):
        self.sinking = sinking
        self.up, self.down, self.gain, self.lag = up, down, gain, lag
        self.polarity, self.mixed = polarity, mixed
        self.position, self.spool, self.now = np.zeros(2), 0.0, 0.0
        self.sent: list[float] = []

    def tick(self, command):
        self.sent.append(command)
        sent, samples = self.now, []
        for _ in range(PER_TICK):
            self.now += PERIOD
            self.spool += (self.polarity * command - self.spool) * PERIOD / self.lag
            speed = self.gain * (max(self.spool - self.up, 0.0) + min(self.spool + self.down, 0.0))
            velocity = speed * np.array([1.0, self.mixed])
            self.position += (velocity - self.sinking) * PERIOD
            shown = RESOLUTION * np.round(self.position / RESOLUTION)
            samples.append(JointInstant(self.now, shown, velocity))
        return Tick(sent, samples)

    def leave(self):
        for _ in range(20):
            Crane.tick(self, 0.0)


def mover(crane, travel=0.2):
    return Mover(crane, JOINTS, "inner_boom", [Rest(0.0, 0.0, RESOLUTION)] * 2, travel)


@pytest.mark.parametrize("polarity", [-1, 1])
def test_a_nudge_is_small_and_ends_at_neutral(polarity):
    crane = Crane(polarity=polarity)
    hand = mover(crane)
    nudge = motion.nudge(hand, 1, 0.05, 0.25)
    assert np.sign(nudge.moved) == polarity
    assert abs(crane.position[0]) < 0.003
    assert crane.sent[-1] == 0.0
    assert max(crane.sent) < 0.12


def test_nothing_is_opened_beyond_the_limit():
    crane = Crane(up=0.5)
    with pytest.raises(DataError, match=r"up to a command of 0\.25"):
        motion.nudge(mover(crane), 1, 0.05, 0.25)
    assert max(crane.sent) <= 0.25


def test_another_joint_that_moves_is_named():
    crane = Crane(mixed=1.0)
    with pytest.raises(MotionError, match="outer_boom has moved by .* while inner_boom"):
        motion.triangle(mover(crane), 1, 0.05, 0.04, 0.25)
    assert abs(crane.position[1]) < 0.006


def test_a_joint_goes_no_further_than_it_may():
    crane = Crane()
    with pytest.raises(MotionError, match=r"inner_boom has moved by \+0\.02"):
        motion.step(mover(crane, travel=0.02), 0.2, 5.0, 0.25)
    assert crane.position[0] < 0.022


@pytest.mark.parametrize("joint", [0, 1])
def test_a_joint_that_is_not_seen_is_let_go(joint):
    crane = Crane()
    hand = mover(crane)
    hand.settle()
    crane.position[joint] = np.nan
    with pytest.raises(MotionError, match=f"{JOINTS[joint]} has moved by .*nan"):
        hand.tick(0.1)


def test_a_clock_that_is_set_back_opens_no_valve_further():
    class SetBack(Crane):
        def tick(self, command):
            if 0.0 < command < max(self.sent, default=0.0) and self.now > 0.0:  # it closes
                self.now -= 5.0
            return super().tick(command)

    crane = SetBack()
    with pytest.raises(MotionError, match="clock of the joint states was set back by 4.99"):
        motion.triangle(mover(crane), 1, 0.05, 0.04, 0.25)
    assert crane.sent[-1] < max(crane.sent) == crane.sent[-2]


def test_a_step_is_not_larger_than_the_limit():
    crane = Crane()
    with pytest.raises(DataError, match=r"inner_boom: a step of 0\.3, limit 0\.25"):
        motion.step(mover(crane), -0.3, 0.5, 0.25)
    assert not crane.sent


def test_a_joint_that_does_not_come_back_is_let_go():
    """As when the engine was stopped, and will be started again."""
    crane = Crane()
    hand = mover(crane)
    motion.step(hand, 0.15, 0.5, 0.25)
    crane.down = 1.0
    crane.tick = limited(crane.tick, 2000)
    with pytest.raises(MotionError, match=r"does not come back by a command of -0\.08"):
        motion.back(hand, 0.11, -0.08)


@pytest.mark.parametrize("sinking", [1.14e-4, 8e-4])
def test_a_crane_that_sinks_is_measured(sinking):
    """The other joint goes further than it may be shaken, the one that is measured before it is
    moved.
    """
    crane = Crane(sinking=sinking)
    hand = mover(crane)
    for direction, true in ((1, 0.08), (-1, 0.05)) * 3:
        nudge = motion.nudge(hand, direction, 0.02, 0.25)
        assert np.sign(nudge.moved) == direction
        assert abs(nudge.command) == pytest.approx(true, abs=0.01)
    assert crane.position[1] < -13.7e-3 * sinking / 1.14e-4 / 5.0


class Stalls(Crane):
    """Cut off at the command numbered `stall`, once; the driver has a fault then, or not."""

    def __init__(self, stall, fault):
        super().__init__()
        self.stall, self.fault, self.trouble = stall, fault, ""

    def tick(self, command):
        if len(self.sent) == self.stall and command:
            self.stall = None
            self.trouble = self.fault
            raise StoppedError("no command for 107 ms, limit 80 ms: this computer is too busy")
        return super().tick(0.0 if self.trouble else command)

    def recover(self):
        self.trouble = ""


class Answers:
    def __init__(self):
        self.said, self.asked = [], []

    def say(self, text):
        self.said.append(text)

    def confirm(self, question):
        self.asked.append(question)


@pytest.mark.parametrize("fault", ["", "command timeout: last command 107 ms ago"])
def test_a_stall_costs_the_ramp_that_it_touched(fault):
    """A fault of the driver is reset when the operator has said so, and not without a fault."""
    crane, operator = Stalls(250, fault), Answers()
    bench = Bench(crane, operator, *[None] * 9)
    hand = mover(crane)
    found = []
    for direction in (1, -1):
        trace = bench.driven(hand, lambda one, way=direction: triangle(one, way))
        found.append(fit_dead_band("inner_boom", trace, direction).dead_band)
    assert crane.stall is None
    assert found == pytest.approx([0.08, 0.05], abs=2e-3)
    assert len(operator.said) == 1
    assert "107 ms" in operator.said[0]
    assert "only this ramp of inner_boom is repeated" in operator.said[0]
    assert len(operator.asked) == bool(fault)
    assert fault in "".join(operator.asked)


def test_a_computer_that_always_stalls_is_given_up():
    crane = Crane()
    bench = Bench(crane, Answers(), *[None] * 9)
    crane.trouble = ""

    def ramp(hand):
        raise StoppedError("no command for 107 ms")

    with pytest.raises(StoppedError):
        bench.driven(mover(crane), ramp)


def triangle(hand, direction):
    return motion.triangle(hand, direction, 0.05, 0.04, 0.25)


def limited(tick, count):
    """`tick`, which fails after so many times: what would never end fails, too."""
    left = iter(range(count))

    def one(command):
        next(left)
        return tick(command)

    return one


def test_a_joint_that_sinks_never_settles():
    crane = Crane(up=0.0, down=0.0)
    crane.spool, crane.lag = -0.02, 1e9
    with pytest.raises(MotionError, match="does not come to rest"):
        mover(crane, travel=1.0).settle()


@pytest.mark.parametrize(("direction", "true"), [(1, 0.08), (-1, 0.05)])
def test_a_triangle_shows_the_dead_band(direction, true):
    crane = Crane()
    trace = motion.triangle(mover(crane), direction, 0.05, 0.04, 0.25)
    assert fit_dead_band("inner_boom", trace, direction).dead_band == pytest.approx(true, abs=2e-3)


def test_a_triangle_ends_when_the_joint_moves_the_other_way():
    crane = Crane(polarity=-1)
    with pytest.raises(MotionError, match="inner_boom moves against its command: by -"):
        motion.triangle(mover(crane), 1, 0.05, 0.04, 0.25)
    assert max(crane.sent) < 0.12


@pytest.mark.parametrize("command", [-0.15, 0.15])
def test_it_goes_back_to_where_it_was(command):
    crane = Crane()
    hand = mover(crane)
    motion.step(hand, command, 0.5, 0.25)
    assert abs(crane.position[0]) > 0.02
    motion.back(hand, 0.11, -0.08)
    assert abs(crane.position[0]) < 0.003
    assert crane.sent[-1] == 0.0
