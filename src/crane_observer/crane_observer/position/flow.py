"""What flows into the chambers over a window of some samples, compiled.

Commands are followed through the valves as `crane_model.hydraulics.stepping` has them, and what
passes the metering edges is the flow there, at the measured pressures. Whatever
depends on the position is left to the caller: sums of a window hold for every pose.
"""

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from crane_model.array import Array, Flags
from crane_model.cylinders import lever_arm
from crane_model.errors import ConfigurationError
from crane_model.hydraulics.stepping import Circuit, chamber_flows, opening, transition
from crane_model.hydraulics.values import (
    ChamberValues,
    HydraulicValues,
    JointHydraulics,
    Measured,
    ValveValues,
)
from crane_model.machine import Machine
from crane_model.model_file import Model
from crane_model.whole_crane import circuit_of, identified

# Valves that nobody identified: taken as plausible, and doubted as far as valves differ.
#
# A spool command says which way a joint moves, and roughly how fast; where it is, its weight must
# tell. With its encoder, or by its weight, the valve is learnt while the crane works.

MOST_BY_WEIGHT = 1  # joints without encoder, which the weight of all tells apart
OVERSIZED = 3.0  # times the fastest that a joint may move, what a valve lets it at full opening
GAIN_DOUBT = 0.8  # of the flow, one standard deviation
GAIN_STAYS = 3.0  # s: at other openings it is another one
LOAD_DRIFT = 5.0  # kg/sqrt(s)
NULL_DOUBT = 0.03  # of the stroke
STROKE_DOUBT = 0.1  # of the stroke of a window, beside these
DEAD_ZONE = 0.05  # of the stroke
LAG = 0.05  # s
FREQUENCY = 60.0  # rad/s
DAMPING = 1.0
BULK_MODULUS = 1.2e9  # Pa
DEAD_VOLUME = 0.05  # of what a piston sweeps


class Served(NamedTuple):
    """A model whose valves are all known or assumed."""

    model: Model
    assumed: Flags  # (j,) whose valve is not identified

    @classmethod
    def of(cls, model: Model) -> "Served":
        """`ConfigurationError` where it has no machine, or where chambers of a joint have no
        pressure transducers.
        """
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
                assumed[j], joints[joint] = True, _plausible(model.machine, joint)
        return cls(replace(model, hydraulics=known.model_copy(update={"joints": joints})), assumed)


def _plausible(machine: Machine, joint: str) -> JointHydraulics:
    limits, cylinder = machine.limits[joint], machine.cylinders.get(joint)
    if cylinder is None or not cylinder.pressure_sensors:
        raise ConfigurationError(
            f"{joint}: it has no chambers with pressure transducers (pressure_sensors in the "
            "machine file), by which its weight could tell where it is; leave it out of the model"
        )
    q = np.linspace(limits.position_min, limits.position_max, 21)
    lever = float(np.median(np.abs(lever_arm(machine, joint, q))))
    fastest = OVERSIZED * lever * min(-limits.velocity_min, limits.velocity_max)
    area = (cylinder.area_a + cylinder.area_b) / 2.0
    gain = fastest * area / np.sqrt(machine.hydraulics.supply_pressure / 2.0)
    swept = cylinder.chambers.empty_b - cylinder.chambers.empty_a
    values = {
        "dead_zone_a": DEAD_ZONE, "dead_zone_b": DEAD_ZONE, "hysteresis": 0.0, "lag": LAG,
        "natural_frequency": FREQUENCY, "damping_ratio": DAMPING, "supply_a": gain, "a_tank": gain,
        "supply_b": gain, "b_tank": gain, "bulk_modulus": BULK_MODULUS, "leakage": 0.0,
        "dead_volume_a": DEAD_VOLUME * swept * cylinder.chambers.growth_a,
        "dead_volume_b": DEAD_VOLUME * swept * cylinder.chambers.growth_b,
    }  # fmt: skip

    def part(kind: type[ValveValues] | type[ChamberValues]) -> dict[str, Measured]:
        return {name: Measured(value=values[name], unit=unit) for name, unit in kind.units.items()}

    return JointHydraulics(
        valve=ValveValues(**part(ValveValues)),
        chambers=ChamberValues(**part(ChamberValues)),
        unexplained=GAIN_DOUBT,
    )


PARTS = 4  # of the interval between two samples of pressure, over which a spool is taken to stand
HELD_COMMANDS = 512  # some seconds of them, in which pressures may be lost

(
    FLOW_A, FLOW_B, NULL_A, NULL_B, DROP_A, DROP_B, FORCE, LATER, OPEN, LOST_A, LOST_B, SOON_A,
    SOON_B, EDGE_A, EDGE_B, FAINT_A, FAINT_B, WIDE_A, WIDE_B,
) = range(19)  # fmt: skip
"""Sums over a window: flow into A and B [m3]; what each grows by for a null of 1 [m3] and for
pressures off by 1 Pa [m3/Pa]; the piston's impulse [N s], and that
times the time since the window began [N s2]; time with A fed less with B fed [s];
time in which what flows into A and B is not known [s]; what each grows by for a spool that moves
1 s sooner [m3/s]; what flows through edges that open by their play, while it is not sure whether
they are open [m3]; time in which an open edge of A and B has next to no drop [s]; what would flow
into A and B for a drop of 1 Pa over the edge that is open [m3/Pa^0.5]."""
SUMS = 19

SUCKED = 0.5e5  # Pa above that of the tank, below which a chamber may be filled past its valve
FAINT = 3e5  # Pa, a drop that noise and zeros of two transducers hardly tell from none
FULL = 0.999  # of the largest pressure that a transducer shows, which may then be any larger one


class Spools(NamedTuple):
    """Of the valves of j joints; see `crane_model.hydraulics.values`."""

    sense: Array  # (j,) +1 where extending the cylinder moves the joint in its positive direction
    delay: Array  # (j,) s
    frequency: Array  # (j,) rad/s
    damping: Array  # (j,)
    play: Array  # (j,)
    dead_zone_a: Array  # (j,)
    dead_zone_b: Array  # (j,)


def spools_of(model: Model) -> Spools:
    """Those of the joints of a model; `ConfigurationError` names what is not identified."""
    circuit_of(model)
    machine, known = identified(model)
    rows = []
    for joint in model.joints:
        limits, valve = machine.limits[joint], known.joints[joint].valve
        middle = (limits.position_min + limits.position_max) / 2.0
        rows.append(
            (
                np.sign(lever_arm(machine, joint, np.array([middle]))[0]),
                valve.delay,
                valve.spool_frequency,
                valve.damping_ratio.value,
                valve.hysteresis.value,
                valve.dead_zone_a.value,
                valve.dead_zone_b.value,
            )
        )
    return Spools(*np.array(rows, dtype=float).T.copy())


class Commands(NamedTuple):
    """The newest commands, as a ring; `came` (1,) is how many there ever were."""

    stamp: Array  # (HELD_COMMANDS,) s
    value: Array  # (HELD_COMMANDS, j)
    came: NDArray[np.int64]  # (1,)

    @classmethod
    def none(cls, joints: int) -> "Commands":
        """Before the first."""
        stamp = np.full(HELD_COMMANDS, -np.inf)
        return cls(stamp, np.zeros((HELD_COMMANDS, joints)), np.zeros(1, dtype=np.int64))

    def add(self, stamp: float, value: Array) -> None:
        """One more, in force from its stamp [s] until the next."""
        row = int(self.came[0]) % HELD_COMMANDS
        self.stamp[row], self.value[row] = stamp, value
        self.came[0] += 1

    def reach(self, time: float) -> bool:
        """Whether all that were in force since `time` [s] are still held."""
        return int(self.came[0]) <= HELD_COMMANDS or float(self.stamp.min()) <= time


@njit(cache=True, error_model="numpy")
def _in_force(commands: Commands, j: int, time: float) -> float:
    """What joint j was told last before `time` [s]; 0 before the first command."""
    count = commands.came[0]
    for back in range(1, min(count, len(commands.stamp)) + 1):
        row = (count - back) % len(commands.stamp)
        if commands.stamp[row] <= time:
            return float(commands.value[row, j])
    return 0.0


@njit(cache=True, error_model="numpy")
def _beyond(before: float, after: float, tank: float, largest: float) -> bool:
    """Whether one of two readings [Pa] may not be what is in the chamber, or what fills it."""
    return min(before, after) < tank + SUCKED or max(before, after) > FULL * largest


@njit(cache=True, error_model="numpy")
def add_interval(
    circuit: Circuit,
    spools: Spools,
    commands: Commands,
    spool: Array,
    since: float,
    begin: float,
    end: float,
    before: Array,
    after: Array,
    supply: float,
    largest: float,
    sums: Array,
) -> None:
    """Add what flowed from `begin` to `end` [s] to `sums` (j, SUMS) of a window that began at
    `since`, and move the spools on.

    `spool` (j, 3): position, its rate and that of the edges. Pressures `before` and `after`
    (2, j) [Pa] are of chambers A and B; `supply` [Pa] is that of the interval, and `largest`
    [Pa] what a transducer can show.
    """
    step = (end - begin) / PARTS
    for j in range(len(spools.sense)):
        if _beyond(before[0, j], after[0, j], circuit.tank_pressure, largest):
            sums[j, LOST_A] += end - begin
        if _beyond(before[1, j], after[1, j], circuit.tank_pressure, largest):
            sums[j, LOST_B] += end - begin
        now = transition(spools.frequency[j], spools.damping[j], 0.5 * step)
        half = 0.5 * spools.play[j]
        for part in range(PARTS):
            middle = begin + (part + 0.5) * step
            target = spools.sense[j] * _in_force(commands, j, middle - spools.delay[j])
            z = stood = spool[j, 2]
            for second in range(2):
                away, rate = spool[j, 0] - target, spool[j, 1]
                spool[j, 0] = target + now[0] * away + now[1] * rate
                spool[j, 1] = now[2] * away + now[3] * rate
                spool[j, 2] = min(spool[j, 0] + half, max(spool[j, 0] - half, spool[j, 2]))
                if second == 0:
                    z = spool[j, 2]
            share = (part + 0.5) / PARTS
            p_a = before[0, j] + share * (after[0, j] - before[0, j])
            p_b = before[1, j] + share * (after[1, j] - before[1, j])
            o = opening(z, spools.dead_zone_a[j], spools.dead_zone_b[j])
            q_a, slope_a, q_b, slope_b = chamber_flows(circuit, j, o, p_a, p_b, supply)
            leak = circuit.leakage[j] * (p_a - p_b)
            sums[j, FLOW_A] += step * (q_a - leak)
            sums[j, FLOW_B] += step * (q_b + leak)
            sums[j, DROP_A] += step * math.fabs(slope_a)
            sums[j, DROP_B] += step * math.fabs(slope_b)
            piston = circuit.area_a[j] * p_a - circuit.area_b[j] * p_b  # (19)
            sums[j, FORCE] += step * piston
            sums[j, LATER] += step * piston * (middle - since)
            dead = spools.dead_zone_a[j] if z > 0.0 else spools.dead_zone_b[j]
            if math.fabs(math.fabs(z) - dead) < spools.play[j]:  # open or shut is not sure
                wide = math.copysign(spools.play[j] / (1.0 - dead), z)
                edge_a, _, edge_b, _ = chamber_flows(circuit, j, wide, p_a, p_b, supply)
                sums[j, EDGE_A] += step * math.fabs(edge_a)
                sums[j, EDGE_B] += step * math.fabs(edge_b)
            if o != 0.0:
                by_z_a, by_z_b = q_a / o / (1.0 - dead), q_b / o / (1.0 - dead)
                sums[j, NULL_A] += step * by_z_a
                sums[j, NULL_B] += step * by_z_b
                sums[j, SOON_A] += (spool[j, 2] - stood) * by_z_a
                sums[j, SOON_B] += (spool[j, 2] - stood) * by_z_b
                sums[j, OPEN] += step if o > 0.0 else -step
                beside_a, beside_b = supply, circuit.tank_pressure
                gain_a, gain_b = circuit.supply_a[j], -circuit.b_tank[j]
                if o < 0.0:
                    beside_a, beside_b = beside_b, beside_a
                    gain_a, gain_b = circuit.a_tank[j], -circuit.supply_b[j]
                sums[j, WIDE_A] += step * gain_a * o
                sums[j, WIDE_B] += step * gain_b * o
                if math.fabs(beside_a - p_a) < FAINT:
                    sums[j, FAINT_A] += step
                if math.fabs(beside_b - p_b) < FAINT:
                    sums[j, FAINT_B] += step
