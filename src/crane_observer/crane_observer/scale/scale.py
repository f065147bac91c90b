"""The scale: readings as they come, in any order, to a weighing for each window."""

from enum import Enum
from typing import NamedTuple

import numpy as np

from crane_model.array import Array
from crane_model.errors import RangeError
from crane_model.machine import Machine
from crane_model.model_file import Model
from crane_observer.scale.balance import MeanMotion, TipMechanics
from crane_observer.scale.doubt import ModelDoubt
from crane_observer.scale.filter import MASS, Balanced
from crane_observer.scale.histories import Histories
from crane_observer.scale.readings import HeldReadings
from crane_observer.scale.weighing import TipLoad, attainable
from crane_observer.scale.window import means, slowest_and_fastest

WINDOW = 0.3  # s
HOP = 0.15  # s from one window to the next
APART = 0.02  # s from the windows of other observers, so that no cycle bears the work of all
LATEST = 0.1  # s that positions may come after pressures
STANDING = 0.02  # of the fastest that a joint may move, below which it counts as standing
CRAWLING = 2.0  # times that: how fast friction becomes what it is in faster motion
WORST = 10.0  # kg, standard deviation that the best weighing in a pose may have to be one: half of
# the lightest load that the aims ask for
TOLD = 0.77  # of the filter's standard deviation: all that it allows for seldom comes together; set
# by lifts of 24 hard and 12 stock machines (`crane_benchmark loads`, seeds 94500 and 128800)


class ScaleCondition(Enum):
    """What is wrong with what comes in, or with the pose; in the order of gravity."""

    WAITING = "waiting for pressures and positions"
    PRESSURES_LOST = "pressures lost, of a joint or all: nothing is weighed until they are back"
    POSITIONS_LOST = "positions lost: nothing is weighed until they are back, or estimated"
    UNOBSERVABLE = "this pose does not permit weighing: move the load where it pulls at a joint"
    POSITIONS_ESTIMATED = "a position is estimated: weighed with it"
    AT_REST = "at rest: dry friction hides part of the load; move it to weigh it better"
    GOOD = "weighed in motion"


class Weighing(NamedTuple):
    """After a window."""

    time: float  # s, at its end
    load: TipLoad
    condition: ScaleCondition
    changed: bool  # a load came or went: it was noticed now
    since: float  # s, when this load came or went; -inf if it was there from the beginning
    moved: float  # s of motion since then


class Scale:
    """What hangs at the tip of the machine of a model; times in seconds, arrays (j,) in the order
    of its joints.
    """

    def __init__(self, model: Model, doubt: ModelDoubt | None = None):
        """`ConfigurationError` names what the model lacks."""
        self.model = model
        self._mechanics = TipMechanics.of(model)
        joints = len(model.joints)
        self._histories = Histories(doubt or ModelDoubt.of(model), joints)
        limits = [self.machine.limits[joint] for joint in model.joints]
        fastest = np.array([min(-one.velocity_min, one.velocity_max) for one in limits])
        self._standing = STANDING * fastest
        self.pressures, self.encoders = HeldReadings(2 * joints), HeldReadings(joints)
        self.estimates = HeldReadings(3 * joints)
        self._end, self._weighed_until = np.nan, np.nan
        self._moved = 0.0

    @property
    def machine(self) -> Machine:
        """That of the model."""
        return self._mechanics.machine

    @property
    def late(self) -> int:
        """Readings that came after newer ones, and were left out."""
        return self.pressures.late + self.encoders.late + self.estimates.late

    @property
    def invalid(self) -> int:
        """Readings that were no numbers."""
        return self.pressures.invalid + self.encoders.invalid + self.estimates.invalid

    def tare(self) -> None:
        """What hangs at the tip counts as nothing from now on."""
        self._histories.tare()

    def add_encoders(self, time: float, position: Array) -> None:
        """Readings [rad, m]; NaN of a joint whose encoder is not to be believed."""
        self.encoders.add(time, position)

    def add_estimate(self, time: float, position: Array, velocity: Array, deviation: Array) -> None:
        """What the position sensor tells, for joints without encoder [rad, m]."""
        self.estimates.add(time, np.concatenate([position, velocity, deviation]))

    def add_pressures(self, time: float, chamber_a: Array, chamber_b: Array) -> list[Weighing]:
        """Readings [Pa], the clock of all; NaN where nothing was measured. The weighings of all
        windows that are complete by now.
        """
        newest = self.pressures.newest
        self.pressures.add(time, np.concatenate([chamber_a, chamber_b]))
        begins = not np.isfinite(self._end) or time - newest > WINDOW
        if begins and np.isfinite(self.pressures.newest):
            self._end = self.pressures.newest + APART + WINDOW
        found = []
        while self._end <= time:
            if time < self._end + LATEST and self.encoders.newest < self._end:
                break  # positions may still come
            found.append(self._weigh(self._end))
            self._end += HOP
        return found

    def _weigh(self, end: float) -> Weighing:
        motion, (slowest, fastest), deviation = self._motion(end)
        estimated = bool((deviation > 0.0).any())
        duration = HOP if np.isnan(self._weighed_until) else max(end - self._weighed_until, HOP)
        if not np.isfinite(motion.position).all():
            return self._told(end, ScaleCondition.POSITIONS_LOST)
        try:
            balance = self._mechanics.balance(motion)
        except RangeError:  # no encoder of this machine can show that
            return self._told(end, ScaleCondition.POSITIONS_LOST)
        if np.isnan(balance.force).any():
            return self._told(end, ScaleCondition.PRESSURES_LOST)
        by_place = np.zeros((len(deviation), len(deviation)))
        if estimated:
            load = float(self._histories.filter.x[MASS])
            by_place = self._mechanics.slopes(motion, load) * deviation
        window = Balanced(
            duration,
            balance,
            (slowest > self._standing) | (fastest < -self._standing),
            np.maximum(-slowest, fastest) < self._standing,
            fastest > 0.0,
            np.exp(-np.abs(motion.velocity) / (CRAWLING * self._standing)),
            by_place,
        )
        changed = self._histories.add(end, window)
        self._weighed_until = end
        self._moved = 0.0 if changed else self._moved + HOP * bool(window.moving.any())
        condition = ScaleCondition.GOOD
        if window.standing.all():
            condition = ScaleCondition.AT_REST
        if estimated:
            condition = ScaleCondition.POSITIONS_ESTIMATED
        if attainable(self._histories.filter, window) > WORST:
            condition = ScaleCondition.UNOBSERVABLE
        return self._told(end, condition, changed)

    def _motion(self, end: float) -> tuple[MeanMotion, Array, Array]:
        """Also (2, j) least and largest speeds within the window, and (j,) standard deviations of
        the positions; 0 where encoders measure them.
        """
        j = len(self._standing)
        begin = end - WINDOW
        q, v, a = means(*self.encoders.held, begin, end)
        p = means(*self.pressures.held, begin, end)[0]
        speeds, deviation = slowest_and_fastest(*self.encoders.held, begin, end), np.zeros(j)
        lost = ~np.isfinite(q)
        if lost.any():
            estimate = means(*self.estimates.held, begin, end)
            told = slowest_and_fastest(*self.estimates.held, begin, end)[:, :j]
            speeds = np.where(lost, told, speeds)
            q = np.where(lost, estimate[0, :j], q)
            v = np.where(lost, estimate[0, j : 2 * j], v)
            a = np.where(lost, estimate[1, j : 2 * j], a)
            deviation = np.where(lost, estimate[0, 2 * j :], deviation)
        return MeanMotion(q, v, a, p[:j], p[j:]), speeds, deviation

    def _told(self, end: float, condition: ScaleCondition, changed: bool = False) -> Weighing:
        load = self._histories.load
        load = load._replace(deviation=TOLD * load.deviation)
        return Weighing(end, load, condition, changed, self._histories.since, self._moved)
