"""The command `machine`: draw and check a machine file, or write one from a URDF."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from crane_model import cli
from crane_model.array import Array
from crane_model.inspection import (
    findings,
    placed_bars,
    placed_joints,
    poses,
    reached,
    table,
    travels,
)
from crane_model.kinematics import link_transforms, tip_position
from crane_model.machine import Machine, load_machine
from crane_model.urdf_reading import (
    LinkBody,
    bodies_from_urdf,
    machine_file_from_urdf,
    masses_beside,
    prior_file,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

ARM, CYLINDER, LINK, REACH, JOINT = "#e07b1a", "#1f5fa8", "#7a8691", "#c2cad1", "#333333"
POSE_NAMES = ("all joints at their lower limits", "in the middle", "at their upper limits")


def picture(machine: Machine) -> "Figure":
    """Side views in the upright plane from the base to the tip, and the lever arms [m]."""
    from matplotlib.figure import Figure  # half a second to import

    figure = Figure(figsize=(15.0, 4.6), layout="constrained")
    *sides, last = figure.subplots(1, 4)
    places = reached(machine)
    for axes, q, name in zip(sides, poses(machine), POSE_NAMES, strict=True):
        _reach(axes, machine, places)
        _arm(axes, machine, q)
        axes.set(title=name, xlabel="ahead [m]", aspect="equal")
    sides[0].set_ylabel("height [m]")
    _levers(last, machine)
    figure.suptitle(machine.name)
    return figure


def _ahead(machine: Machine, q: Array) -> Array:
    """(3,) horizontal unit vector of the view: where the arm points."""
    up = -machine.gravity_vector / machine.gravity
    joints, links = placed_joints(machine, q), link_transforms(machine, q)[0]
    tip = (links[-1] @ machine.tool.matrix)[:3, 3]
    for place in (tip - joints[0, :3, 3], *(links[:, :3, 3] - joints[0, :3, 3])):
        level = place - (place @ up) * up
        if (length := float(np.linalg.norm(level))) > 1e-6:
            ahead: Array = level / length
            break
    else:
        ahead = np.array([1.0, 0.0, 0.0])
    side = links[0, :3, 0]  # so that the arm may reach back over itself
    return -ahead if ahead @ side < -1e-9 and len(machine.joints) > 1 else ahead


def _seen(machine: Machine, q: Array, places: Array) -> tuple[Array, Array]:
    """Points (n, 3) in the view: how far ahead and how high [m]."""
    return places @ _ahead(machine, q), places @ (-machine.gravity_vector / machine.gravity)


def _reach(axes: "Axes", machine: Machine, places: Array) -> None:
    up = -machine.gravity_vector / machine.gravity
    height = places @ up
    radius = np.linalg.norm(places - height[:, None] * up, axis=1)
    axes.plot(radius, height, ",", color=REACH, zorder=0, rasterized=True)


def _arm(axes: "Axes", machine: Machine, q: Array) -> None:
    joints = placed_joints(machine, q)
    line = [np.zeros(3), *joints[:, :3, 3], tip_position(machine, q)[0]]
    axes.plot(*_seen(machine, q, np.array(line)), "-", color=ARM, linewidth=3.0, zorder=1)
    axes.plot(*_seen(machine, q, joints[:, :3, 3]), "o", color=JOINT, markersize=4, zorder=3)
    for bar in placed_bars(machine, q):
        ends = np.array([bar.begin, bar.end])
        colour, width = (CYLINDER, 4.0) if bar.is_cylinder else (LINK, 2.0)
        axes.plot(*_seen(machine, q, ends), "-", color=colour, linewidth=width, zorder=2)
        axes.plot(*_seen(machine, q, ends), ".", color=JOINT, markersize=5, zorder=3)


def _levers(axes: "Axes", machine: Machine) -> None:
    for travel in travels(machine):
        limits = machine.limits[travel.joint]
        grid = np.linspace(limits.position_min, limits.position_max, 201)
        lever = np.abs(machine.cylinder(travel.joint, grid)[:, 1])
        if np.ptp(lever) > 0.0:
            axes.plot(np.linspace(0.0, 1.0, len(grid)), lever, label=travel.joint)
    axes.set(title="lever arms", xlabel="share of the joint's range", ylabel="|dx/dq| [m]")
    axes.set_ylim(bottom=0.0)
    if axes.lines:
        axes.legend(frameon=False)
    else:  # each is a constant, which the table tells
        axes.set_axis_off()


@dataclass(frozen=True)
class _Request:
    check: str | None  # machine
    urdf: Path | None
    tip: str | None  # link
    prior: Path | None
    out: Path | None
    replace: bool


def main(argv: Sequence[str] | None = None) -> int:
    """Check and draw a machine, or write a machine file from a URDF."""
    parser = cli.command_line(description=main.__doc__)
    what = parser.add_mutually_exclusive_group(required=True)
    what.add_argument(
        "--check",
        metavar="MACHINE",
        help="machine to check and draw: name of a shipped machine, folder or machine file",
    )
    what.add_argument(
        "--urdf", type=Path, help="URDF to write a machine file from; missing values are marked"
    )
    parser.add_argument("--tip", help="with --urdf: last link of the arm")
    parser.add_argument(
        "--prior",
        type=Path,
        help="with --urdf: new prior file for the bodies, for `identify --prior`",
    )
    parser.add_argument(
        "--out",
        type=Path,
        help="picture (PNG) or machine file to write (default: named after the machine)",
    )
    cli.add_replace(parser)
    request = _Request(**vars(parser.parse_args(argv)))

    def body() -> None:
        if request.urdf is not None:
            out = request.out or request.urdf.with_suffix(".yaml")
            targets = [out] if request.prior is None else [out, request.prior]
            cli.check_out(*targets, replace=request.replace)
            text, missing = machine_file_from_urdf(request.urdf, request.tip)
            bodies = bodies_from_urdf(request.urdf, request.tip)
            out.write_text(text, encoding="utf-8")
            print(f"{out}: written; enter what is marked MISSING ({missing} places), then --check")
            if request.prior is not None:
                request.prior.write_text(prior_file(bodies, request.urdf.name), encoding="utf-8")
                count = sum(body.known for body in bodies)
                print(f"{request.prior}: written; {count} of {len(bodies)} bodies are known")
            for line in impossible(bodies):
                print(f"{request.urdf}: {line}")
            if beside := masses_beside(request.urdf, request.tip):
                named = ", ".join(f"{link} ({mass:g} kg)" for link, mass in beside.items())
                print(
                    f"{request.urdf}: left out, for other joints than those of the arm move them: "
                    f"{named}; name the end of the arm by --tip"
                )
            return
        machine = load_machine(request.check)
        out = request.out or Path(f"{machine.name.replace(' ', '_')}.png")
        cli.check_out(out, replace=request.replace)
        print(told(machine))
        picture(machine).savefig(out, dpi=110)
        print(f"\n{out}: the arm in three poses, with cylinders and reach")

    return cli.run(body)


def impossible(bodies: Sequence[LinkBody]) -> list[str]:
    """A line for each link of a URDF whose inertial no body has."""
    return [
        f"link '{inertial.link}': no body has its inertial: "
        + (
            f"principal moments of inertia {_moments(inertial.principal)} kg m2, of which the "
            f"largest exceeds the sum of the other two by {inertial.excess:.3g}; correct <inertia>"
            if inertial.mass > 0.0
            else f"a mass of {inertial.mass:g} kg, which must be positive; correct <mass>"
        )
        for body in bodies
        for inertial in body.impossible
    ]


def _moments(principal: Array) -> str:
    return ", ".join(f"{moment:.3g}" for moment in principal)


def told(machine: Machine) -> str:
    """Abilities of the machine, and inconsistencies in its file."""
    places = reached(machine)
    up = -machine.gravity_vector / machine.gravity
    height = places @ up
    ahead = ((places - height[:, None] * up) ** 2).sum(axis=1) ** 0.5
    found = findings(machine)
    return "\n".join(
        [
            f"{machine.name}: {len(machine.joint_names)} joints",
            "",
            table(machine),
            "",
            f"The tip gets {ahead.max():.2f} m away from the base's axis, and from "
            f"{height.min():.2f} m to {height.max():.2f} m high.",
            "",
            *(found and ["Check:", *(f"  - {line}" for line in found)]),
            *([] if found else ["Nothing is inconsistent."]),
        ]
    )
