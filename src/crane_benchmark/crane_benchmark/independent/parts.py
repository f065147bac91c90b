"""A machine of the other make, packed for compiled code: its parameters as arrays of j joints."""

import math
from typing import NamedTuple

import mujoco
import numpy as np
from numba import njit

from crane_model.cylinders import lever_arm
from crane_model.machine import Machine
from crane_sim.parts.mujoco_model import machine_spec
from crane_sim.parts.parameters import SimulatedCrane

ELASTIC = 0.7  # of the largest deflection, up to which nothing slips
ATMOSPHERE = 1.01325e5  # Pa
POLYTROPE = 1.3  # of the bubbles
FLOW_NUMBER_DROP = 4e4  # Pa, about which an orifice turns from laminar to turbulent
MAKE_UP = 3e-7  # m3/s/sqrt(Pa), from the tank into a chamber below its pressure
BEYOND = 0.1  # of its range, by which a joint may leave it against the end stops
ENDLESS = 1e30  # m, rad
GIVE = {"rad": 2e-5, "m": 2e-5}  # deflection of the bristles that carry all of the dry friction
BRISTLE_DAMPING = 2e-3  # s, of the bristles' stiffness
SUPPLY_HOSES = 4.0  # times the volume of the supply line of the simulated crane

# Inertia and bias of the crane's bodies, as MuJoCo derives them.


class MujocoBodies:
    """M and h of M q'' + h = tau in the coordinates of the machine's j joints."""

    def __init__(self, parameters: SimulatedCrane, machine: Machine):
        self._model = machine_spec(parameters, machine).compile()
        self._data = mujoco.MjData(self._model)
        self._led = np.zeros((self._model.nv, len(machine.joint_names)))
        for row, joint in enumerate(machine.joints):
            leader, ratio = machine.led_by(joint)
            self._led[row, leader] = ratio
        # where no joint follows another, their coordinates are those of MuJoCo
        self._alike = np.array_equal(self._led, np.eye(self._model.nv))
        self._full = np.zeros((self._model.nv, self._model.nv))
        self._bias = np.zeros(self._model.nv)

    def at(self, q: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(j, j) inertia [kg m2, kg m, kg] and (j,) Coriolis forces and weight [N m, N]."""
        model, data = self._model, self._data
        data.qpos[:], data.qvel[:] = (q, v) if self._alike else (self._led @ q, self._led @ v)
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_makeM(model, data)
        mujoco.mj_comVel(model, data)
        mujoco.mj_rne(model, data, 0, self._bias)
        mujoco.mj_fullM(model, data, self._full)
        if self._alike:
            return self._full.copy(), self._bias.copy()
        return self._led.T @ self._full @ self._led, self._led.T @ self._bias


# Friction of the other make: elasto-plastic bristles, the same in both directions of bending.
#
# Dupont, Hayward, Armstrong and Altpeter, "Single state elastoplastic friction models", 2002:
# bristles are elastic up to a share of their largest deflection, so that what stands does not
# creep.


@njit(cache=True, error_model="numpy", forceinline=True)
def bent(z: float, v: float, largest: float, step: float) -> float:
    """Deflection [rad, m] after a step at velocity v, at most `largest` to either side."""
    slip = 0.0
    if z * v > 0.0 and abs(z) > ELASTIC * largest:
        phase = (abs(z) / largest - ELASTIC) / (1.0 - ELASTIC)
        slip = 1.0 if phase >= 1.0 else 0.5 - 0.5 * math.cos(math.pi * phase)
    z += step * v * (1.0 - slip * abs(z) / largest)
    return min(max(z, -largest), largest)


# Oil and valves of the other make, as compiled scalar functions.
#
# Pressures are gauge [Pa], flows [m3/s], openings 0..1. Nothing here is shared with `crane_sim`.


@njit(cache=True, error_model="numpy", forceinline=True)
def orifice(gain: float, opening: float, drop: float) -> tuple[float, float]:
    """Flow through a metering edge, and its slope over the drop [m3/s/Pa], at least the secant.

    The discharge coefficient rises with the tanh of the flow number, itself with the root of the
    drop: laminar at small drops, K x sqrt(drop) at large ones.
    """
    if opening <= 0.0:
        return 0.0, 0.0
    size = abs(drop)
    if size < 1.0:  # Pa: the limit
        slope = gain * opening / math.sqrt(FLOW_NUMBER_DROP)
        return slope * drop, slope
    root = math.sqrt(size)
    flow = gain * opening * root * math.tanh(root / math.sqrt(FLOW_NUMBER_DROP))
    return math.copysign(flow, drop), flow / size


@njit(cache=True, error_model="numpy", forceinline=True)
def edge(spool: float, overlap: float) -> float:
    """Opening 0..1 of an edge that opens as the spool moves in its sense."""
    return min(max((spool - overlap) / (1.0 - overlap), 0.0), 1.0)


@njit(cache=True, error_model="numpy", forceinline=True)
def modulus(pressure: float, stiffness: float, stiffening: float, air: float) -> float:
    """Bulk modulus [Pa] of stiffening oil with bubbles, `air` at atmospheric pressure."""
    absolute = max(pressure, 0.0) + ATMOSPHERE
    bubbles = air * (ATMOSPHERE / absolute) ** (1.0 / POLYTROPE)
    oil = stiffness + stiffening * max(pressure, 0.0)
    return (1.0 + bubbles) / (1.0 / oil + bubbles / (POLYTROPE * absolute))


@njit(cache=True, error_model="numpy", forceinline=True)
def relaxed(pressure: float, rate: float, slope: float, step: float) -> float:
    """Pressure after a step: `rate`, pulled back by `slope` [1/s]; exponential Euler."""
    way = slope * step
    return pressure + rate * step * (-math.expm1(-way) / way if way > 1e-9 else 1.0)


class Make(NamedTuple):
    """Parts of a machine of the other make besides the parameters of a simulated crane."""

    air: float  # share of the volume at atmospheric pressure
    stiffening: float  # of the oil, Pa per Pa
    pump_lag: float  # s, in which the pump's delivery follows its controller


class AwaySupply(NamedTuple):
    """Pump, supply line and relief valve."""

    volume: float  # m3, with its hoses
    most: float  # m3/s that the pump delivers
    set_pressure: float  # Pa, where its controller lets it deliver nothing
    droop: float  # Pa below it, where it delivers all it can
    lag: float  # s
    relief: float  # Pa, where the relief valve opens
    spill: float  # m3/s/Pa, of the relief valve


class IndependentParts(NamedTuple):
    """All that stays as it is; rows are joints, from the base to the tip."""

    kind: np.ndarray  # (j,) int: linkages as `crane_model.linkages.motion` takes them,
    begin: np.ndarray  # (j,) int: where in `constants` those of a joint begin,
    end: np.ndarray  # (j,) int: and end
    constants: np.ndarray
    areas: np.ndarray  # (j, 2) m2, m3/rad
    filled: np.ndarray  # (j, 2) m2 by which the volumes of A and B change with the stroke
    stroke: np.ndarray  # (j, 2) m, shortest and longest
    dead: np.ndarray  # (j, 2) m3
    leakage: np.ndarray  # (j,) m3/s/Pa
    stop: np.ndarray  # (j, 2) N/m and N s/m at the ends of the stroke
    sense: np.ndarray  # (j,) of the spool that moves the joint up
    spool: np.ndarray  # (j, 3) rad/s, damping ratio, strokes/s
    gain: np.ndarray  # (j, 4) m3/s/sqrt(Pa): supply to A, A to tank, supply to B, B to tank
    overlap: np.ndarray  # (j, 4) strokes, of the spool in the sense that opens the edge
    dry: np.ndarray  # (j, 2) N m, N: Coulomb friction up and down
    wet: np.ndarray  # (j, 2) N m s/rad, N s/m: viscous friction up and down
    give: np.ndarray  # (j,) rad, m
    oil: np.ndarray  # (3,) Pa of the modulus without pressure, Pa/Pa, share of air
    supply: AwaySupply
    tank: float  # Pa


def pack_independent(parameters: SimulatedCrane, machine: Machine, make: Make) -> IndependentParts:
    """From the parameters of the simulated crane, and geometry and pump of the machine."""
    joints = machine.joint_names
    cylinders = [machine.cylinders[joint] for joint in joints]
    inside = [parameters.cylinders[joint] for joint in joints]
    valves = [parameters.valves[joint] for joint in joints]
    friction = [parameters.friction[joint] for joint in joints]
    linkages = []
    for joint, actuator in machine.actuators.items():
        limits = machine.limits[joint]
        beyond = BEYOND * (limits.position_max - limits.position_min)
        linkages.append(
            actuator.linkage(limits.position_min - beyond, limits.position_max + beyond)
        )
    ends = np.cumsum([len(linkage.constants) for linkage in linkages])
    levers = [
        lever_arm(machine, joint, parameters.start[i : i + 1])[0] for i, joint in enumerate(joints)
    ]
    sense = np.sign(levers)
    rated = np.array([valve.rated_flow / np.sqrt(valve.rated_drop) for valve in valves])
    shares = [(v.edges.supply_a, v.edges.a_tank, v.edges.supply_b, v.edges.b_tank) for v in valves]
    null = sense * np.array([valve.null_bias for valve in valves])
    ways = np.array([1.0, -1.0, -1.0, 1.0])  # of the spool, that open each edge
    overlap = np.array([valve.dead_band for valve in valves])[:, np.newaxis] + np.outer(null, ways)
    supply, hydraulics = parameters.supply, machine.hydraulics
    return IndependentParts(
        kind=np.array([linkage.kind for linkage in linkages]),
        begin=np.array([0, *ends[:-1]]),
        end=ends,
        constants=np.concatenate([linkage.constants for linkage in linkages]),
        areas=np.array([(cylinder.area_a, cylinder.area_b) for cylinder in cylinders]),
        filled=np.array(
            [(cylinder.chambers.growth_a, cylinder.chambers.growth_b) for cylinder in cylinders]
        ),
        stroke=np.clip(
            [(cylinder.length_min, cylinder.length_max) for cylinder in cylinders],
            -ENDLESS,
            ENDLESS,
        ),
        dead=np.array([(joint.dead_volume_a, joint.dead_volume_b) for joint in inside]),
        leakage=np.array([joint.leakage for joint in inside]),
        stop=np.array([(s.stop_stiffness, 1e-3 * s.stop_stiffness) for s in inside]),
        sense=sense,
        spool=np.array(
            [(2 * np.pi * v.natural_frequency, v.damping_ratio, v.rate_limit) for v in valves]
        ),
        gain=rated[:, np.newaxis] * np.array(shares),
        overlap=overlap,
        dry=np.array([(f.f_c + f.df_c, f.f_c - f.df_c) for f in friction]),
        wet=np.array([(f.f_v + f.df_v, f.f_v - f.df_v) for f in friction]),
        give=np.array([GIVE[machine.units[joint]] for joint in joints]),
        oil=np.array([parameters.oil.bulk_modulus, make.stiffening, make.air]),
        supply=AwaySupply(
            volume=SUPPLY_HOSES * supply.volume,
            most=hydraulics.pump_flow,
            set_pressure=hydraulics.supply_pressure,
            droop=supply.pump_droop,
            lag=make.pump_lag,
            relief=hydraulics.relief_pressure,
            spill=supply.relief_gain,
        ),
        tank=hydraulics.tank_pressure,
    )
