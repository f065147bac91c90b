"""The command `machine`: check a machine file, or write one from a URDF."""

from collections.abc import Sequence
from pathlib import Path

from crane_model import cli
from crane_model.array import Array
from crane_model.inspection.findings import findings, reached, table
from crane_model.inspection.picture import picture
from crane_model.machine import Machine, load_machine
from crane_model.urdf_reading import (
    LinkBody,
    bodies_from_urdf,
    machine_file_from_urdf,
    prior_file,
)


def main(argv: Sequence[str] | None = None) -> int:
    """Look at a machine before it matters, or write its file from a URDF."""
    parser = cli.command_line(description=main.__doc__)
    what = parser.add_mutually_exclusive_group(required=True)
    what.add_argument(
        "--check",
        metavar="MACHINE",
        help="draw and check a machine: a shipped one's name, a folder or a machine file",
    )
    what.add_argument(
        "--urdf", type=Path, help="write the machine file of a URDF, with what is missing marked"
    )
    parser.add_argument("--tip", help="of --urdf: the link at which the arm ends")
    parser.add_argument(
        "--prior",
        type=Path,
        help="of --urdf: file for the bodies of its links, as what identify --prior takes",
    )
    parser.add_argument("--out", type=Path, help="PNG or machine file (default: after the machine)")
    cli.add_replace(parser)
    arguments = parser.parse_args(argv)

    def body() -> None:
        if arguments.urdf is not None:
            out = arguments.out or arguments.urdf.with_suffix(".yaml")
            targets = [out] if arguments.prior is None else [out, arguments.prior]
            cli.check_out(*targets, replace=arguments.replace)
            text, missing = machine_file_from_urdf(arguments.urdf, arguments.tip)
            bodies = bodies_from_urdf(arguments.urdf, arguments.tip)
            out.write_text(text, encoding="utf-8")
            print(f"{out}: written; enter what is marked MISSING ({missing} places), then --check")
            if arguments.prior is not None:
                arguments.prior.write_text(
                    prior_file(bodies, arguments.urdf.name), encoding="utf-8"
                )
                count = sum(body.known for body in bodies)
                print(f"{arguments.prior}: written; {count} of {len(bodies)} bodies are known")
            for line in impossible(bodies):
                print(f"{arguments.urdf}: {line}")
            return
        machine = load_machine(arguments.check)
        out = arguments.out or Path(f"{machine.name.replace(' ', '_')}.png")
        cli.check_out(out, replace=arguments.replace)
        print(told(machine))
        picture(machine).savefig(out, dpi=110)
        print(f"\n{out}: the arm in three poses, with cylinders and reach")

    return cli.run(body)


def impossible(bodies: Sequence[LinkBody]) -> list[str]:
    """A line for each link of a URDF whose inertial no body has."""
    return [
        f"link '{one.link}': no body has its inertial: "
        + (
            f"principal moments of inertia {_moments(one.principal)} kg m2, of which the largest "
            f"exceeds the sum of the other two by {one.excess:.3g}; correct <inertia>"
            if one.mass > 0.0
            else f"a mass of {one.mass:g} kg, which must be positive; correct <mass>"
        )
        for body in bodies
        for one in body.impossible
    ]


def _moments(principal: Array) -> str:
    return ", ".join(f"{moment:.3g}" for moment in principal)


def told(machine: Machine) -> str:
    """What the machine can do, and what is inconsistent in its file."""
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
