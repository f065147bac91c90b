"""Valves, oil and cylinders of all joints as records for compiled controllers, and what is learnt.

A chamber of volume V, area A takes the flow K o sqrt(drop) at an opening o. With k = beta A^2 / V,
the stiffness of its oil, the force F = A_A p_A - A_B p_B follows

    F' = k_A Q_A / A_A + k_B Q_B / A_B - (k_A + k_B) x'

so that the piston speed x' and the force rate F' need the opening o = n / g, with

    n = x' + F' / (k_A + k_B),    g = [k_A Q_A / A_A + k_B Q_B / A_B] / (k_A + k_B) at o = 1

Q_B what leaves B. If the pressures are not measured, g follows from the load: flow through both
edges at the same piston speed.

Dead bands and gains are learnt while the crane moves, for each direction by itself. While a joint
moves one way with an open valve, its two edges pass, over a window,

    y = d + c_A o_A,    y = d + c_B o_B

y the mean spool, o what either edge must have been open for the oil that its chamber took or gave
(what the piston swept, what the pressure squeezed, what leaked) if the gains of the model held; d
is the dead band, c_A and c_B correct the gains: K / c. The three are estimated by recursive least
squares that forget within `MEMORY_TIME`, only where a window tells something, and within bounds.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numba import njit

from crane_model.errors import ConfigurationError
from crane_model.hydraulics import HydraulicValues
from crane_model.machine import Machine
from crane_trajectory.control.controller import ControlCondition

KNOTS = 513  # cubic between knots: errors below 1e-9 m over the ranges of Table 2
MOTOR_TURN = 2.0 * np.pi  # rad, of the shaft of a motor
LEAST_DROP = 2.0e5  # Pa at an edge, of that which is inverted: below it speed is not to be had
OPENING_AT_EDGE = 0.002  # the command crosses the dead band within +- this opening

LEARNING_WINDOW = 0.1  # s
MEMORY_TIME = 20.0  # s of windows that were used
LEAST_OPENING = 0.02  # in a window: dead band and gains must show in it
LARGEST_OPENING_CHANGE = 0.5  # within a window: lags matter where it changes fast
OPENING_NOISE = 0.003  # standard deviation of y - d - c o in a window
DEAD_BAND_UNKNOWN, GAIN_UNKNOWN = 0.02, 0.3  # standard deviations at the beginning
DEAD_BAND_BOUNDS = (0.0, 0.3)
GAIN_BOUNDS = (0.3, 3.0)

STUCK_TIME = 0.2  # s without any change of a reading while the joint moves
USED_AGAIN = 1.0  # s after which pressures that were lost are used again
LOWEST_PRESSURE = -5.0e5  # Pa, gauge: less there is not
LARGEST_PRESSURE_STEP = 8.0e6  # Pa from cycle to cycle
LARGEST_PRESSURE_SHARE = 2.0  # of the supply pressure, in a chamber
LARGEST_MISFIT = 0.5  # of the largest force: measured against that of the model
OPEN = 0.05  # opening at which a joint surely moves
SILENT_TIME = 0.5  # s without an answer
ASTRAY_TIME = 0.3  # s in which a joint moves the wrong way
NO_NEWS = int(ControlCondition.FOLLOWING)
SILENT, WRONG = int(ControlCondition.NO_ANSWER), int(ControlCondition.WRONG_MODEL)

HISTORY = 64  # cycles of load and spool that are remembered
DAMPED = 0.2  # s: slower pressure changes are the load's, faster ones the oil's swinging
FORCE_GAIN = 20.0  # 1/s, of computed force: of the measured force towards the wanted one
FORCE_PER_SPEED = 0.02  # s: force that an error of the piston's speed asks for, over k_A + k_B

LEARNT = np.dtype(
    [
        ("dead_band", float),  # d
        ("gain", float, 2),  # c_A, c_B
        ("covariance", float, (3, 3)),  # of d, c_A, c_B
    ]
)
"""Learnt values of a joint and a direction."""
WINDOW = np.dtype(
    [
        ("time", float),  # s
        ("passed", float, 2),  # m3, integrals of the flow through A and B at an opening of 1
        ("spool", float, 2),  # m3, the same times the spool
        ("oil", float, 2),  # m3 through either edge
        ("least", float),  # spool
        ("largest", float),
    ]
)
"""The open window of a joint, of which dead band and gains are learnt."""
WATCH = np.dtype(
    [
        ("last_a", float),  # Pa, last readings
        ("last_b", float),
        ("same_a", float),  # s for which they have not changed
        ("same_b", float),
        ("bad", float),  # s for which pressures stay unused
        ("silent", float),  # s for which the joint has not answered
        ("astray", float),  # s for which it has moved the wrong way
    ]
)
"""Signs of faulty transducers of a joint, or of a valve that does not answer."""
STATE = np.dtype(
    [
        ("begun", bool),  # whether the first cycle is over
        ("condition", np.int64),  # `ControlCondition`
        ("command", float),
        ("opening", float),  # last
        ("bump", float),  # opening that is left of a transition
        ("integral", float),  # rad/s, m/s
        ("error", float),  # smoothed, rad, m
        ("load", float),  # N, piston force ahead
        ("pressed", bool),  # whether the pressures are used
        ("slow", float),  # N, slow part of what the measured force has more
        ("p_a", float),  # Pa, last; NaN where not used
        ("p_b", float),
        ("stood", float),  # m, where the piston was
        ("squeezed", float),  # m, by which the oil gives way more than the load of the model asks
        ("turned", float),  # spool: the farthest since it turned, for its play
        ("direction", float),  # of the spool
    ]
)
"""State of a joint from cycle to cycle."""


class ValvesAndOil(NamedTuple):
    """Valves and oil of j joints, (j,) each [SI].

    The spool y, in the direction of extending, trails its command by `lag` and `play`. It opens
    beyond the dead bands; what it is beyond, o, is the opening. Each edge passes gain times o times
    the root of the pressure drop.
    """

    sense: np.ndarray  # +1 where extending moves the joint up, else -1
    area_a: np.ndarray  # m2
    area_b: np.ndarray
    length_min: np.ndarray  # m, where the piston of chamber A ends
    length_max: np.ndarray
    dead_volume_a: np.ndarray  # m3, with hose
    dead_volume_b: np.ndarray
    bulk_modulus: np.ndarray  # Pa
    leakage: np.ndarray  # m3/s/Pa past the piston
    supply_a: np.ndarray  # m3/s/sqrt(Pa) at an opening of 1: gains of the four edges
    a_tank: np.ndarray
    supply_b: np.ndarray
    b_tank: np.ndarray
    dead_band_extend: np.ndarray  # of the command
    dead_band_retract: np.ndarray
    play: np.ndarray  # width, of the command
    lag: np.ndarray  # s, from a reading to the spool's answer
    supply_pressure: np.ndarray  # Pa, where none is measured
    tank_pressure: np.ndarray

    def records(self) -> np.ndarray:
        """(j,) records with these fields; `ConfigurationError` where a value cannot be."""
        records = records_of(self)
        for name in self._fields:
            bad = ~np.isfinite(records[name])
            if name not in MAY_BE_ZERO:
                bad |= records[name] <= 0.0
            elif name not in SIGNED:
                bad |= records[name] < 0.0
            if bad.any():
                place = int(np.argmax(bad))
                raise ConfigurationError(
                    f"hydraulics: {name} of joint {place} is {records[name][place]:.6g}; "
                    "identify the hydraulics of this machine again"
                )
        return records


SIGNED = {"sense", "length_min", "length_max"}
MAY_BE_ZERO = SIGNED | {
    "dead_volume_a", "dead_volume_b", "leakage", "dead_band_extend", "dead_band_retract",
    "play", "lag", "tank_pressure",
}  # fmt: skip


def records_of(columns: NamedTuple) -> np.ndarray:
    """(j,) records of a tuple of columns (j,), for compiled loops."""
    names = type(columns)._fields
    records = np.empty(len(columns[0]), np.dtype([(name, float) for name in names]))
    for name, column in zip(names, columns, strict=True):
        records[name] = column
    return records


def identified(machine: Machine, values: HydraulicValues, joints: Sequence[str]) -> ValvesAndOil:
    """Values of some joints, from the identified machine.

    A joint without chamber values has the mean oil of those with some, and dead volumes of a
    twentieth of its chambers, or of the displacement of a motor. `ConfigurationError` if no joint
    has any.
    """
    known_of = {
        joint: {name: value.value for name, value in values.joints[joint].values.items()}
        for joint in values.joints
    }
    oil = [known["bulk_modulus"] for known in known_of.values() if "bulk_modulus" in known]
    if not oil:
        raise ConfigurationError(
            f"{machine.name}: the bulk modulus of the oil is unknown; identify the hydraulics "
            "from a recording with chamber pressures"
        )
    supply = machine.hydraulics
    pressure = values.supply.pressure.value if values.supply else supply.supply_pressure
    rows = []
    for joint in joints:
        known, actuator, limits = known_of[joint], machine.cylinders[joint], machine.limits[joint]
        middle = np.array([limits.middle])
        chambers = actuator.chambers
        stroke = chambers.empty_b - chambers.empty_a or MOTOR_TURN
        row = {
            "sense": float(np.sign(machine.cylinder(joint, middle)[0, 1])),
            "area_a": actuator.area_a,
            "area_b": actuator.area_b,
            "length_min": chambers.empty_a,
            "length_max": chambers.empty_b,
            "dead_volume_a": known.get("dead_volume_a", actuator.area_a * stroke / 20.0),
            "dead_volume_b": known.get("dead_volume_b", actuator.area_b * stroke / 20.0),
            "bulk_modulus": known.get("bulk_modulus", float(np.mean(oil))),
            "leakage": known.get("leakage", 0.0),
            **{edge: known[edge] for edge in ("supply_a", "a_tank", "supply_b", "b_tank")},
            "dead_band_extend": known["dead_band_a"],
            "dead_band_retract": known["dead_band_b"],
            "play": known["hysteresis"],
            "lag": known["lag"],
            "supply_pressure": pressure,
            "tank_pressure": supply.tank_pressure,
        }
        rows.append([row[name] for name in ValvesAndOil._fields])
    return ValvesAndOil(*np.array(rows).T)


def tables(machine: Machine) -> np.ndarray:
    """(j, KNOTS, 4): q, length x [m], dx/dq, d2x/dq2 of each joint over its range."""
    rows = []
    for joint in machine.joint_names:
        limits = machine.limits[joint]
        q = np.linspace(limits.position_min, limits.position_max, KNOTS)
        rows.append(np.column_stack([q, machine.cylinder(joint, q)]))
    return np.array(rows)


@njit(cache=True, error_model="numpy")
def length_and_lever(table: np.ndarray, q: float) -> tuple[float, float]:
    """x [m] and dx/dq at q, from the rows (KNOTS, 4) of a joint; beyond them on a straight line."""
    step = table[1, 0] - table[0, 0]
    place = (q - table[0, 0]) / step
    if not 0.0 <= place <= len(table) - 1.0:
        end = 0 if place < 0.0 else len(table) - 1
        return table[end, 1] + table[end, 2] * (q - table[end, 0]), table[end, 2]
    k = min(int(place), len(table) - 2)
    s = place - k
    return (
        _hermite(s, table[k, 1], step * table[k, 2], table[k + 1, 1], step * table[k + 1, 2]),
        _hermite(s, table[k, 2], step * table[k, 3], table[k + 1, 2], step * table[k + 1, 3]),
    )


@njit(cache=True, error_model="numpy")
def _hermite(s: float, y0: float, d0: float, y1: float, d1: float) -> float:
    """The cubic on 0..1 with values y and slopes d at its ends."""
    rise = y1 - y0
    return y0 + s * (d0 + s * (3.0 * rise - 2.0 * d0 - d1 + s * (d0 + d1 - 2.0 * rise)))


@njit(cache=True, error_model="numpy")
def stiffness(hydraulics: np.record, length: float) -> tuple[float, float]:
    """k_A, k_B [N/m] of the oil at a cylinder length [m]."""
    a, b = hydraulics.area_a, hydraulics.area_b
    low, high = hydraulics.length_min, hydraulics.length_max
    x = min(max(length, low), high)
    margin = 1e-3 * (high - low)  # a dead volume may be zero
    return (
        hydraulics.bulk_modulus * a * a / (hydraulics.dead_volume_a + a * (x - low + margin)),
        hydraulics.bulk_modulus * b * b / (hydraulics.dead_volume_b + b * (high - x + margin)),
    )


@njit(cache=True, error_model="numpy")
def edges(hydraulics: np.record, extending: bool) -> tuple[float, float]:
    """Gains of the edges at chamber A and B that are open."""
    if extending:
        return hydraulics.supply_a, hydraulics.b_tank
    return hydraulics.a_tank, hydraulics.supply_b


@njit(cache=True, error_model="numpy")
def speed_under_load(
    hydraulics: np.record, extending: bool, gain_a: float, gain_b: float, load: float, supply: float
) -> float:
    """g [m/s] from the force on the piston [N]: both edges pass what the piston sweeps."""
    a, b, tank = hydraulics.area_a, hydraulics.area_b, hydraulics.tank_pressure
    drop = a * supply - b * tank - load if extending else load + b * supply - a * tank
    resistance = a**3 / gain_a**2 + b**3 / gain_b**2
    return math.sqrt(max(drop, (a + b) * LEAST_DROP) / resistance)


@njit(cache=True, error_model="numpy")
def speed_at_margin(
    hydraulics: np.record, extending: bool, gain_a: float, gain_b: float, load: float, drop: float
) -> float:
    """g [m/s] with load sensing, which keeps `drop` [Pa] at the edge that feeds.

    A load [N] that drives the piston faster empties the fed chamber to tank pressure. The edge that
    returns then holds the load.
    """
    a, b, tank = hydraulics.area_a, hydraulics.area_b, hydraulics.tank_pressure
    fed, left = (a, b) if extending else (b, a)
    gain_fed, gain_left = (gain_a, gain_b) if extending else (gain_b, gain_a)
    drives = -load if extending else load
    held = max((drives + fed * tank) / left - tank, 0.0)  # Pa, at the edge that returns
    return max(gain_fed * math.sqrt(drop) / fed, gain_left * math.sqrt(held) / left)


@njit(cache=True, error_model="numpy")
def flow_at_pressures(
    hydraulics: np.record, extending: bool, gain_a: float, gain_b: float, pressure_a: float,
    pressure_b: float, supply: float,
) -> tuple[float, float]:  # fmt: skip
    """Q_A, Q_B [m3/s] at an opening of 1, positive in the direction of the motion."""
    tank = hydraulics.tank_pressure
    drop_a = supply - pressure_a if extending else pressure_a - tank
    drop_b = pressure_b - tank if extending else supply - pressure_b
    root_a, root_b = math.sqrt(max(drop_a, LEAST_DROP)), math.sqrt(max(drop_b, LEAST_DROP))
    return gain_a * root_a, gain_b * root_b


@njit(cache=True, error_model="numpy")
def spool(opening: float, dead_band: float) -> float:
    """The spool that is `opening` beyond its dead band."""
    crossing = min(max(opening / OPENING_AT_EDGE, -1.0), 1.0)
    return dead_band * crossing + opening


@njit(cache=True, error_model="numpy")
def against_play(
    y: float, turned: float, direction: float, play: float
) -> tuple[float, float, float]:
    """The command whose spool is y in spite of its play: half the width ahead, in its direction.

    `turned` is the farthest that y has been in its direction: when it comes back by more than a
    quarter of the play it has turned. Returns command, farthest point and direction.
    """
    if direction * (y - turned) >= 0.0:
        turned = y
    elif abs(y - turned) > 0.25 * play:
        direction, turned = -direction, y
    return y + 0.5 * play * direction, turned, direction


def as_identified(dead_band_extend: np.ndarray, dead_band_retract: np.ndarray) -> np.ndarray:
    """(j, 2) records LEARNT of the model, extending and retracting."""
    learnt = np.zeros((len(dead_band_extend), 2), LEARNT)
    learnt["dead_band"] = np.stack([dead_band_extend, dead_band_retract], axis=1)
    learnt["gain"] = 1.0 - learnt["dead_band"][:, :, np.newaxis]
    learnt["covariance"] = np.diag([DEAD_BAND_UNKNOWN, GAIN_UNKNOWN, GAIN_UNKNOWN]) ** 2
    return learnt


@njit(cache=True, error_model="numpy")
def adapt(
    learnt: np.ndarray, windows: np.ndarray, i: int, spool: float, passes: tuple[float, float],
    oil: tuple[float, float], dt: float,
) -> None:  # fmt: skip
    """A cycle of joint i: `learnt` (2,), its window among `windows` (j,), the spool in force.

    `passes` [m3/s] is the flow through the edges at an opening of 1 by the model, `oil` [m3] what
    passed in the last cycle, both positive in the direction of the spool.
    """
    window = windows[i]
    side, size = (0, spool) if spool > 0.0 else (1, -spool)
    dead_band, gain = learnt[side].dead_band, learnt[side].gain[0]
    open_enough = size - dead_band > LEAST_OPENING * gain and size < 1.0
    turned = window.largest * spool < 0.0
    finite = math.isfinite(passes[0] + passes[1] + oil[0] + oil[1])
    if not open_enough or turned or not finite:
        _empty(window)
        return
    if window.time == 0.0:
        window.least = window.largest = spool
    window.time += dt
    for edge in range(2):
        window.passed[edge] += dt * passes[edge]
        window.spool[edge] += dt * passes[edge] * size
        window.oil[edge] += oil[edge]
    window.least = min(window.least, spool)
    window.largest = max(window.largest, spool)
    if window.time < LEARNING_WINDOW:
        return
    if window.largest - window.least < LARGEST_OPENING_CHANGE * (size - dead_band):
        _forget(learnt, side, window.time)
        for edge in range(2):
            y = window.spool[edge] / window.passed[edge]
            _update(learnt, side, y, window.oil[edge] / window.passed[edge], edge)
    _empty(window)


@njit(cache=True, error_model="numpy")
def _empty(window: np.record) -> None:
    window.time = window.least = window.largest = 0.0
    for edge in range(2):
        window.passed[edge] = window.spool[edge] = window.oil[edge] = 0.0


@njit(cache=True, error_model="numpy")
def _forget(learnt: np.ndarray, side: int, time: float) -> None:
    """Grow the covariance, but never beyond that of the beginning."""
    growth, covariance = math.exp(time / MEMORY_TIME), learnt[side].covariance
    sure = growth * max(covariance[1, 1], covariance[2, 2]) < GAIN_UNKNOWN**2
    if sure and growth * covariance[0, 0] < DEAD_BAND_UNKNOWN**2:
        for k in range(3):
            for m in range(3):
                covariance[k, m] *= growth


@njit(cache=True, error_model="numpy")
def _update(learnt: np.ndarray, side: int, y: float, opening: float, edge: int) -> None:
    """Recursive least squares of y = d + c o, c that of the edge 0 (A) or 1 (B)."""
    if not opening > 0.0:
        return
    values, covariance = learnt[side], learnt[side].covariance
    s = np.empty(3)
    for k in range(3):
        s[k] = covariance[k, 0] + opening * covariance[k, 1 + edge]
    scale = OPENING_NOISE * OPENING_NOISE + s[0] + opening * s[1 + edge]
    miss = y - values.dead_band - opening * values.gain[edge]
    low, high = DEAD_BAND_BOUNDS
    values.dead_band = min(max(values.dead_band + s[0] / scale * miss, low), high)
    low, high = GAIN_BOUNDS
    for k in range(2):
        values.gain[k] = min(max(values.gain[k] + s[1 + k] / scale * miss, low), high)
    for k in range(3):
        for m in range(3):
            covariance[k, m] -= s[k] * s[m] / scale


@njit(cache=True, error_model="numpy")
def at_bound(learnt: np.ndarray) -> bool:
    """Return whether a learnt value (2,) lies at its bound; a dead band of 0 does not."""
    for side in range(2):
        if learnt[side].dead_band >= DEAD_BAND_BOUNDS[1]:
            return True
        for edge in range(2):
            if not GAIN_BOUNDS[0] < learnt[side].gain[edge] < GAIN_BOUNDS[1]:
                return True
    return False


@njit(cache=True, error_model="numpy")
def transducers_good(
    watch: np.record, area_a: float, area_b: float, supply: float, pressure_a: float,
    pressure_b: float, load: float, moving: bool, dt: float,
) -> bool:  # fmt: skip
    """Return whether two readings [Pa] are finite, plausible, alive; `load` [N] of the model."""
    good = math.isfinite(pressure_a + pressure_b)
    if good:
        known = watch.last_a != 0.0 or watch.last_b != 0.0
        for p, last in ((pressure_a, watch.last_a), (pressure_b, watch.last_b)):
            good &= LOWEST_PRESSURE <= p <= LARGEST_PRESSURE_SHARE * supply
            good &= not known or abs(p - last) <= LARGEST_PRESSURE_STEP
        misfit = area_a * pressure_a - area_b * pressure_b - load
        good &= abs(misfit) <= LARGEST_MISFIT * area_a * supply
        same_a, same_b = pressure_a == watch.last_a, pressure_b == watch.last_b
        watch.same_a = watch.same_a + dt if same_a and moving else 0.0
        watch.same_b = watch.same_b + dt if same_b and moving else 0.0
        good &= max(watch.same_a, watch.same_b) < STUCK_TIME
        watch.last_a, watch.last_b = pressure_a, pressure_b
    watch.bad = max(watch.bad - dt, 0.0) if good else USED_AGAIN
    return watch.bad == 0.0


@njit(cache=True, error_model="numpy")
def answer(watch: np.record, opening: float, expected: float, velocity: float, dt: float) -> int:
    """`NO_NEWS`, or what is wrong with a joint: `expected` is its speed at the opening."""
    opened = abs(opening) > OPEN and math.isfinite(velocity)
    silent = opened and abs(velocity) < 0.1 * abs(expected)
    astray = opened and velocity * expected < 0.0 and abs(velocity) > 0.25 * abs(expected)
    watch.silent = watch.silent + dt if silent else 0.0
    watch.astray = watch.astray + dt if astray else 0.0
    if watch.astray > ASTRAY_TIME:
        return WRONG
    return SILENT if watch.silent > SILENT_TIME else NO_NEWS


class CycleSetting(NamedTuple):
    """Constants of a running controller; j joints."""

    hydraulics: np.ndarray  # (j,) records of `ValvesAndOil`
    gains: np.ndarray  # (j,) records of `FeedbackGains`
    tables: np.ndarray  # (j, KNOTS, 4) geometry
    fitted: np.ndarray  # (j,) bool: transducers to be used
    adaptive: bool
    by_force: bool
    preview: float  # s


class Memory(NamedTuple):
    """Variables that change from cycle to cycle."""

    state: np.ndarray  # (j,) records STATE
    watch: np.ndarray  # (j,) records WATCH
    learnt: np.ndarray  # (j, 2) records LEARNT
    windows: np.ndarray  # (j,) records WINDOW
    forces: np.ndarray  # (j, HISTORY) piston forces of the model [N]
    spools: np.ndarray  # (j, HISTORY)


@njit(cache=True, error_model="numpy")
def before(history: np.ndarray, count: int, cycles: float) -> float:
    """Note from `cycles` (whole ones and a share) before the one with the number `count`."""
    cycles = min(cycles, float(min(count, HISTORY - 2)))
    whole = int(cycles)
    newer = history[(count - whole) % HISTORY]
    older = history[(count - min(whole + 1, count)) % HISTORY]
    return newer + (cycles - whole) * (older - newer)


class Piston(NamedTuple):
    """Values of a cylinder in a cycle."""

    force: float  # N, of the model, as it ought to be now
    spool: float  # that is in force now, as far as the lag of loop and valve is known
    supply: float  # Pa
    stiffness_a: float  # N/m, k_A
    stiffness_b: float
    used: bool  # whether the pressures are


@njit(cache=True, error_model="numpy")
def opened(y: float, learnt: np.ndarray) -> float:
    """How far a spool y is beyond its dead band."""
    side = 0 if y > 0.0 else 1
    return math.copysign(max(abs(y) - learnt[side].dead_band, 0.0), y)


@njit(cache=True, error_model="numpy")
def speed_opened(
    h: np.record, learnt: np.ndarray, extends: bool, piston: Piston, force: float, p_a: float,
    p_b: float,
) -> float:  # fmt: skip
    """g [m/s], the speed of the piston at an opening of 1, with what was learnt."""
    known = learnt[0 if extends else 1]
    gain_a, gain_b = edges(h, extends)
    gain_a, gain_b = gain_a / known.gain[0], gain_b / known.gain[1]
    if not piston.used:
        return speed_under_load(h, extends, gain_a, gain_b, force, piston.supply)
    flow_a, flow_b = flow_at_pressures(h, extends, gain_a, gain_b, p_a, p_b, piston.supply)
    by_a = piston.stiffness_a * flow_a / h.area_a
    by_b = piston.stiffness_b * flow_b / h.area_b
    return (by_a + by_b) / (piston.stiffness_a + piston.stiffness_b)


@njit(cache=True, error_model="numpy")
def look_back(
    i: int, setting: CycleSetting, memory: Memory, piston: Piston, q: float, p_a: float,
    p_b: float, dt: float,
) -> float:  # fmt: skip
    """Take in what the crane made of the spool that is in force: the joint's speed that it ought
    to have. Learns from what it has, and keeps what the oil seems to be squeezed by.
    """
    h, s, learnt, y = setting.hydraulics[i], memory.state[i], memory.learnt[i], piston.spool
    here, lever = length_and_lever(setting.tables[i], q)
    extends = y > 0.0
    swept = here - s.stood if s.begun else 0.0
    piston_speed = opened(y, learnt) * speed_opened(
        h, learnt, extends, piston, piston.force, p_a, p_b
    )
    if setting.adaptive and piston.used:
        gain_a, gain_b = edges(h, extends)
        flows = flow_at_pressures(h, extends, gain_a, gain_b, p_a, p_b, piston.supply)
        leaked, forth = h.leakage * (p_a - p_b) * dt, 1.0 if extends else -1.0
        oil_a = h.area_a * (swept + h.area_a * (p_a - s.p_a) / piston.stiffness_a) + leaked
        oil_b = h.area_b * (swept - h.area_b * (p_b - s.p_b) / piston.stiffness_b) + leaked
        adapt(learnt, memory.windows, i, y, flows, (forth * oil_a, forth * oil_b), dt)
    s.p_a, s.p_b = (p_a, p_b) if piston.used else (math.nan, math.nan)
    s.stood = here
    s.squeezed = (s.squeezed + piston_speed * dt - swept) * math.exp(-dt / DAMPED)
    return piston_speed / lever


@njit(cache=True, error_model="numpy")
def damping(
    setting: CycleSetting, gain: np.record, h: np.record, s: np.record, piston: Piston,
    force: float, lever: float, speed: float, velocity: float, p_a: float, p_b: float, dt: float,
) -> float:  # fmt: skip
    """Speed [m/s] in n beyond reference, error and load: damping, leakage."""
    k_a, k_b = piston.stiffness_a, piston.stiffness_b
    if not piston.used:
        return -gain.kp_alone * s.squeezed
    misfit = h.area_a * p_a - h.area_b * p_b - piston.force
    if not s.pressed:
        s.slow = misfit
    s.slow += (misfit - s.slow) * min(dt / DAMPED, 1.0)
    leaked = h.leakage * (p_a - p_b) * (k_a / h.area_a + k_b / h.area_b) / (k_a + k_b)
    if setting.by_force and math.isfinite(velocity):
        late = lever * (speed - velocity)
        lacking = (force - piston.force - misfit) / (k_a + k_b) + FORCE_PER_SPEED * late
        return FORCE_GAIN * lacking - late + leaked
    return leaked - gain.kp * (misfit - s.slow) / (k_a + k_b)
