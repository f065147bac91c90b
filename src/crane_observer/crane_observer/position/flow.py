"""Flow into the chambers over a window of some samples, in compiled code.

Commands are followed through the valves as in `crane_model.hydraulics.stepping`; the flow through
the metering edges is that at the measured pressures. Sums of a window do not depend on the pose.
"""

import math
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from crane_model.array import Array, Flags
from crane_model.cylinders import lever_arm
from crane_model.errors import ConfigurationError
from crane_model.hydraulics import (
    ChamberValues,
    HydraulicValues,
    JointHydraulics,
    Measured,
    ValveValues,
)
from crane_model.hydraulics.simulation import circuit_of, identified
from crane_model.hydraulics.stepping import Circuit, chamber_flows, opening, transition
from crane_model.machine import Machine
from crane_model.model_file import Model

MOST_BY_WEIGHT = 1  # joints without encoder, whose positions the weight of all discriminates


@dataclass(frozen=True)
class AssumedValve:
    """A valve that nobody identified: plausible values, and how far valves differ from them.

    A valve command says which way a joint moves, and roughly how fast; the position must come from
    its weight. With an encoder, or by its weight, the valve is learnt while the crane works.
    """

    oversized: float = 3.0  # speed at full opening over the fastest that the joint may move
    gain_doubt: float = 0.8  # of the flow, one standard deviation
    gain_stays: float = 3.0  # s: at other openings it is another one
    load_drift: float = 0.05  # 1/sqrt(s), of an unknown load
    null_doubt: float = 0.03  # of the stroke
    stroke_doubt: float = 0.1  # of the stroke of a window, beside these
    dead_band: float = 0.05  # of the stroke
    lag: float = 0.05  # s
    natural_frequency: float = 60.0  # rad/s
    damping_ratio: float = 1.0
    bulk_modulus: float = 1.2e9  # Pa
    dead_volume: float = 0.05  # of what a piston sweeps


ASSUMED_VALVE = AssumedValve()


class Served(NamedTuple):
    """A model whose valves are all known or assumed."""

    model: Model
    assumed: Flags  # (j,) whose valve is not identified

    @classmethod
    def of(cls, model: Model) -> "Served":
        """Raise `ConfigurationError` if there is no machine, or no transducers at a chamber."""
        if model.machine is None:
            raise ConfigurationError(
                f"model '{model.name}' names no machine file, which has levers and areas of its "
                "cylinders; identify it with one"
            )
        known = model.hydraulics or HydraulicValues(provenance="assumed", joints={})
        joints, assumed = dict(known.joints), np.zeros(len(model.joints), dtype=bool)
        for j, joint in enumerate(model.joints):
            values = joints.get(joint)
            if values is None or values.chambers is None:
                assumed[j], joints[joint] = True, _assumed(model.machine, joint)
        return cls(replace(model, hydraulics=known.model_copy(update={"joints": joints})), assumed)


def _assumed(machine: Machine, joint: str) -> JointHydraulics:
    limits, cylinder = machine.limits[joint], machine.cylinders.get(joint)
    if cylinder is None or not cylinder.pressure_sensors:
        raise ConfigurationError(
            f"{joint}: it has no chambers with pressure transducers (pressure_sensors in the "
            "machine file), by which its weight could tell where it is; leave it out of the model"
        )
    valve, chambers = ASSUMED_VALVE, cylinder.chambers
    q = np.linspace(limits.position_min, limits.position_max, 21)
    lever = float(np.median(np.abs(lever_arm(machine, joint, q))))
    fastest = valve.oversized * lever * limits.slower_speed
    area = (cylinder.area_a + cylinder.area_b) / 2.0
    gain = fastest * area / np.sqrt(machine.hydraulics.supply_pressure / 2.0)
    swept = chambers.empty_b - chambers.empty_a
    values = {
        "dead_band_a": valve.dead_band, "dead_band_b": valve.dead_band, "hysteresis": 0.0,
        "lag": valve.lag, "natural_frequency": valve.natural_frequency,
        "damping_ratio": valve.damping_ratio, "bulk_modulus": valve.bulk_modulus, "leakage": 0.0,
        "supply_a": gain, "a_tank": gain, "supply_b": gain, "b_tank": gain,
        "dead_volume_a": valve.dead_volume * swept * chambers.growth_a,
        "dead_volume_b": valve.dead_volume * swept * chambers.growth_b,
    }  # fmt: skip

    def measured(kind: type[ValveValues] | type[ChamberValues]) -> dict[str, Measured]:
        return {name: Measured(value=values[name], unit=unit) for name, unit in kind.units.items()}

    return JointHydraulics(
        valve=ValveValues(**measured(ValveValues)),
        chambers=ChamberValues(**measured(ChamberValues)),
        unexplained=valve.gain_doubt,
    )


FLOW_SUMS = np.dtype(
    [
        ("flow", float, 2),  # m3 into A and B
        ("null", float, 2),  # m3, by how much they grow for a null of 1
        ("drop", float, 2),  # m3/Pa, the same for pressures that are off
        ("lost", float, 2),  # s in which the flow is not known
        ("sooner", float, 2),  # m3/s, by how much it grows for a spool that moves 1 s sooner
        ("edge", float, 2),  # m3 through edges of which it is not sure whether they are open
        ("faint", float, 2),  # s in which an open edge has next to no drop
        ("wide", float, 2),  # m3/Pa^0.5 for a drop of 1 Pa over the edge that is open
        ("impulse", float),  # N s of the piston
        ("moment", float),  # N s2, the same times the time since the window began
        ("extending", float),  # s with A fed, less those with B fed
    ]
)
"""Sums over a window of a joint; those of two are of the chambers A and B."""
SPOOL = np.dtype([("position", float), ("rate", float), ("edge", float)])
"""Position and velocity of a spool, and positions of its edges behind its play."""

PARTS_PER_INTERVAL = 4  # between two samples, in each of which a spool is taken to stand
HELD_COMMANDS = 512  # some seconds of them, in which pressures may be lost
SUCTION_MARGIN = 0.5e5  # Pa above the tank, below which a chamber may be filled past its valve
FAINT_DROP = 3e5  # Pa, that noise and zeros of two transducers hardly tell from none
FULL_SCALE_SHARE = 0.999  # of the largest pressure shown, which may then be any larger one


class Spools(NamedTuple):
    """Spools of the valves of j joints; see `crane_model.hydraulics`."""

    sense: Array  # (j,) +1 where extending the cylinder moves the joint in its positive direction
    delay: Array  # (j,) s
    frequency: Array  # (j,) rad/s
    damping: Array  # (j,)
    play: Array  # (j,)
    dead_band_a: Array  # (j,)
    dead_band_b: Array  # (j,)
    largest_drop: float  # Pa at edges that feed, if load sensing keeps them equal; else infinite


def spools_of(model: Model) -> Spools:
    """Those of the joints of a model; `ConfigurationError` names what is not identified."""
    circuit_of(model)
    machine, known = identified(model)
    rows = []
    for joint in model.joints:
        limits, valve = machine.limits[joint], known.joints[joint].valve
        middle = np.array([limits.middle])
        sense = np.sign(lever_arm(machine, joint, middle)[0])
        rows.append(
            (sense, valve.delay, valve.spool_frequency, valve.damping_ratio.value,
             valve.hysteresis.value, valve.dead_band_a.value, valve.dead_band_b.value)
        )  # fmt: skip
    sensing = machine.hydraulics.load_sensing
    largest = sensing.largest_drop if sensing else math.inf
    return Spools._make([*np.array(rows, dtype=float).T.copy(), largest])


class Commands(NamedTuple):
    """The newest commands, as a ring; `came` (1,) is how many there ever were."""

    stamp: Array  # (HELD_COMMANDS,) s
    value: Array  # (HELD_COMMANDS, j)
    came: NDArray[np.int64]  # (1,)

    @classmethod
    def none(cls, joints: int) -> "Commands":
        stamp = np.full(HELD_COMMANDS, -np.inf)
        return cls(stamp, np.zeros((HELD_COMMANDS, joints)), np.zeros(1, dtype=np.int64))

    def add(self, stamp: float, value: Array) -> None:
        """One more, in force from its stamp [s] until the next."""
        row = int(self.came[0]) % HELD_COMMANDS
        self.stamp[row], self.value[row] = stamp, value
        self.came[0] += 1

    def reach(self, time: float) -> bool:
        """Return whether all commands in force since `time` [s] are still held."""
        return int(self.came[0]) <= HELD_COMMANDS or float(self.stamp.min()) <= time


@njit(cache=True, error_model="numpy")
def _in_force(commands: Commands, j: int, time: float) -> float:
    """The last command of joint j before `time` [s]; 0 before the first command."""
    count = commands.came[0]
    for back in range(1, min(count, len(commands.stamp)) + 1):
        row = (count - back) % len(commands.stamp)
        if commands.stamp[row] <= time:
            return float(commands.value[row, j])
    return 0.0


@njit(cache=True, error_model="numpy")
def _shared_drop(
    circuit: Circuit, spools: Spools, spool: np.ndarray, now: Array, supply: float
) -> float:
    """Drop at all edges that feed [Pa], from pressures `now` (2, j); infinite if each has its own.

    It is the supply pressure over the highest of the chambers that are fed.
    """
    if math.isinf(spools.largest_drop):
        return math.inf
    highest = circuit.tank_pressure
    for j in range(len(spool)):
        o = opening(spool[j].edge, spools.dead_band_a[j], spools.dead_band_b[j])
        if o != 0.0:
            highest = max(highest, now[0, j] if o > 0.0 else now[1, j])
    return min(max(supply - highest, 0.0), spools.largest_drop)


@njit(cache=True, error_model="numpy")
def add_interval(
    circuit: Circuit, spools: Spools, commands: Commands, spool: np.ndarray, since: float,
    begin: float, end: float, before: Array, after: Array, supply: float, largest: float,
    sums: np.ndarray,
) -> None:  # fmt: skip
    """Add what flowed from `begin` to `end` [s] to `sums` (j,), records FLOW_SUMS of a window that
    began at `since`, and move the spools (j,), records SPOOL, on.

    Pressures `before` and `after` (2, j) [Pa] are of chambers A and B; `supply` [Pa] is that of the
    interval, and `largest` [Pa] what a transducer can show.
    """
    step = (end - begin) / PARTS_PER_INTERVAL
    drop = _shared_drop(circuit, spools, spool, after, supply)
    for j in range(len(spools.sense)):
        total, moved = sums[j], spool[j]
        for chamber in range(2):
            low = min(before[chamber, j], after[chamber, j])
            high = max(before[chamber, j], after[chamber, j])
            empty = low < circuit.tank_pressure + SUCTION_MARGIN
            if empty or high > FULL_SCALE_SHARE * largest:
                total.lost[chamber] += end - begin
        now = transition(spools.frequency[j], spools.damping[j], 0.5 * step)
        half = 0.5 * spools.play[j]
        for part in range(PARTS_PER_INTERVAL):
            middle = begin + (part + 0.5) * step
            target = spools.sense[j] * _in_force(commands, j, middle - spools.delay[j])
            z = stood = moved.edge
            for second in range(2):
                away, rate = moved.position - target, moved.rate
                moved.position = target + now[0] * away + now[1] * rate
                moved.rate = now[2] * away + now[3] * rate
                moved.edge = min(moved.position + half, max(moved.position - half, moved.edge))
                if second == 0:
                    z = moved.edge
            share = (part + 0.5) / PARTS_PER_INTERVAL
            p_a = before[0, j] + share * (after[0, j] - before[0, j])
            p_b = before[1, j] + share * (after[1, j] - before[1, j])
            o = opening(z, spools.dead_band_a[j], spools.dead_band_b[j])
            source = min(supply, (p_a if o > 0.0 else p_b) + drop)
            q_a, slope_a, q_b, slope_b = chamber_flows(circuit, j, o, p_a, p_b, source)
            leak = circuit.leakage[j] * (p_a - p_b)
            total.flow[0] += step * (q_a - leak)
            total.flow[1] += step * (q_b + leak)
            total.drop[0] += step * math.fabs(slope_a)
            total.drop[1] += step * math.fabs(slope_b)
            piston = circuit.area_a[j] * p_a - circuit.area_b[j] * p_b  # (19)
            total.impulse += step * piston
            total.moment += step * piston * (middle - since)
            dead = spools.dead_band_a[j] if z > 0.0 else spools.dead_band_b[j]
            if math.fabs(math.fabs(z) - dead) < spools.play[j]:  # open or shut is not sure
                wide = math.copysign(spools.play[j] / (1.0 - dead), z)
                edge_a, _, edge_b, _ = chamber_flows(circuit, j, wide, p_a, p_b, source)
                total.edge[0] += step * math.fabs(edge_a)
                total.edge[1] += step * math.fabs(edge_b)
            if o == 0.0:
                continue
            by_z_a, by_z_b = q_a / o / (1.0 - dead), q_b / o / (1.0 - dead)
            total.null[0] += step * by_z_a
            total.null[1] += step * by_z_b
            total.sooner[0] += (moved.edge - stood) * by_z_a
            total.sooner[1] += (moved.edge - stood) * by_z_b
            total.extending += step if o > 0.0 else -step
            beyond_a, beyond_b = source, circuit.tank_pressure
            gain_a, gain_b = circuit.supply_a[j], -circuit.b_tank[j]
            if o < 0.0:
                beyond_a, beyond_b = beyond_b, beyond_a
                gain_a, gain_b = circuit.a_tank[j], -circuit.supply_b[j]
            total.wide[0] += step * gain_a * o
            total.wide[1] += step * gain_b * o
            if math.fabs(beyond_a - p_a) < FAINT_DROP:
                total.faint[0] += step
            if math.fabs(beyond_b - p_b) < FAINT_DROP:
                total.faint[1] += step
