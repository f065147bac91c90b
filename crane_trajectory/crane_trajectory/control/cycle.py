"""A cycle of the controllers that use the model, in compiled code: see `flow_feedforward`."""

import math

import numpy as np
from numba import njit

from crane_trajectory.control.adaptation import at_bound
from crane_trajectory.control.geometry import length_and_lever
from crane_trajectory.control.interface import ControlCondition, SensorReading, Wanted
from crane_trajectory.control.inverse_flow import against_play, spool, stiffness
from crane_trajectory.control.memory import HISTORY, CycleSetting, Memory, before
from crane_trajectory.control.piston import Piston, damping, look_back, opened, speed_opened
from crane_trajectory.control.watch import NO_NEWS, answer, transducers_good

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
