"""`flow_feedforward`: the valve opening that the reference needs, by the inverse of its flow.

Per joint, with the error e = q_ref - q,

    v = v_ref(t + T) + kv e + ki Int(e),    n = dx/dq v + [F' - kp H(F_meas - F)] / (k_A + k_B)

F is the piston force of (16) along the reference, with the load at the tip where one is told
(`tip_load`), H a high-pass of `DAMPED` seconds. The opening is n / g (see `inverse_flow`), crossed
over the dead zone in the direction wanted. With chamber pressures g follows from them and H damps
the oil (dynamic pressure feedback); without, or where a transducer fails, g follows from F and kp
is zero. Where reference and crane rest, the valve is closed.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numba import njit

from crane_model.machine import Machine
from crane_model.model_file import Model
from crane_trajectory.control.adaptation import WINDOW_FIELDS, at_bound, begin
from crane_trajectory.control.interface import (
    ControlCondition,
    Point,
    SensorReading,
    Wanted,
    conditions,
)
from crane_trajectory.control.load import ReferenceLoad
from crane_trajectory.control.valves_and_oil import (
    HISTORY,
    NO_NEWS,
    STATE,
    WATCH,
    CycleSetting,
    Memory,
    Piston,
    ValvesAndOil,
    against_play,
    answer,
    before,
    damping,
    length_and_lever,
    look_back,
    opened,
    speed_opened,
    spool,
    stiffness,
    tables,
    transducers_good,
)

# A cycle of the controllers that use the model, in compiled code: see `flow_feedforward`.

BUMP = 0.2  # s, in which what a transition would make jump decays
SMOOTHED = 0.01  # s: steps of the encoders in the error
STOP_RATE = 5.0  # 1/s, at which the command of a controller that stops goes to zero
LARGEST_INTEGRAL = 0.2  # of the largest speed: what the integral may ask for
RESTING = 1e-6  # rad/s, rad/s2 or m: a reference that is slower rests

FOLLOWING, AT_REST = int(ControlCondition.FOLLOWING), int(ControlCondition.AT_REST)
AT_BOUND, LOST = int(ControlCondition.ADAPTATION_AT_BOUND), int(ControlCondition.PRESSURES_LOST)
SATURATED, UNMEASURED = int(ControlCondition.SATURATED), int(ControlCondition.NOT_MEASURED)
STOPS = int(ControlCondition.NOT_INITIALISED)


@njit(cache=True, error_model="numpy")
def cycle(
    setting: CycleSetting,
    memory: Memory,
    started: bool,
    dt: float,
    count: int,
    reading: SensorReading,
    wanted: Wanted,
    load: np.ndarray,
    u: np.ndarray,
) -> None:
    """Commands u (j,) of all joints; `load` (j,) generalized forces of the model ahead."""
    state, stop = memory.state, not started
    now, ahead = wanted.now, wanted.ahead
    for i in range(len(u)):
        known = reading.position[i] + now.position[i] + load[i]
        known += ahead.position[i] + ahead.velocity[i] + ahead.acceleration[i]
        if not math.isfinite(known) and state[i].condition < STOPS:
            state[i].condition = UNMEASURED
        stop |= state[i].condition >= STOPS
    for i in range(len(u)):
        if stop:
            _close(state[i], dt)
        else:
            _lead(i, setting, memory, dt, count, reading, wanted, load[i])
        u[i] = state[i].command


@njit(cache=True, error_model="numpy")
def _close(s: np.record, dt: float) -> None:
    """Lead the command towards zero."""
    s.command = math.copysign(max(abs(s.command) - STOP_RATE * dt, 0.0), s.command)
    s.opening = s.integral = s.bump = 0.0


@njit(cache=True, error_model="numpy")
def _lead(
    i: int,
    setting: CycleSetting,
    memory: Memory,
    dt: float,
    count: int,
    reading: SensorReading,
    wanted: Wanted,
    load: float,
) -> None:
    """A cycle of one joint; its command is left in its state."""
    h, gain, s = setting.hydraulics[i], setting.gains[i], memory.state[i]
    q, q_now, ahead = reading.position[i], wanted.now.position[i], wanted.ahead
    v_ahead, a_ahead = ahead.velocity[i], ahead.acceleration[i]
    moves = abs(v_ahead) > RESTING or abs(a_ahead) > RESTING
    length, lever = length_and_lever(setting.tables[i], ahead.position[i])
    force = load / lever
    if s.begun == 0.0:
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
        s.condition = UNMEASURED
        _close(s, dt)
        return
    if s.begun == 0.0:
        s.opening = opened(h.sense * s.command, memory.learnt[i])
    if s.begun == 0.0 or used != (s.pressed > 0.0):
        s.bump = s.opening - opening
    s.bump *= math.exp(-dt / BUMP)
    s.begun, s.pressed = 1.0, 1.0 if used else 0.0

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
    """The command for the opening, across dead zone and play; then the integral."""
    h, gain, s, learnt = setting.hydraulics[i], setting.gains[i], memory.state[i], memory.learnt[i]
    y = spool(s.opening, learnt[0 if s.opening > 0.0 else 1, 0, 0])
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


LARGEST_STEP = 0.05  # s; a longer gap counts as this
TOLERANCES = {"rad": 3e-4, "m": 5e-4}  # of a crane at rest
KV = {"rad": 4.5, "m": 5.5}  # 1/s; a telescope rides on its oil at 140 rad/s, the booms at 18 to 36
KI = {"rad": 10.0, "m": 15.0}  # 1/s2


class FeedbackGains(NamedTuple):
    """Gains of j joints, (j,) each."""

    kv: np.ndarray  # 1/s
    ki: np.ndarray  # 1/s2
    kp: np.ndarray  # 1/s, dynamic pressure feedback
    kp_alone: np.ndarray  # 1/s, the same without pressures, of the flow that the model expects
    tolerance: np.ndarray  # rad, m: error that a crane at rest is left with
    largest_speed: np.ndarray  # rad/s, m/s

    def records(self) -> np.ndarray:
        """(j,) records with these fields."""
        records = np.empty(len(self.kv), np.dtype([(name, float) for name in self._fields]))
        for name, column in zip(self._fields, self, strict=True):
            records[name] = column
        return records


def feedback_gains(
    machine: Machine, model: Model, scale: float = 1.0, joints: Sequence[str] | None = None
) -> FeedbackGains:
    """Half of what is stable on the laboratory crane; times `scale`. Of all joints, or of `joints`.

    Joints that the model does not have, and whose load is unknown, get less.
    """
    joints = joints or machine.joint_names
    limits = [machine.limits[joint] for joint in joints]
    one = scale * np.ones(len(limits))
    known = np.array([joint in model.joints for joint in joints])
    return FeedbackGains(
        kv=np.where(known, [KV[machine.units[joint]] for joint in joints], 3.0) * one,
        ki=np.where(known, [KI[machine.units[joint]] for joint in joints], 2.0) * one,
        kp=8.0 * one,
        kp_alone=np.where(known, 0.0, 6.0) * one,
        tolerance=np.array([TOLERANCES[machine.units[joint]] for joint in joints]),
        largest_speed=np.array([max(one.velocity_max, -one.velocity_min) for one in limits]),
    )


class FlowFeedforward:
    """See the head of this file; `adaptive` learns dead zones and gain while the crane moves."""

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
        """Of all joints of the machine, or of `joints` alone, as are `hydraulics` and `gains`.

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
        self.gains = (gains or feedback_gains(machine, model, joints=joints)).records()
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
            np.zeros(len(joints), np.dtype([(name, float) for name in STATE])),
            np.zeros(len(joints), np.dtype([(name, float) for name in WATCH])),
            begin(hydraulics.dead_zone_extend, hydraulics.dead_zone_retract),
            np.zeros((len(joints), WINDOW_FIELDS)),
            *np.zeros((2, len(joints), HISTORY)),
        )
        self._count = 0
        self._started = False

    def start(self, command: np.ndarray) -> None:
        """Take over where `command` (j,) was in force, without a jump; what was learnt stays."""
        state = self.memory.state
        for each in self.memory:
            if each is not self.memory.learnt:
                each[...] = np.zeros((), each.dtype)
        state["command"], state["direction"] = command, 1.0
        state["p_a"] = state["p_b"] = np.nan
        self._count = 0
        self._started = True

    def command(self, dt: float, reading: SensorReading, wanted: Wanted) -> np.ndarray:
        """As `Controller` has it: of `columns` of the machine's joints, from all of them."""
        u = np.empty(len(self.memory.state))
        step = min(max(dt, 0.0), LARGEST_STEP)
        load = self._load(*wanted.ahead)[self.columns]
        q, v, p_a, p_b, supply = reading
        at = self.columns
        reading = SensorReading(q[at], v[at], p_a[at], p_b[at], supply)
        now, ahead = (Point(*(each[at] for each in one)) for one in wanted[:2])
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
        """Of each joint, after the last command."""
        if not self._started:
            return (ControlCondition.NOT_INITIALISED,) * len(self.memory.state)
        return conditions(self.memory.state["condition"])
