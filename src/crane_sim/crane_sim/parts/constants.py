"""The machine and the parameters of the plant, packed for compiled code, and its state."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from crane_model.cylinders import lever_arm
from crane_model.errors import ConfigurationError
from crane_model.kinematics import link_transforms
from crane_model.machine import Machine
from crane_sim.parts.cylinders import (
    BRISTLE_FIELDS,
    CYLINDER_FIELDS,
    EDGES,
    LAW_FIELDS,
    VALVE_FIELDS,
    Linkages,
    Oil,
)
from crane_sim.parts.parameters import SimulatedCrane, column
from crane_sim.parts.rigid_bodies import LINK, Chain

RANGE_MARGIN = 0.1  # of its range, by which a joint may leave it against the end stops
ENDLESS_STROKE = 1e30  # m, rad


class Constants(NamedTuple):
    """Everything that stays as it is while the plant runs; records (j,), from base to tip."""

    chain: Chain
    linkages: Linkages
    oil: Oil
    cylinders: np.ndarray  # fields CYLINDER_FIELDS
    valves: np.ndarray  # fields VALVE_FIELDS
    friction: np.ndarray  # fields LAW_FIELDS and BRISTLE_FIELDS
    dynamic_friction: bool


def records(fields: Sequence[str], columns: Mapping[str, np.ndarray]) -> np.ndarray:
    """(n,) records with the given fields from one array (n,) a field."""
    table = np.zeros(
        len(next(iter(columns.values()))), np.dtype([(name, float) for name in fields])
    )
    for name in fields:
        table[name] = columns[name]
    return table


def pack(parameters: SimulatedCrane, machine: Machine) -> Constants:
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


def pack_chain(parameters: SimulatedCrane, machine: Machine) -> Chain:
    """The bodies of each link as one, in the zero pose."""
    names = [joint.name for joint in machine.joints]
    frames = link_transforms(machine, np.zeros(len(machine.joint_names)))[0]
    links = np.zeros(len(names) + 1, LINK)
    links["rotation"] = np.eye(3)
    for link, joint, before in zip(
        links[1:], machine.joints, [machine.base.matrix, *frames[:-1]], strict=True
    ):
        placed = before @ joint.before
        link["axis"], link["point"] = placed[:3, :3] @ joint.direction, placed[:3, 3]
        link["slides"] = joint.kind == "prismatic"
        link["leader"], link["ratio"] = machine.led_by(joint)
    for body in parameters.bodies.values():
        i = names.index(body.link)
        turned = frames[i, :3, :3] @ body.rotation
        place = frames[i, :3, :3] @ body.origin + frames[i, :3, 3] + turned @ body.centre_of_mass
        link = links[i + 1]
        link["mass"] += body.mass
        link["centre"] += body.mass * place  # first the moment and the inertia about the origin
        link["inertia"] += turned @ body.tensor @ turned.T + body.mass * _steiner(place)
    if bare := [name for name, m in zip(names, links["mass"][1:], strict=True) if m == 0.0]:
        raise ConfigurationError(
            f"simulated crane '{parameters.name}': key 'bodies': no body has the link "
            f"{', '.join(bare)}; every link of the machine needs one"
        )
    for link in links[1:]:
        link["centre"] /= link["mass"]
        link["inertia"] -= link["mass"] * _steiner(link["centre"])
    tip = (frames[-1] @ machine.tool.matrix)[:3, 3]
    return Chain(
        links=links,
        tip=np.ascontiguousarray(tip),
        outward=_outward(links[-1], tip),
        gravity=machine.gravity_vector,
    )


def _steiner(place: np.ndarray) -> np.ndarray:
    """(3, 3) inertia of a mass of 1 kg at a place (3,), about the origin [m2]."""
    square: np.ndarray = place @ place * np.eye(3) - np.outer(place, place)
    return square


def _outward(link: np.void, tip: np.ndarray) -> np.ndarray:
    """Along the axis of a last joint that slides, away from that of one that turns."""
    axis, reach = link["axis"], tip - link["point"]
    across = reach - axis * (axis @ reach)
    if link["slides"] or np.linalg.norm(across) < 1e-9:
        return np.array(axis)
    outward: np.ndarray = across / np.linalg.norm(across)
    return outward


def pack_friction(parameters: SimulatedCrane) -> np.ndarray:
    """(13) for the two directions; the fields of LuGre are zero where friction is not dynamic."""
    law, bristles = parameters.friction, parameters.dynamic_friction
    f_c, df_c, f_v, df_v = (column(law, key) for key in ("f_c", "df_c", "f_v", "df_v"))
    unused = np.zeros(len(law))
    return records(
        (*LAW_FIELDS, *BRISTLE_FIELDS),
        {
            "coulomb_up": f_c + df_c,
            "coulomb_down": f_c - df_c,
            "viscous_up": f_v + df_v,
            "viscous_down": f_v - df_v,
            **{
                key: unused if bristles is None else column(bristles, key) for key in BRISTLE_FIELDS
            },
        },
    )


def _pack_linkages(machine: Machine) -> Linkages:
    packed = []
    for joint, actuator in machine.actuators.items():
        limits = machine.limits[joint]
        beyond = RANGE_MARGIN * (limits.position_max - limits.position_min)
        packed.append(actuator.linkage(limits.position_min - beyond, limits.position_max + beyond))
    ends = np.cumsum([len(linkage.constants) for linkage in packed])
    return Linkages(
        kind=np.array([linkage.kind for linkage in packed]),
        begin=np.array([0, *ends[:-1]]),
        end=ends,
        constants=np.concatenate([linkage.constants for linkage in packed]),
    )


def _pack_cylinders(parameters: SimulatedCrane, machine: Machine) -> np.ndarray:
    inside = parameters.cylinders
    known = {
        key: np.array([getattr(machine.cylinders[joint], key) for joint in machine.joint_names])
        for key in ("area_a", "area_b", "length_min", "length_max")
    }
    chambers = [machine.cylinders[joint].chambers for joint in machine.joint_names]
    growths = np.array([(chamber.growth_a, chamber.growth_b) for chamber in chambers]).T
    filled = dict(zip(("filled_a", "filled_b"), growths, strict=True))
    known |= {
        end: np.clip(known[end], -ENDLESS_STROKE, ENDLESS_STROKE)
        for end in ("length_min", "length_max")
    }
    known |= filled
    return records(
        CYLINDER_FIELDS, known | {k: column(inside, k) for k in CYLINDER_FIELDS if k not in known}
    )


def _pack_valves(parameters: SimulatedCrane, machine: Machine) -> np.ndarray:
    valves, rest = parameters.valves, parameters.start[:, None]
    levers = [lever_arm(machine, joint, rest[i])[0] for i, joint in enumerate(machine.joint_names)]
    sense = np.sign(levers)
    gain = column(valves, "rated_flow") / np.sqrt(column(valves, "rated_drop"))
    shares = {
        edge: np.array([getattr(valve.edges, edge) for valve in valves.values()]) for edge in EDGES
    }
    return records(
        VALVE_FIELDS,
        {
            "sense": sense,
            "frequency": 2.0 * np.pi * column(valves, "natural_frequency"),
            "damping_ratio": column(valves, "damping_ratio"),
            "rate_limit": column(valves, "rate_limit"),
            "dead_band": column(valves, "dead_band"),
            "null": sense * column(valves, "null_bias"),
            **{edge: gain * share for edge, share in shares.items()},
        },
    )


def _pack_oil(parameters: SimulatedCrane, machine: Machine) -> Oil:
    hydraulics, supply = machine.hydraulics, parameters.supply
    sensing = hydraulics.load_sensing
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
        port_relief=supply.port_relief,
        load_sensing=sensing is not None,
        margin=sensing.margin if sensing else 0.0,
        power=sensing.power if sensing else 0.0,
    )


# The state of the plant, and the room in which a step is worked out.

ACTUATOR_FIELDS = ("length", "lever", "slope", "spool", "spool_rate", "p_a", "p_b")
"""Fields of an actuator's record: m, dx/dq, d2x/dq2; spool -1..1 (positive extends), 1/s; Pa."""


class State(NamedTuple):
    """All that changes; arrays (j,) from the base to the tip, but `supply` (1,)."""

    q: np.ndarray  # rad, m
    v: np.ndarray  # rad/s, m/s
    mode: np.ndarray  # int: sticking, or direction of motion
    bristle: np.ndarray  # rad, m: deflection with dynamic friction
    actuators: np.ndarray  # records, fields ACTUATOR_FIELDS
    supply: np.ndarray  # Pa


class Scratch(NamedTuple):
    """Room for the intermediate results of a step."""

    mass: np.ndarray  # (j, j)
    bias: np.ndarray  # (j,)
    force: np.ndarray  # (j,)
    impulse: np.ndarray  # (j,)
    friction: np.ndarray  # (j + 1, j)
    growth: np.ndarray  # (j,) piston speed, m/s
    before: np.ndarray  # (j,) velocities before the step
    law: np.ndarray  # records (j,): friction as injected effects have changed it


def at_rest(q: np.ndarray, supply: float) -> State:
    """The pose q (j,), all else nil but the supply pressure [Pa]."""
    return State(
        q=q,
        v=np.zeros(len(q)),
        mode=np.zeros(len(q), dtype=np.int64),
        bristle=np.zeros(len(q)),
        actuators=np.zeros(len(q), np.dtype([(name, float) for name in ACTUATOR_FIELDS])),
        supply=np.array([supply]),
    )


def room(law: np.ndarray) -> Scratch:
    """Room for as many joints as there are records of friction (j,)."""
    joints = len(law)
    return Scratch(
        mass=np.zeros((joints, joints)),
        bias=np.zeros(joints),
        force=np.zeros(joints),
        impulse=np.zeros(joints),
        friction=np.zeros((joints + 1, joints)),
        growth=np.zeros(joints),
        before=np.zeros(joints),
        law=law.copy(),
    )
