"""The true values of a simulated crane: its base parameters, and the hydraulics of measured joints.

The kinetic and potential energy of the bodies, written with the directions phi and psi of the two
booms and the extension q4, hold the body parameters only in these combinations (each about the
point named; m, c and I are mass, centre of mass and inertia of a body):

- inner boom about joint 2, with what it carries as a point mass at the elbow,
- outer boom, telescope and gripper about the elbow, at q4 = 0,
- telescope and gripper alone, since they slide.
"""

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from crane_model import cli
from crane_model.base_parameters import base_set
from crane_model.cylinders import lever_arm
from crane_model.errors import ConfigurationError
from crane_model.hydraulics import JointHydraulics
from crane_model.kinematics import link_transforms
from crane_model.machine import Machine
from crane_model.terms.rigid_body import SerialRigidBody
from crane_model.terms.term import Setting
from crane_sim.effects.form import measured_joints
from crane_sim.parts.constants import pack_chain
from crane_sim.parts.parameters import SimulatedCrane, add_plant, load_both

# The true hydraulics: what `identify` is to find of valves, oil and cylinders.
#
# Under the names and in the units that section `hydraulics` of a model file has;
# `crane_model.hydraulics.stepping` says what each is. With injected effects they are others.


def hydraulics_of(parameters: SimulatedCrane, machine: Machine, joint: str) -> dict[str, float]:
    """By name [SI], of a warm machine. The gain of a fully open edge depends on where the null of
    the spool lies: the way from the edge to full stroke is longer on one side of it.
    """
    valve, inside = parameters.valves[joint], parameters.cylinders[joint]
    start = parameters.start[[machine.index(joint)]]
    null = float(np.sign(lever_arm(machine, joint, start))[0]) * valve.null_bias
    dead_a, dead_b = valve.dead_band + null, valve.dead_band - null
    gain = valve.rated_flow / np.sqrt(valve.rated_drop)
    by_a, by_b = (gain * (1.0 - dead) / (1.0 - valve.dead_band) for dead in (dead_a, dead_b))
    frequency = 2.0 * np.pi * valve.natural_frequency
    return {
        "dead_band_a": dead_a,
        "dead_band_b": dead_b,
        "hysteresis": 0.0,
        "lag": valve.dead_time + 2.0 * valve.damping_ratio / frequency,
        "natural_frequency": frequency,
        "damping_ratio": valve.damping_ratio,
        "supply_a": by_a * valve.edges.supply_a,
        "a_tank": by_b * valve.edges.a_tank,
        "supply_b": by_b * valve.edges.supply_b,
        "b_tank": by_a * valve.edges.b_tank,
        "bulk_modulus": parameters.oil.bulk_modulus,
        "dead_volume_a": inside.dead_volume_a,
        "dead_volume_b": inside.dead_volume_b,
        "leakage": inside.leakage,
    }


MAX_OFF_AXIS_M = 1e-9
ROUNDING_SHARE = 1e-12  # of the largest value


class TrueValue(NamedTuple):
    """A true entry of Theta, or of the hydraulics."""

    name: str
    unit: str
    value: float


def true_parameters(parameters: SimulatedCrane, machine: Machine) -> list[TrueValue]:
    """The base parameters: inertial ones, then those of (13) of the joints that are measured.

    Of a crane as of the report they are the 20 of the suite; of any other machine the combinations
    that `serial_rigid_body` names while joints that are not measured stand still. With dynamic
    friction, the friction parameters are those of its steady state at speed.
    """
    if machine.planar is None or machine.planar.joints != measured_joints(machine):
        inertial = _of_any_machine(parameters, machine)
    else:
        inertial = _of_the_plane(parameters, machine)
    friction = []
    for joint in measured_joints(machine):
        law = parameters.friction[joint]
        force, rate = ("N", "N s/m") if machine.units[joint] == "m" else ("N m", "N m s/rad")
        friction += [
            TrueValue(f"f_c.{joint}", force, law.f_c),
            TrueValue(f"df_c.{joint}", force, law.df_c),
            TrueValue(f"f_v.{joint}", rate, law.f_v),
            TrueValue(f"df_v.{joint}", rate, law.df_v),
        ]
    return inertial + friction


def true_hydraulics(parameters: SimulatedCrane, machine: Machine) -> list[TrueValue]:
    """NAME.JOINT of valve and chambers, joint by joint."""
    return [
        TrueValue(f"{name}.{joint}", JointHydraulics.units[name], value)
        for joint in measured_joints(machine)
        for name, value in hydraulics_of(parameters, machine, joint).items()
    ]


def _of_any_machine(parameters: SimulatedCrane, machine: Machine) -> list[TrueValue]:
    joints = measured_joints(machine)
    setting = Setting({joint: machine.units[joint] for joint in joints}, machine)
    values = base_set(machine, joints).combination @ _standard(parameters, machine)
    values[np.abs(values) < ROUNDING_SHARE * np.abs(values).max()] = 0.0
    return [
        TrueValue(known.name, known.unit, float(value))
        for known, value in zip(SerialRigidBody().parameters(setting), values, strict=True)
    ]


def _standard(parameters: SimulatedCrane, machine: Machine) -> np.ndarray:
    """(10 m,) the ten parameters of each link about its joint, as `crane_model.chain` has them."""
    frames = link_transforms(machine, np.zeros(len(machine.units)))[0]
    before = [machine.base.matrix, *frames[:-1]]
    links = pack_chain(parameters, machine).links[1:]
    values = []
    for link, frame, joint in zip(links, before, machine.joints, strict=True):
        inverse = np.linalg.inv(frame @ joint.before)
        mass, c = link["mass"], inverse[:3, :3] @ link["centre"] + inverse[:3, 3]
        about = inverse[:3, :3] @ link["inertia"] @ inverse[:3, :3].T
        about += mass * (c @ c * np.eye(3) - np.outer(c, c))
        values += [mass, *(mass * c), *about[[0, 0, 1, 0, 1, 2], [0, 1, 1, 2, 2, 2]]]
    return np.array(values)


def _of_the_plane(parameters: SimulatedCrane, machine: Machine) -> list[TrueValue]:
    """`ConfigurationError` if the centre of mass of telescope and gripper is off their axis: the
    normal moment is then a ninth inertial parameter that the set cannot hold.
    """
    chain = pack_chain(parameters, machine)
    length = machine.as_planar().inner_boom_length
    inner, outer, telescope = chain.links[-3:]
    line = (outer["point"] - inner["point"]) / length
    boom = _about(inner, inner["point"], line, inner["axis"])
    along = telescope["axis"]  # of the outer boom
    outer, slid = (
        _about(link, outer["point"], along, inner["axis"]) for link in (outer, telescope)
    )
    rise = machine.as_planar().telescope_offset
    off_axis = slid.normal - slid.mass * rise
    if abs(off_axis) > MAX_OFF_AXIS_M * slid.mass:
        raise ConfigurationError(
            f"simulated crane '{parameters.name}': key 'bodies': the centre of mass of telescope "
            f"and gripper together must lie on the telescope's axis (normal moment 0), got "
            f"{off_axis:.6g} kg m; the 20 base parameters hold only then"
        )
    carried = outer.mass + slid.mass
    return [
        TrueValue("J_FL", "kg m2", boom.inertia + length**2 * carried),
        TrueValue("S_FL_along", "kg m", boom.along + length * carried),
        TrueValue("S_FL_normal", "kg m", boom.normal),
        TrueValue("J_SL", "kg m2", outer.inertia + slid.inertia),
        TrueValue("S_SL_along", "kg m", outer.along + slid.along),
        TrueValue("S_SL_normal", "kg m", outer.normal + slid.normal),
        TrueValue("m_TL", "kg", slid.mass),
        TrueValue("S_TL_along", "kg m", slid.along),
    ]


class _Link(NamedTuple):
    """A link in the plane: kg, kg m along the boom and normal to it, kg m2 about a point."""

    mass: float
    along: float
    normal: float
    inertia: float


def _about(link: np.void, point: np.ndarray, along: np.ndarray, axis: np.ndarray) -> _Link:
    """In the zero pose, about a point (3,), with unit vectors (3,) along it and to the side."""
    mass, arm = float(link["mass"]), link["centre"] - point
    normal = np.cross(axis, along)
    inertia = axis @ link["inertia"] @ axis + mass * ((along @ arm) ** 2 + (normal @ arm) ** 2)
    return _Link(mass, mass * float(along @ arm), mass * float(normal @ arm), float(inertia))


@dataclass(frozen=True)
class _Request:
    plant: Path | None
    machine: str | None
    json: bool


def main(argv: Sequence[str] | None = None) -> int:
    """Print the true parameters of a simulated crane."""
    parser = cli.command_line(description=main.__doc__)
    add_plant(parser)
    cli.add_machine(parser)
    parser.add_argument(
        "--json", action="store_true", help="print {name: value} in SI units as JSON"
    )
    request = _Request(**vars(parser.parse_args(argv)))

    def body() -> None:
        machine, parameters = load_both(request.machine, request.plant)
        entries = true_parameters(parameters, machine) + true_hydraulics(parameters, machine)
        if request.json:
            print(json.dumps({entry.name: entry.value for entry in entries}, indent=2))
            return
        width = max(len(entry.name) for entry in entries)
        for entry in entries:
            print(f"{entry.name:{width}}  {entry.value:12.6g}  {entry.unit}")

    return cli.run(body)
