"""`flow_feedforward`: the valve opening that the reference needs, by the inverse of its flow.

Per joint, with the error e = q_ref - q,

    v = v_ref(t + T) + kv e + ki Int(e),    n = dx/dq v + [F' - kp H(F_meas - F)] / (k_A + k_B)

F is the piston force of (16) along the reference, with the load at the tip if one is told, H a
high-pass of `DAMPED` seconds. The opening is n / g (see `valves_and_oil`), crossed over the dead
zone in the direction wanted. With chamber pressures g follows from them and H damps the oil
(dynamic pressure feedback); without, or if a transducer fails, g follows from F and kp is zero. If
reference and crane rest, the valve is closed.

A load m at the tip that is told with a standard deviation s counts as

    m m^2 / (m^2 + s^2)

so that one which may as well be nothing counts as nothing. A load that is old, is no number, comes
of an estimator that is degraded, or is heavier than any that is allowed counts as nothing, too. The
mass that counts changes at a bounded rate: whatever is told, no command jumps.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numba import njit

from crane_model.chain.dynamics import inverse_dynamics, tip_bodies
from crane_model.errors import DataError
from crane_model.machine import Machine
from crane_model.model_file import Model
from crane_model.motion_columns import smooth_forces, table
from crane_model.record import Record
from crane_model.terms import Term
from crane_model.terms.term import Setting
from crane_trajectory.control.controller import (
    AT_REST,
    BUMP,
    FOLLOWING,
    NOT_INITIALISED,
    NOT_MEASURED,
    SATURATED,
    STOP_RATE,
    ControlCondition,
    Point,
    SensorReading,
    Wanted,
    conditions,
)
from crane_trajectory.control.valves_and_oil import (
    HISTORY,
    NO_NEWS,
    STATE,
    WATCH,
    WINDOW,
    CycleSetting,
    Memory,
    Piston,
    ValvesAndOil,
    against_play,
    answer,
    as_identified,
    at_bound,
    before,
    damping,
    length_and_lever,
    look_back,
    opened,
    records_of,
    speed_opened,
    spool,
    stiffness,
    tables,
    transducers_good,
)

REVERSAL_SPEED = 0.008  # rad/s or m/s; for slow valves sgn(q') of (13) is tanh(q' / this)
LOAD_RATE = 20.0  # kg/s
OLDEST_LOAD = 1.0  # s between the load that is told and the reading that it is used with
BELIEVED = ("GOOD", "AT_REST", "UNOBSERVABLE")
"""Conditions of a payload estimator that has its readings. Where a pose does not permit an
estimate, it keeps the load, with a standard deviation that grows."""

SMOOTHED = 0.01  # s: steps of the encoders in the error
LARGEST_INTEGRAL = 0.2  # of the largest speed: what the integral may ask for
RESTING = 1e-6  # rad/s, rad/s2 or m: a reference that is slower rests
LONGEST_CYCLE = 0.05  # s; a longer gap between two readings counts as this
TOLERANCES = {"rad": 3e-4, "m": 5e-4}  # of a crane at rest
KV = {"rad": 4.5, "m": 5.5}  # 1/s; a telescope rides on its oil at 140 rad/s, the booms at 18 to 36
KI = {"rad": 10.0, "m": 15.0}  # 1/s2

AT_BOUND, LOST = int(ControlCondition.ADAPTATION_AT_BOUND), int(ControlCondition.PRESSURES_LOST)


class ReferenceLoad:
    """Generalized forces that the reference needs, of all joints of a machine.

    Friction, as far as it follows the motion of the instant, and the terms of rigid bodies, gravity
    and loads count; what else the model has follows no reference. A joint that the model lacks has
    no load. `at_tip` [kg] hangs at the tip beside what the model has there.
    """

    def __init__(self, model: Model, machine: Machine):
        self._columns = [machine.joint_names.index(joint) for joint in model.joints]
        self._model, self._count = model, len(machine.joint_names)
        self._bodies: list[tuple[Term, np.ndarray, np.ndarray]] = []
        self._theta, self._time = np.zeros(len(model.theta)), np.zeros(1)
        zeros = np.zeros((1, len(model.joints)))
        rest = Record(model.joints, self._time, zeros, zeros, zeros)
        for term in model.terms:
            part = model.part(term)
            if term.motion_columns(model.setting):
                if term.is_friction() or term.has_weight():
                    self._theta[part] = model.theta[part]
            elif term.has_weight() and _follows(term, rest, model.setting):
                values = model.theta[part]
                self._bodies.append((term, np.zeros((*zeros.shape, len(values))), values))
        self.at_tip = 0.0
        self._chain, self._one_kilogram = machine.chain, tip_bodies(machine.chain)[0]
        self._table = table(model.motion_columns, model.joints)

    def __call__(
        self, position: np.ndarray, velocity: np.ndarray, acceleration: np.ndarray
    ) -> np.ndarray:
        """(j,) N m, N at a point (j,) of the reference."""
        whole = position[None], velocity[None], acceleration[None]
        q, v, a = (np.take(values[0], self._columns)[None] for values in whole)
        tau = np.empty_like(v)
        smooth_forces(self._table, self._theta, v, a, REVERSAL_SPEED, tau)
        record = Record(self._model.joints, self._time, q, v, a)
        for term, columns, values in self._bodies:
            columns[:] = 0.0
            term.fill(record, self._model.setting, columns)
            tau += columns @ values
        if self.at_tip:
            per_kilogram = inverse_dynamics(self._chain, self._one_kilogram, *whole)
            tau += self.at_tip * per_kilogram[:, self._columns]
        load = np.zeros(self._count)
        load[self._columns] = tau[0]
        return load


def _follows(term: Term, record: Record, setting: Setting) -> bool:
    """Return whether a term needs only the reference: no memory and no other signal."""
    if term.start(record, setting).shape[1]:
        return False
    try:
        term.columns(record, setting)
    except DataError:
        return False
    return True


class ToldLoad(NamedTuple):
    """Load told by a payload estimator."""

    time: float  # s, of the clock of the readings
    mass: float  # kg
    deviation: float  # kg, standard deviation
    condition: str


class FedLoad:
    """The mass that counts at the tip; `heaviest` [kg] is the largest that is believed."""

    def __init__(self, heaviest: float):
        self._heaviest = heaviest
        self._told: ToldLoad | None = None
        self._time = math.inf
        self.mass = 0.0  # kg

    def tell(self, told: ToldLoad) -> None:
        self._told = told

    def at(self, time: float) -> float:
        """The mass [kg] at a time [s], which moves towards what is believed then."""
        step = LOAD_RATE * min(max(time - self._time, 0.0), LONGEST_CYCLE)
        self._time = time
        away = self.believed(time) - self.mass
        self.mass += min(max(away, -step), step)
        return self.mass

    def believed(self, time: float) -> float:
        """Load [kg] at a time [s], as far as the estimate counts then."""
        told = self._told
        if told is None or told.condition not in BELIEVED:
            return 0.0
        if not abs(time - told.time) <= OLDEST_LOAD:
            return 0.0
        if not (0.0 < told.mass <= self._heaviest and 0.0 <= told.deviation < math.inf):
            return 0.0
        share = told.mass / math.hypot(told.mass, told.deviation)
        return told.mass * share**2


@njit(cache=True, error_model="numpy")
def cycle(
    setting: CycleSetting, memory: Memory, started: bool, dt: float, count: int,
    reading: SensorReading, wanted: Wanted, load: np.ndarray, u: np.ndarray,
) -> None:  # fmt: skip
    """Commands u (j,) of all joints; `load` (j,) generalized forces of the model ahead."""
    state, stop = memory.state, not started
    now, ahead = wanted.now, wanted.ahead
    for i in range(len(u)):
        known = reading.position[i] + now.position[i] + load[i]
        known += ahead.position[i] + ahead.velocity[i] + ahead.acceleration[i]
        if not math.isfinite(known) and state[i].condition < NOT_INITIALISED:
            state[i].condition = NOT_MEASURED
        stop |= state[i].condition >= NOT_INITIALISED
    for i in range(len(u)):
        if stop:
            _close(state[i], dt)
        else:
            _lead(i, setting, memory, dt, count, reading, wanted, load[i])
        u[i] = state[i].command


@njit(cache=True, error_model="numpy")
def _close(s: np.record, dt: float) -> None:
    s.command = math.copysign(max(abs(s.command) - STOP_RATE * dt, 0.0), s.command)
    s.opening = s.integral = s.bump = 0.0


@njit(cache=True, error_model="numpy")
def _lead(
    i: int, setting: CycleSetting, memory: Memory, dt: float, count: int,
    reading: SensorReading, wanted: Wanted, load: float,
) -> None:  # fmt: skip
    """A cycle of one joint; its command is left in its state."""
    h, gain, s = setting.hydraulics[i], setting.gains[i], memory.state[i]
    q, q_now, ahead = reading.position[i], wanted.now.position[i], wanted.ahead
    v_ahead, a_ahead = ahead.velocity[i], ahead.acceleration[i]
    moves = abs(v_ahead) > RESTING or abs(a_ahead) > RESTING
    length, lever = length_and_lever(setting.tables[i], ahead.position[i])
    force = load / lever
    if not s.begun:
        s.load, s.error = force, q_now - q
        memory.forces[i, :] = force
    rate = (force - s.load) / dt if dt > 0.0 else 0.0
    s.load = memory.forces[i, count % HISTORY] = force
    s.error += (q_now - q - s.error) * dt / (dt + SMOOTHED)

    lagging = max(h.lag / dt, 1.0) if dt > 0.0 else 1.0
    force_now = before(memory.forces[i], count, lagging)
    supply = reading.supply
    if not 0.5 < supply / h.supply_pressure < 2.0:  # or not measured
        supply = h.supply_pressure
    p_a, p_b = reading.pressure_a[i], reading.pressure_b[i]
    used = setting.fitted[i] and transducers_good(
        memory.watch[i], h.area_a, h.area_b, h.supply_pressure, p_a, p_b, force_now, moves, dt
    )
    k_a, k_b = stiffness(h, length)
    spool_now = before(memory.spools[i], count, lagging)
    piston = Piston(force_now, spool_now, supply, k_a, k_b, used)
    expected = look_back(i, setting, memory, piston, q, p_a, p_b, dt)
    news = answer(memory.watch[i], opened(spool_now, memory.learnt[i]), expected,
                  reading.velocity[i], dt)  # fmt: skip
    if news != NO_NEWS:
        s.condition = news
        _close(s, dt)
        return

    speed = v_ahead + a_ahead * (h.lag - setting.preview) + gain.kv * s.error + s.integral
    n = lever * speed + rate / (k_a + k_b)
    n += damping(
        setting, gain, h, s, piston, force, lever, speed, reading.velocity[i], p_a, p_b, dt
    )
    opening = n / speed_opened(h, memory.learnt[i], n > 0.0, piston, force, p_a, p_b)
    if not math.isfinite(opening):  # of readings beyond all reason
        s.condition = NOT_MEASURED
        _close(s, dt)
        return
    if not s.begun:
        s.opening = opened(h.sense * s.command, memory.learnt[i])
    if not s.begun or used != s.pressed:
        s.bump = s.opening - opening
    s.bump *= math.exp(-dt / BUMP)
    s.begun, s.pressed = True, used

    resting = s.condition == AT_REST
    if not moves and abs(q_now - q) <= gain.tolerance * (2.0 if resting else 1.0):
        s.condition = AT_REST
        _close(s, dt)
        memory.spools[i, count % HISTORY] = 0.0
        return
    s.opening = opening + s.bump
    _open(i, setting, memory, count, gain.ki * s.error * dt, wanted.largest)
    if s.condition == FOLLOWING and setting.fitted[i] and not used:
        s.condition = LOST


@njit(cache=True, error_model="numpy")
def _open(
    i: int, setting: CycleSetting, memory: Memory, count: int, integrand: float, largest: float
) -> None:
    """The command for the opening, across dead band and play; then the integral."""
    h, gain, s, learnt = setting.hydraulics[i], setting.gains[i], memory.state[i], memory.learnt[i]
    y = spool(s.opening, learnt[0 if s.opening > 0.0 else 1].dead_band)
    memory.spools[i, count % HISTORY] = min(max(y, -largest), largest)
    if h.play > 0.0:
        y, s.turned, s.direction = against_play(y, s.turned, s.direction, h.play)
    s.command = h.sense * min(max(y, -largest), largest)
    if abs(y) >= largest:
        s.condition = SATURATED
        return
    most = LARGEST_INTEGRAL * gain.largest_speed
    s.integral = min(max(s.integral + integrand, -most), most)
    s.condition = AT_BOUND if setting.adaptive and at_bound(learnt) else FOLLOWING


class FeedbackGains(NamedTuple):
    """Gains of j joints, (j,) each."""

    kv: np.ndarray  # 1/s
    ki: np.ndarray  # 1/s2
    kp: np.ndarray  # 1/s, dynamic pressure feedback
    kp_alone: np.ndarray  # 1/s, the same without pressures, of the flow that the model expects
    tolerance: np.ndarray  # rad, m: error that a crane at rest is left with
    largest_speed: np.ndarray  # rad/s, m/s


def feedback_gains(
    machine: Machine, model: Model, scale: float = 1.0, joints: Sequence[str] | None = None
) -> FeedbackGains:
    """Half of what is stable on the laboratory crane; times `scale`. Of all joints, or of `joints`.

    Joints that the model does not have, and whose load is unknown, get less.
    """
    joints = joints or machine.joint_names
    units = [machine.units[joint] for joint in joints]
    scales = scale * np.ones(len(units))
    known = np.array([joint in model.joints for joint in joints])
    return FeedbackGains(
        kv=np.where(known, [KV[unit] for unit in units], 3.0) * scales,
        ki=np.where(known, [KI[unit] for unit in units], 2.0) * scales,
        kp=8.0 * scales,
        kp_alone=np.where(known, 0.0, 6.0) * scales,
        tolerance=np.array([TOLERANCES[unit] for unit in units]),
        largest_speed=machine.ranges(joints).top_speed,
    )


class FlowFeedforward:
    """See the head of this file; `adaptive` learns dead bands and gain while the crane moves."""

    def __init__(
        self,
        machine: Machine,
        model: Model,
        hydraulics: ValvesAndOil,
        gains: FeedbackGains | None = None,
        pressures: bool = True,
        adaptive: bool = False,
        by_force: bool = False,
        joints: Sequence[str] | None = None,
    ):
        """Make a controller of all joints of the machine, or of `joints`, as are `hydraulics` and
        `gains`.

        `pressures`: whether to use those of the cylinders that have transducers; `by_force`: follow
        a force (computed force) and not the flow.
        """
        joints = tuple(joints or machine.joint_names)
        self.columns = np.array([machine.index(joint) for joint in joints])
        self.joints, self.adaptive = joints, adaptive
        self.by_model = np.isin(np.arange(len(machine.joint_names)), self.columns)
        self.preview = float(np.mean(hydraulics.lag))
        self._load = ReferenceLoad(model, machine)
        fitted = [pressures and machine.cylinders[joint].pressure_sensors for joint in joints]
        self.gains = records_of(gains or feedback_gains(machine, model, joints=joints))
        self._setting = CycleSetting(
            hydraulics.records(),
            self.gains,
            tables(machine)[self.columns],
            np.array(fitted),
            adaptive,
            by_force,
            self.preview,
        )
        self.memory = Memory(
            np.zeros(len(joints), STATE),
            np.zeros(len(joints), WATCH),
            as_identified(hydraulics.dead_band_extend, hydraulics.dead_band_retract),
            np.zeros(len(joints), WINDOW),
            *np.zeros((2, len(joints), HISTORY)),
        )
        self._count = 0
        self._started = False

    def start(self, command: np.ndarray) -> None:
        """Take over where `command` (j,) was in force, without a jump; what was learnt stays."""
        state = self.memory.state
        for array in self.memory:
            if array is not self.memory.learnt:
                array[...] = np.zeros((), array.dtype)
        state["command"], state["direction"] = command, 1.0
        state["p_a"] = state["p_b"] = np.nan
        self._count = 0
        self._started = True

    def command(self, dt: float, reading: SensorReading, wanted: Wanted) -> np.ndarray:
        """As `Controller` has it: of `columns` of the machine's joints, from all of them."""
        u = np.empty(len(self.memory.state))
        step = min(max(dt, 0.0), LONGEST_CYCLE)
        load = self._load(*wanted.ahead)[self.columns]
        q, v, p_a, p_b, supply = reading
        at = self.columns
        reading = SensorReading(q[at], v[at], p_a[at], p_b[at], supply)
        now, ahead = (Point(*(values[at] for values in point)) for point in wanted[:2])
        wanted = wanted._replace(now=now, ahead=ahead)
        cycle(
            self._setting, self.memory, self._started, step, self._count, reading, wanted, load, u
        )
        self._count += 1
        return u

    def carry(self, mass: float) -> None:
        """Expect a mass [kg] at the tip beside what the model has there, from the next cycle on."""
        self._load.at_tip = mass

    @property
    def conditions(self) -> tuple[ControlCondition, ...]:
        """Conditions of each joint, after the last command."""
        if not self._started:
            return (ControlCondition.NOT_INITIALISED,) * len(self.memory.state)
        return conditions(self.memory.state["condition"])
