"""The machine and the stand-in's parameters, packed for compiled code: one record a joint."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from crane_model.cylinders import lever_arm
from crane_model.machine import JOINTS, Machine
from crane_sim.parts.cylinders import CYLINDER, Linkages
from crane_sim.parts.friction import BRISTLES, LAW
from crane_sim.parts.hydraulics import EDGES, VALVE, Oil
from crane_sim.parts.parameters import StandIn
from crane_sim.parts.rigid_bodies import BODY, Chain


class Constants(NamedTuple):
    """Everything that does not change while the plant runs; records (4,) follow JOINTS."""

    chain: Chain
    linkages: Linkages
    oil: Oil
    cylinders: np.ndarray  # fields CYLINDER
    valves: np.ndarray  # fields VALVE
    friction: np.ndarray  # fields LAW and BRISTLES
    dynamic_friction: bool


def records(fields: Sequence[str], columns: Mapping[str, np.ndarray]) -> np.ndarray:
    """(n,) records with the given fields from one array (n,) a field."""
    table = np.zeros(
        len(next(iter(columns.values()))), np.dtype([(name, float) for name in fields])
    )
    for name in fields:
        table[name] = columns[name]
    return table


def pack(parameters: StandIn, machine: Machine) -> Constants:
    """Constants of the plant."""
    return Constants(
        pack_chain(parameters, machine),
        _pack_linkages(machine),
        _pack_oil(parameters, machine),
        _pack_cylinders(parameters, machine),
        _pack_valves(parameters, machine),
        pack_friction(parameters),
        parameters.dynamic_friction is not None,
    )


def pack_chain(parameters: StandIn, machine: Machine) -> Chain:
    """Bodies with the geometry of Table 1."""
    dh, bodies = machine.denavit_hartenberg, parameters.bodies
    rows = np.array(
        [
            [body.mass, *body.centre_of_mass, *body.principal_inertia]
            for body in (
                bodies.pillar,
                bodies.inner_boom,
                bodies.outer_boom,
                bodies.telescope,
                bodies.gripper,
            )
        ]
    )
    return Chain(
        bodies=records(BODY, dict(zip(BODY, rows.T, strict=True))),
        theta_20=dh.theta_2_0,
        inner_boom_length=dh.inner_boom_length,
        telescope_offset=dh.telescope_offset,
        telescope_length=dh.telescope_length,
        gravity=dh.gravity,
    )


def pack_friction(parameters: StandIn) -> np.ndarray:
    """(13) for the two directions; the fields of LuGre are zero where friction is not dynamic."""
    law, bristles = parameters.friction, parameters.dynamic_friction
    f_c, df_c, f_v, df_v = (law.array(key) for key in ("f_c", "df_c", "f_v", "df_v"))
    unused = np.zeros(len(JOINTS))
    return records(
        (*LAW, *BRISTLES),
        {
            "coulomb_up": f_c + df_c,
            "coulomb_down": f_c - df_c,
            "viscous_up": f_v + df_v,
            "viscous_down": f_v - df_v,
            **{key: unused if bristles is None else bristles.array(key) for key in BRISTLES},
        },
    )


def _pack_linkages(machine: Machine) -> Linkages:
    inner, outer = machine.inner_boom_linkage, machine.outer_boom_linkage
    radius = lever_arm(machine, JOINTS[0], np.zeros(1))[0]
    return Linkages(
        rack_radius=radius,
        j1=inner.j1,
        j2=inner.j2,
        angle_0=inner.angle_0,
        gamma_21_0=outer.gamma_21_0,
        gamma_32=outer.gamma_32,
        s22=outer.s22,
        s23=outer.s23,
        c1=outer.c1,
        c2=outer.c2,
        s31=outer.s31,
    )


def _pack_cylinders(parameters: StandIn, machine: Machine) -> np.ndarray:
    inside = parameters.cylinders
    known = ("area_a", "area_b", "length_min", "length_max")
    columns = {
        key: np.array([getattr(machine.cylinders[joint], key) for joint in JOINTS]) for key in known
    }
    return records(CYLINDER, columns | {k: inside.array(k) for k in CYLINDER if k not in known})


def _pack_valves(parameters: StandIn, machine: Machine) -> np.ndarray:
    valves, rest = parameters.valves, parameters.start[:, None]
    levers = [lever_arm(machine, joint, rest[i])[0] for i, joint in enumerate(JOINTS)]
    sense = np.sign(levers)
    gain = valves.array("rated_flow") / np.sqrt(valves.array("rated_drop"))
    shares = {
        edge: np.array([getattr(valves[joint].edges, edge) for joint in JOINTS]) for edge in EDGES
    }
    return records(
        VALVE,
        {
            "sense": sense,
            "frequency": 2.0 * np.pi * valves.array("natural_frequency"),
            "damping_ratio": valves.array("damping_ratio"),
            "rate_limit": valves.array("rate_limit"),
            "dead_zone": valves.array("dead_zone"),
            "null": sense * valves.array("null_bias"),
            **{edge: gain * share for edge, share in shares.items()},
        },
    )


def _pack_oil(parameters: StandIn, machine: Machine) -> Oil:
    hydraulics, supply = machine.hydraulics, parameters.supply
    return Oil(
        bulk_modulus=parameters.oil.bulk_modulus,
        laminar_drop=parameters.oil.laminar_drop,
        check_valve_gain=supply.check_valve_gain,
        supply_volume=supply.volume,
        pump_flow=hydraulics.pump_flow,
        set_pressure=hydraulics.supply_pressure,
        droop=supply.pump_droop,
        relief_pressure=hydraulics.relief_pressure,
        relief_gain=supply.relief_gain,
        tank_pressure=hydraulics.tank_pressure,
    )
