"""The planted Theta: what the base parameters of the suite are for the stand-in's bodies.

The kinetic and potential energy of the bodies, written with the directions phi and psi of the two
booms and the extension q4, hold the body parameters only in these combinations (each about the
point named; m, c and I are mass, centre of mass and inertia of a body):

- inner boom about joint 2, with what it carries as a point mass at the elbow,
- outer boom, telescope and gripper about the elbow, at q4 = 0,
- telescope and gripper alone, since they slide.
"""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from crane_model import cli
from crane_model.errors import ConfigurationError
from crane_model.machine import PLANAR_JOINTS, Machine, load_machine
from crane_sim.parts.parameters import Body, StandIn, load_stand_in

ON_AXIS = 1e-9  # m


class PlantedParameter(NamedTuple):
    """One entry of Theta as it was planted."""

    name: str
    unit: str
    value: float


def planted(parameters: StandIn, machine: Machine) -> list[PlantedParameter]:
    """The 20 base parameters: eight inertial ones, then those of (13) of the planar joints.

    With dynamic friction, the friction parameters are those of its steady state at speed.
    `ConfigurationError` if the centre of mass of telescope and gripper is off the telescope's axis:
    the normal moment is then a ninth inertial parameter that this set cannot hold.
    """
    dh, bodies = machine.denavit_hartenberg, parameters.bodies
    sliding = [bodies.telescope, bodies.gripper]
    off_axis = sum(body.mass * body.centre_of_mass[1] for body in sliding)
    if abs(off_axis) > ON_AXIS * sum(body.mass for body in sliding):
        raise ConfigurationError(
            f"stand-in '{parameters.name}': key 'bodies': the centre of mass of telescope and "
            f"gripper together must lie on the telescope's axis (normal moment 0), got "
            f"{off_axis:.6g} kg m; the 20 base parameters hold only then"
        )
    boom, outer = _about(bodies.inner_boom, 0.0, 0.0), _about(bodies.outer_boom, 0.0, 0.0)
    slid = [_about(body, dh.telescope_length, dh.telescope_offset) for body in sliding]
    slid_mass, slid_along, slid_normal, slid_inertia = (
        sum(column) for column in zip(*slid, strict=True)
    )
    carried = outer[0] + slid_mass
    length = dh.inner_boom_length
    inertial = [
        PlantedParameter("J_FL", "kg m2", boom[3] + length**2 * carried),
        PlantedParameter("S_FL_along", "kg m", boom[1] + length * carried),
        PlantedParameter("S_FL_normal", "kg m", boom[2]),
        PlantedParameter("J_SL", "kg m2", outer[3] + slid_inertia),
        PlantedParameter("S_SL_along", "kg m", outer[1] + slid_along),
        PlantedParameter("S_SL_normal", "kg m", outer[2] + slid_normal),
        PlantedParameter("m_TL", "kg", slid_mass),
        PlantedParameter("S_TL_along", "kg m", slid_along),
    ]
    friction = []
    for joint in PLANAR_JOINTS:
        law = parameters.friction[joint]
        force, rate = ("N", "N s/m") if joint == "telescope" else ("N m", "N m s/rad")
        friction += [
            PlantedParameter(f"f_c.{joint}", force, law.f_c),
            PlantedParameter(f"df_c.{joint}", force, law.df_c),
            PlantedParameter(f"f_v.{joint}", rate, law.f_v),
            PlantedParameter(f"df_v.{joint}", rate, law.df_v),
        ]
    return inertial + friction


def _about(body: Body, along: float, normal: float) -> tuple[float, float, float, float]:
    """Mass, moments along and normal, and inertia about a point, given the body's frame from it."""
    x, y = body.centre_of_mass[0] + along, body.centre_of_mass[1] + normal
    inertia = body.principal_inertia[2] + body.mass * (x * x + y * y)
    return body.mass, body.mass * x, body.mass * y, inertia


def main(argv: Sequence[str] | None = None) -> int:
    """Print the planted parameters of a stand-in machine."""
    parser = cli.command_line(description=main.__doc__)
    parser.add_argument("--plant", type=Path, help="stand-in file (default: the packaged one)")
    parser.add_argument("--machine", type=Path, help="machine file (default: the packaged one)")
    parser.add_argument("--json", action="store_true", help="print {name: value} in SI as JSON")
    arguments = parser.parse_args(argv)

    def body() -> None:
        entries = planted(load_stand_in(arguments.plant), load_machine(arguments.machine))
        if arguments.json:
            print(json.dumps({entry.name: entry.value for entry in entries}, indent=2))
            return
        width = max(len(entry.name) for entry in entries)
        for entry in entries:
            print(f"{entry.name:{width}}  {entry.value:12.4f}  {entry.unit}")

    return cli.run(body)
