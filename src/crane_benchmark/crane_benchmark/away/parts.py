"""A machine of the other make, packed for compiled code: its parameters as arrays of j joints."""

from typing import NamedTuple

import numpy as np

from crane_model.cylinders import lever_arm
from crane_model.machine import Machine
from crane_sim.parts.parameters import StandIn

BEYOND = 0.1  # of its range, by which a joint may leave it against the end stops
ENDLESS = 1e30  # m, rad
GIVE = {"rad": 2e-5, "m": 2e-5}  # deflection of the bristles that carry all of the dry friction
BRISTLE_DAMPING = 2e-3  # s, of the bristles' stiffness
SUPPLY_HOSES = 4.0  # times the volume of the stand-in's supply line


class Make(NamedTuple):
    """What a machine of the other make has beside the parameters of a stand-in."""

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


class AwayParts(NamedTuple):
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


def pack_away(parameters: StandIn, machine: Machine, make: Make) -> AwayParts:
    """Of the stand-in's parameters, geometry and pump of the machine, and its make."""
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
    ends = np.cumsum([len(one.constants) for one in linkages])
    levers = [
        lever_arm(machine, joint, parameters.start[i : i + 1])[0] for i, joint in enumerate(joints)
    ]
    sense = np.sign(levers)
    rated = np.array([one.rated_flow / np.sqrt(one.rated_drop) for one in valves])
    shares = [(v.edges.supply_a, v.edges.a_tank, v.edges.supply_b, v.edges.b_tank) for v in valves]
    null = sense * np.array([one.null_bias for one in valves])
    ways = np.array([1.0, -1.0, -1.0, 1.0])  # of the spool, that open each edge
    overlap = np.array([one.dead_zone for one in valves])[:, np.newaxis] + np.outer(null, ways)
    supply, hydraulics = parameters.supply, machine.hydraulics
    return AwayParts(
        kind=np.array([one.kind for one in linkages]),
        begin=np.array([0, *ends[:-1]]),
        end=ends,
        constants=np.concatenate([one.constants for one in linkages]),
        areas=np.array([(one.area_a, one.area_b) for one in cylinders]),
        filled=np.array([(one.chambers.growth_a, one.chambers.growth_b) for one in cylinders]),
        stroke=np.clip([(one.length_min, one.length_max) for one in cylinders], -ENDLESS, ENDLESS),
        dead=np.array([(one.dead_volume_a, one.dead_volume_b) for one in inside]),
        leakage=np.array([one.leakage for one in inside]),
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
