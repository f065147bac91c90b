"""A cycle of the controllers that use the model, in compiled code: see `flow_feedforward`."""

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from crane_trajectory.control.adaptation import adapt, at_bound
from crane_trajectory.control.geometry import length_and_lever
from crane_trajectory.control.interface import ControlCondition, SensorReading, Wanted
from crane_trajectory.control.inverse_flow import (
    against_play,
    edges,
    flow_at_pressures,
    speed_under_load,
    spool,
    stiffness,
)
from crane_trajectory.control.watch import NO_NEWS, answer, transducers_good

DAMPED = 0.2  # s: slower pressure changes are the load's, faster ones the oil's swinging
BUMP = 0.2  # s, in which what a transition would make jump decays
SMOOTHED = 0.01  # s: steps of the encoders in the error
STOP_RATE = 5.0  # 1/s, at which the command of a controller that stops goes to zero
LARGEST_INTEGRAL = 0.2  # of the largest speed: what the integral may ask for
RESTING = 1e-6  # rad/s, rad/s2 or m: a reference that is slower rests
FORCE_GAIN = 20.0  # 1/s, of computed force: of the measured force towards the wanted one
FORCE_PER_SPEED = 0.02  # s: force that an error of the piston's speed asks for, over k_A + k_B
HISTORY = 64  # cycles of load and spool that are remembered

STATE = (
    "begun",  # whether the first cycle is over
    "condition",  # `ControlCondition`
    "command",
    "opening",  # last
    "bump",  # opening that is left of a transition
    "integral",  # rad/s, m/s
    "error",  # smoothed, rad, m
    "load",  # N, piston force ahead
    "pressed",  # whether the pressures are used
    "slow",  # N, slow part of what the measured force has more
    "p_a",  # Pa, last; NaN where not used
    "p_b",
    "stood",  # m, where the piston was
    "squeezed",  # m, by which the oil gives way more than the load of the model asks
    "turned",  # spool: the farthest since it turned, for its play
    "direction",  # of the spool
)
"""Fields of what a joint remembers from cycle to cycle."""

FOLLOWING, AT_REST = int(ControlCondition.FOLLOWING), int(ControlCondition.AT_REST)
AT_BOUND, LOST = int(ControlCondition.ADAPTATION_AT_BOUND), int(ControlCondition.PRESSURES_LOST)
SATURATED, UNMEASURED = int(ControlCondition.SATURATED), int(ControlCondition.NOT_MEASURED)
STOPS = int(ControlCondition.NOT_INITIALISED)


class CycleSetting(NamedTuple):
    """What does not change while the controller runs; j joints."""

    hydraulics: np.ndarray  # (j,) records
    gains: np.ndarray  # (j,) records of `FeedbackGains`
    tables: np.ndarray  # (j, KNOTS, 4) geometry
    fitted: np.ndarray  # (j,) bool: transducers to be used
    adaptive: bool
    by_force: bool
    preview: float  # s


class Memory(NamedTuple):
    """What changes."""

    state: np.ndarray  # (j,) records, fields STATE
    watch: np.ndarray  # (j,) records, fields WATCH
    learnt: np.ndarray  # (j, 2, 4, 3), see `adaptation`
    windows: np.ndarray  # (j, WINDOW_FIELDS)
    forces: np.ndarray  # (j, HISTORY) piston forces of the model [N]
    spools: np.ndarray  # (j, HISTORY)


class Piston(NamedTuple):
    """What a cycle knows of a cylinder."""

    force: float  # N, of the model, as it ought to be now
    spool: float  # that is in force now, as far as the lag of loop and valve is known
    supply: float  # Pa
    stiffness_a: float  # N/m, k_A
    stiffness_b: float
    used: bool  # whether the pressures are


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
    force_now = _before(memory.forces[i], count, lagging)
    supply = reading.supply
    if not 0.5 < supply / h.supply_pressure < 2.0:  # or not measured
        supply = h.supply_pressure
    p_a, p_b = reading.pressure_a[i], reading.pressure_b[i]
    used = setting.fitted[i] and transducers_good(
        memory.watch[i], h.area_a, h.area_b, h.supply_pressure, p_a, p_b, force_now, moves, dt
    )
    k_a, k_b = stiffness(h, length)
    spool_now = _before(memory.spools[i], count, lagging)
    piston = Piston(force_now, spool_now, supply, k_a, k_b, used)
    expected = _look_back(i, setting, memory, piston, q, p_a, p_b, dt)
    news = answer(memory.watch[i], _opened(spool_now, memory.learnt[i]), expected,
                  reading.velocity[i], dt)  # fmt: skip
    if news != NO_NEWS:
        s.condition = news
        _close(s, dt)
        return

    speed = v_ahead + a_ahead * (h.lag - setting.preview) + gain.kv * s.error + s.integral
    n = lever * speed + rate / (k_a + k_b)
    n += _damping(
        setting, gain, h, s, piston, force, lever, speed, reading.velocity[i], p_a, p_b, dt
    )
    opening = n / _yield(h, memory.learnt[i], n > 0.0, piston, force, p_a, p_b)
    if not math.isfinite(opening):  # of readings beyond all reason
        s.condition = UNMEASURED
        _close(s, dt)
        return
    if s.begun == 0.0:
        s.opening = _opened(h.sense * s.command, memory.learnt[i])
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
    _open(i, setting, memory, count, gain.ki * s.error * dt)
    if s.condition == FOLLOWING and setting.fitted[i] and not used:
        s.condition = LOST


@njit(cache=True, error_model="numpy")
def _before(history: np.ndarray, count: int, cycles: float) -> float:
    """What was noted `cycles` (whole ones and a share) before the one with the number `count`."""
    cycles = min(cycles, float(min(count, HISTORY - 2)))
    whole = int(cycles)
    newer = history[(count - whole) % HISTORY]
    older = history[(count - min(whole + 1, count)) % HISTORY]
    return newer + (cycles - whole) * (older - newer)


@njit(cache=True, error_model="numpy")
def _opened(y: float, learnt: np.ndarray) -> float:
    """How far a spool y is beyond its dead zone."""
    side = 0 if y > 0.0 else 1
    return math.copysign(max(abs(y) - learnt[side, 0, 0], 0.0), y)


@njit(cache=True, error_model="numpy")
def _yield(
    h: np.record,
    learnt: np.ndarray,
    extends: bool,
    piston: Piston,
    force: float,
    p_a: float,
    p_b: float,
) -> float:
    """g [m/s], the speed of the piston at an opening of 1, with what was learnt."""
    known = learnt[0 if extends else 1, 0]
    gain_a, gain_b = edges(h, extends)
    gain_a, gain_b = gain_a / known[1], gain_b / known[2]
    if not piston.used:
        return speed_under_load(h, extends, gain_a, gain_b, force, piston.supply)
    flow_a, flow_b = flow_at_pressures(h, extends, gain_a, gain_b, p_a, p_b, piston.supply)
    by_a = piston.stiffness_a * flow_a / h.area_a
    by_b = piston.stiffness_b * flow_b / h.area_b
    return (by_a + by_b) / (piston.stiffness_a + piston.stiffness_b)


@njit(cache=True, error_model="numpy")
def _look_back(
    i: int,
    setting: CycleSetting,
    memory: Memory,
    piston: Piston,
    q: float,
    p_a: float,
    p_b: float,
    dt: float,
) -> float:
    """Take in what the crane made of the spool that is in force: the joint's speed that it ought
    to have. Learns from what it has, and keeps what the oil seems to be squeezed by.
    """
    h, s, learnt, y = setting.hydraulics[i], memory.state[i], memory.learnt[i], piston.spool
    here, lever = length_and_lever(setting.tables[i], q)
    extends = y > 0.0
    way = here - s.stood if s.begun > 0.0 else 0.0
    piston_speed = _opened(y, learnt) * _yield(h, learnt, extends, piston, piston.force, p_a, p_b)
    if setting.adaptive and piston.used:
        gain_a, gain_b = edges(h, extends)
        flow_a, flow_b = flow_at_pressures(h, extends, gain_a, gain_b, p_a, p_b, piston.supply)
        leaked, forth = h.leakage * (p_a - p_b) * dt, 1.0 if extends else -1.0
        oil_a = h.area_a * (way + h.area_a * (p_a - s.p_a) / piston.stiffness_a) + leaked
        oil_b = h.area_b * (way - h.area_b * (p_b - s.p_b) / piston.stiffness_b) + leaked
        adapt(learnt, memory.windows[i], y, flow_a, flow_b, forth * oil_a, forth * oil_b, dt)
    s.p_a, s.p_b = (p_a, p_b) if piston.used else (math.nan, math.nan)
    s.stood = here
    s.squeezed = (s.squeezed + piston_speed * dt - way) * math.exp(-dt / DAMPED)
    return piston_speed / lever


@njit(cache=True, error_model="numpy")
def _damping(
    setting: CycleSetting,
    gain: np.record,
    h: np.record,
    s: np.record,
    piston: Piston,
    force: float,
    lever: float,
    speed: float,
    velocity: float,
    p_a: float,
    p_b: float,
    dt: float,
) -> float:
    """What n has more than reference, error and load ask for [m/s]: damping, leakage."""
    k_a, k_b = piston.stiffness_a, piston.stiffness_b
    if not piston.used:
        return -gain.kp_alone * s.squeezed
    misfit = h.area_a * p_a - h.area_b * p_b - piston.force
    if s.pressed == 0.0:
        s.slow = misfit
    s.slow += (misfit - s.slow) * min(dt / DAMPED, 1.0)
    leaked = h.leakage * (p_a - p_b) * (k_a / h.area_a + k_b / h.area_b) / (k_a + k_b)
    if setting.by_force and math.isfinite(velocity):
        late = lever * (speed - velocity)
        lacking = (force - piston.force - misfit) / (k_a + k_b) + FORCE_PER_SPEED * late
        return FORCE_GAIN * lacking - late + leaked
    return leaked - gain.kp * (misfit - s.slow) / (k_a + k_b)


@njit(cache=True, error_model="numpy")
def _open(i: int, setting: CycleSetting, memory: Memory, count: int, integrand: float) -> None:
    """The command for the opening, across dead zone and play; then the integral."""
    h, gain, s, learnt = setting.hydraulics[i], setting.gains[i], memory.state[i], memory.learnt[i]
    y = spool(s.opening, learnt[0 if s.opening > 0.0 else 1, 0, 0])
    memory.spools[i, count % HISTORY] = min(max(y, -1.0), 1.0)
    if h.play > 0.0:
        y, s.turned, s.direction = against_play(y, s.turned, s.direction, h.play)
    s.command = h.sense * min(max(y, -1.0), 1.0)
    if abs(y) >= 1.0:
        s.condition = SATURATED
        return
    most = LARGEST_INTEGRAL * gain.largest_speed
    s.integral = min(max(s.integral + integrand, -most), most)
    s.condition = AT_BOUND if setting.adaptive and at_bound(learnt) else FOLLOWING
