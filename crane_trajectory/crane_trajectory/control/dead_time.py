"""`predictive_flow`: for valves that answer late, control of where a joint will be.

A reading follows the speed v that a valve is opened for, `lag` L seconds later and beside what the
model does not know, d:

    q'(t) = v(t - L) + d

An observer follows the readings with q0 and d; from them and from the speeds that are still on the
way, the position L seconds ahead is predicted, and the error there is what the feedback sees:

    q0' = v(t - L) + d + l1 (q - q0),    d' = l2 (q - q0)
    v = v_ref(t + M) + kv [q_ref(t + M) - q0 - int_{t-L}^t v - d L] - d

with M the lag less the latency of the reading, when the command of now moves the joint. This is
finite spectrum assignment (Manitius and Olbrich 1979) with a disturbance observer. If model and lag
are right, the dead time leaves the loop; `margins` tells how far both may be off. The inverse of
its flow opens the valve: with load sensing, the drop at the edge that feeds is the margin of the
pump, unless the load drives the piston; else it follows from the load of the model.
"""

import math
from collections import deque
from typing import NamedTuple

import numpy as np

from crane_model.errors import ConfigurationError
from crane_model.hydraulics import HydraulicValues
from crane_model.machine import Machine
from crane_model.model_file import Model
from crane_trajectory.control.controller import (
    STOP_RATE,
    ControlCondition,
    SensorReading,
    Wanted,
    conditions,
)
from crane_trajectory.control.flow_feedforward import LONGEST_CYCLE, RESTING, ReferenceLoad
from crane_trajectory.control.valves_and_oil import (
    NO_NEWS,
    WATCH,
    answer,
    edges,
    identified,
    length_and_lever,
    speed_at_margin,
    speed_under_load,
    spool,
    tables,
)

SHORTEST_LAG = 0.02  # s: gains follow from the lag, but none is faster than this makes it
KV_TIMES_LAG = 0.7  # kv times the lag
OBSERVER_TIMES_LAG = 0.8  # frequency of the observer times the lag
LARGEST_KV = 4.5  # 1/s
LEAST_MARGINS = (2.0, 40.0, 0.35)  # gain; phase [degree]; delay, as a share of the lag
WEAKER = 0.9  # by which gains that lack a margin are lowered
REST_TOLERANCE = {"rad": 2e-3, "m": 5e-3}  # error that a joint at rest is left with
LARGEST_DISTURBANCE = 0.3  # of the largest speed, that d may be
FREQUENCIES = np.geomspace(0.02, 60.0, 4000)  # rad/s

FOLLOWING, AT_REST = int(ControlCondition.FOLLOWING), int(ControlCondition.AT_REST)
SATURATED = int(ControlCondition.SATURATED)
NOT_INITIALISED = int(ControlCondition.NOT_INITIALISED)
NOT_MEASURED = int(ControlCondition.NOT_MEASURED)


class PredictorGains(NamedTuple):
    """Gains of the predictor of one joint."""

    kv: float  # 1/s
    l1: float  # 1/s
    l2: float  # 1/s2


class LoopMargins(NamedTuple):
    """By how much a loop may differ before it oscillates."""

    gain: float  # factor
    phase: float  # degree
    delay: float  # s, that the lag may be longer

    def suffice(self, lag: float) -> bool:
        """Return whether the margins reach `LEAST_MARGINS` for a lag [s]."""
        gain, phase, share = LEAST_MARGINS
        return self.gain >= gain and self.phase >= phase and self.delay >= share * lag


def margins(gains: PredictorGains, lag: float) -> LoopMargins:
    """Smallest margins of the loop, cut at the valve command; the joint is `lag` [s] late."""
    kv, l1, l2 = gains
    s = 1j * FREQUENCIES
    late = np.exp(-lag * s)
    delta = s**2 + l1 * s + l2
    a, b = s * late / delta, (l1 * s + l2) / delta  # q0 = a v + b q
    of_d = (kv * lag + 1.0) * l2 / s
    loop = (kv * b + of_d * (1.0 - b)) / (1.0 + kv * (1.0 - late) / s + kv * a - of_d * a)
    loop = loop * late / s
    phase = np.unwrap(np.angle(loop))
    phase += 2.0 * np.pi * np.round((-0.5 * np.pi - phase[0]) / (2.0 * np.pi))
    size = np.abs(loop)
    turned = np.flatnonzero(np.diff(np.floor((phase + np.pi) / (2.0 * np.pi))))
    crossed = np.flatnonzero(np.diff(np.sign(size - 1.0)))
    above = [size[k] for k in turned if size[k] < 1.0]
    spare = np.pi + phase[crossed]
    if not len(crossed) or (spare < 0.0).any() or any(size[k] >= 1.0 for k in turned[:1]):
        return LoopMargins(0.0, 0.0, 0.0)
    delay = float((spare / FREQUENCIES[crossed]).min())
    gain = 1.0 / max(above, default=1e-9)
    return LoopMargins(float(gain), float(np.degrees(spare.min())), delay)


def predictor_gains(lag: float) -> PredictorGains:
    """The quickest gains with `LEAST_MARGINS` for a lag [s]."""
    lag = max(lag, SHORTEST_LAG)
    kv, frequency = min(KV_TIMES_LAG / lag, LARGEST_KV), OBSERVER_TIMES_LAG / lag
    while True:
        gains = PredictorGains(kv, 2.0 * frequency, frequency**2)
        if margins(gains, lag).suffice(lag):
            return gains
        kv, frequency = WEAKER * kv, WEAKER * frequency


class PredictiveFlow:
    """A `Controller`; see the head of this file.

    `model` predicts the loads of the reference, `hydraulics` give the lags of the loop, and `scale`
    multiplies kv. `ConfigurationError` if the hydraulics lack a joint or a value that is needed.
    """

    def __init__(
        self, machine: Machine, model: Model, hydraulics: HydraulicValues, scale: float = 1.0
    ):
        self._joints = joints = machine.joint_names
        if lacking := [joint for joint in joints if joint not in hydraulics.joints]:
            raise ConfigurationError(
                f"predictive_flow: the model knows no valve of {', '.join(lacking)}; identify all "
                "joints, or choose another controller"
            )
        known = identified(machine, hydraulics, joints)
        self._valves = known.records().view(np.recarray)
        self._late = np.array(known.lag)  # s, until a command moves its joint
        self.lag = self._late + machine.latency(joints)  # s, until a reading shows it
        self.gains = tuple(predictor_gains(lag) for lag in self.lag)
        self.gains = tuple(gains._replace(kv=scale * gains.kv) for gains in self.gains)
        self._kv = np.array([gains.kv for gains in self.gains])
        self._l1, self._l2 = (np.array([gains[i] for gains in self.gains]) for i in (1, 2))
        self.preview = float(self._late.max())
        self.by_model = np.ones(len(joints), dtype=bool)
        sensing = machine.hydraulics.load_sensing
        self._drop = sensing.margin if sensing else None
        self._load, self._tables = ReferenceLoad(model, machine), tables(machine)
        self._most = LARGEST_DISTURBANCE * machine.ranges(joints).top_speed
        self._tolerance = np.array([REST_TOLERANCE[machine.units[joint]] for joint in joints])
        self._codes = np.full(len(joints), NOT_INITIALISED)
        self._reset(np.zeros(len(joints)))

    @property
    def margins(self) -> dict[str, LoopMargins]:
        pairs = zip(self._joints, self.gains, self.lag, strict=True)
        return {joint: margins(gains, float(lag)) for joint, gains, lag in pairs}

    def lacking(self) -> list[str]:
        """The joints whose margins are less than `LEAST_MARGINS`."""
        pairs = zip(self.margins.items(), self.lag, strict=True)
        return [joint for (joint, found), lag in pairs if not found.suffice(float(lag))]

    def margin_lines(self) -> list[str]:
        """A line for each joint: lag, gain, and by how much the loop may be off."""
        return [
            f"{joint}: lag {lag * 1e3:.0f} ms, kv {gains.kv:.2f} 1/s; margins: gain "
            f"{found.gain:.1f}, phase {found.phase:.0f} degree, delay {found.delay * 1e3:.0f} ms"
            for (joint, found), lag, gains in zip(
                self.margins.items(), self.lag, self.gains, strict=True
            )
        ]

    def _reset(self, command: np.ndarray) -> None:
        joints = len(command)
        self._watch = np.zeros(joints, WATCH).view(np.recarray)
        self._time, self._last = 0.0, np.array(command, dtype=float)
        self._position: np.ndarray | None = None
        self._disturbance = np.zeros(joints)
        self._sent: deque[tuple[float, np.ndarray]] = deque()  # time and way sent until then
        self._ahead: deque[tuple[float, np.ndarray]] = deque()  # time, (3, j) reference and load

    def start(self, command: np.ndarray) -> None:
        """Take over where `command` (j,) was in force, without a jump."""
        self._reset(command)
        self._codes[:] = AT_REST

    @property
    def conditions(self) -> tuple[ControlCondition, ...]:
        return conditions(self._codes)

    def command(self, dt: float, reading: SensorReading, wanted: Wanted) -> np.ndarray:
        dt = min(max(dt, 0.0), LONGEST_CYCLE)
        now, ahead = wanted.now, wanted.ahead
        known = np.isfinite(reading.position + now.position + ahead.position + ahead.velocity)
        if not known.all() and (self._codes < NOT_INITIALISED).all():
            self._codes[~known] = NOT_MEASURED
        if (self._codes >= NOT_INITIALISED).any():
            size = np.maximum(np.abs(self._last) - STOP_RATE * dt, 0.0)
            self._last = np.copysign(size, self._last)
            return self._last.copy()
        self._time += dt
        predicted, arrived = self._predict(dt, reading.position)
        rows = np.stack([ahead.position, ahead.velocity, self._load(*ahead)])
        position, velocity, load = self._reference(rows)
        error = position - predicted
        speed = velocity + self._kv * error - self._disturbance
        sent = np.zeros(len(speed))
        rests = (np.abs(ahead.velocity) < RESTING) & (np.abs(velocity) < RESTING)
        for i in range(len(speed)):
            near = 2.0 if self._codes[i] == AT_REST else 1.0
            if rests[i] and abs(error[i]) < near * self._tolerance[i]:
                self._codes[i], self._last[i] = AT_REST, 0.0
                continue
            sent[i] = self._open(i, predicted[i], speed[i], load[i], reading.supply, wanted.largest)
            news = answer(self._watch[i], arrived[i], arrived[i], reading.velocity[i], dt)
            if news != NO_NEWS:
                self._codes[i] = news
        self._sent.append((self._time + dt, self._way(self._time)[0] + dt * sent))
        return self._last.copy()

    def _open(
        self, i: int, q: float, speed: float, load: float, supply: float, largest: float
    ) -> float:
        """Command the valve of joint i for a speed at a position q; the speed that it will have."""
        valve = self._valves[i]
        _, lever = length_and_lever(self._tables[i], q)
        piston = lever * speed
        extends = piston > 0.0
        gain_a, gain_b = edges(valve, extends)
        if self._drop is not None:
            fully_open = speed_at_margin(valve, extends, gain_a, gain_b, load / lever, self._drop)
        else:
            if not 0.5 < supply / valve.supply_pressure < 2.0:  # or not measured
                supply = valve.supply_pressure
            fully_open = speed_under_load(valve, extends, gain_a, gain_b, load / lever, supply)
        dead_band = valve.dead_band_extend if extends else valve.dead_band_retract
        opening = (1.0 - dead_band) * piston / fully_open
        y = spool(opening, dead_band)
        held = min(max(y, -largest), largest)
        self._codes[i] = SATURATED if held != y else FOLLOWING
        self._last[i] = valve.sense * held
        if held != y:
            beyond = math.copysign(max(abs(held) - dead_band, 0.0), held)
            return float(beyond / (1.0 - dead_band) * fully_open / lever)
        return speed

    def _way(self, time: float | np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(j,) displacement of all speeds sent until a time [s]; and at the end of the last."""
        joints = len(self._last)
        if not self._sent:
            return np.zeros(joints), np.zeros(joints)
        times = np.array([at for at, _ in self._sent])
        ways = np.array([way for _, way in self._sent])
        asked = np.broadcast_to(time, joints)
        found = [np.interp(asked[i], times, ways[:, i]) for i in range(joints)]
        return np.array(found), ways[-1]

    def _predict(self, dt: float, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(j,) positions one lag ahead, and the speeds that readings show now."""
        if self._position is None:
            self._position = q.copy()
            self._sent.append((self._time, np.zeros(len(q))))
        due, _ = self._way(self._time - self.lag)
        before, _ = self._way(self._time - dt - self.lag)
        self._position += due - before + dt * self._disturbance
        off = q - self._position
        self._position += np.minimum(self._l1 * dt, 1.0) * off
        self._disturbance = np.clip(
            self._disturbance + self._l2 * dt * off, -self._most, self._most
        )
        sent, _ = self._way(self._time)
        while len(self._sent) > 2 and self._sent[1][0] < self._time - self.preview - 1.0:
            self._sent.popleft()
        predicted = self._position + sent - due + self.lag * self._disturbance
        return predicted, (due - before) / dt if dt > 0.0 else np.zeros(len(q))

    def _reference(self, newest: np.ndarray) -> np.ndarray:
        """(3, j) position, velocity and load of the reference, of each joint when a command of now
        moves it; `newest` are those `preview` ahead.
        """
        self._ahead.append((self._time, newest))
        while len(self._ahead) > 2 and self._ahead[1][0] < self._time - self.preview:
            self._ahead.popleft()
        times = np.array([at for at, _ in self._ahead])
        rows = np.array([row for _, row in self._ahead])
        asked = self._time - (self.preview - self._late)
        return np.array(
            [
                [np.interp(at, times, rows[:, k, i]) for i, at in enumerate(asked)]
                for k in range(len(newest))
            ]
        )
