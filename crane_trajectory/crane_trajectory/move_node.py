"""`ros2 run crane_trajectory move`: takes the tip along lines and arcs, planned before it moves.

HAZARD: with `--run` the crane moves by itself. Ctrl-C brings it to rest; software is not a safety
stop.
"""

import argparse
import sys
import tempfile
from collections.abc import Sequence
from contextlib import nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from crane_model.cli import (
    INTERRUPTED,
    above,
    add_machine,
    add_replace,
    check_out,
    command_line,
    run,
)
from crane_model.configuration import save
from crane_model.errors import ConfigurationError
from crane_model.kinematics import tip_position
from crane_model.machine import Machine, load_machine, parse_pose
from crane_model.machine_files import machine_file
from crane_nodes.managed import own_arguments, ros
from crane_trajectory.motion.check import TipClearance, draw, load_clearance
from crane_trajectory.motion.motion import plan
from crane_trajectory.motion.tip_path import Arc, Segment, StraightLine, TipPath, plan_tip_path
from crane_trajectory.run_excitation_node import RunExcitationClient, tell

DEFAULT_SPEED = 0.1  # m/s
DEFAULT_ACCELERATION = 0.1  # m/s2


@dataclass(frozen=True)
class Move:
    """Request of the command."""

    machine: str | None
    points: Sequence[tuple[str, tuple[float, ...]]]  # `to` or `through`, and the point [m]
    relative: bool
    speed: float  # m/s
    acceleration: float  # m/s2
    pose: Sequence[str]  # JOINT=VALUE; empty: where the crane is
    out: Path | None
    picture: Path | None
    replace: bool
    run: bool
    enable: bool


def segments(move: Move, machine: Machine, start: np.ndarray) -> list[Segment]:
    """Lines and arcs in the base frame, from the tip at `start` (j,); `ConfigurationError`."""
    tip_clearance, here = TipClearance(machine), tip_position(machine, start[np.newaxis])[0]
    found: list[Segment] = []
    through: np.ndarray | None = None
    for kind, given in move.points:
        if len(given) == 3:
            point = np.array(given) + (here if move.relative else 0.0)
        else:
            origin = (
                tip_clearance.at(machine.joint_names, start[np.newaxis])[0]
                if move.relative
                else 0.0
            )
            point = tip_clearance.point(start, *(np.array(given) + origin).tolist())
        if kind == "through":
            if through is not None:
                raise ConfigurationError("--through: give the end of its arc by --to behind it")
            through = point
            continue
        found.append(StraightLine(point) if through is None else Arc(through, point))
        through, here = None, point
    if through is not None or not found:
        raise ConfigurationError("--to: give at least one point, and one behind each --through")
    return found


def main(argv: Sequence[str] | None = None) -> int:
    """Plan and check a path of the tip; with --run, move the crane along it."""
    argv = sys.argv if argv is None else ["move", *argv]
    move = _request(_parser().parse_args(own_arguments(argv[1:])))
    interrupted = False

    def body() -> None:
        nonlocal interrupted
        check_out(*filter(None, (move.out, move.picture)), replace=move.replace)
        machine = load_machine(move.machine)
        if move.pose and not move.run:
            _planned(move, machine, posed(machine, move.pose))
            return
        with ros(argv) as stop:
            client = RunExcitationClient(stop, "move")
            path = _planned(move, machine, client.position(machine))
            if not move.run:
                return
            with tempfile.TemporaryDirectory() as folder:
                file = Path(folder) / "tip_path.yaml"
                save(file, path.trajectory)
                with client.enabled() if move.enable else nullcontext():
                    result = client.run(file, 1)
            interrupted = stop.requested
        tell(result)

    status = run(body)
    return INTERRUPTED if interrupted and status else status


def posed(machine: Machine, words: Sequence[str]) -> np.ndarray:
    """(j,) the pose [rad, m]; joints that are not named are in the middle of their ranges."""
    return parse_pose(words, machine, machine.ranges().middle)


def _planned(move: Move, machine: Machine, start: np.ndarray) -> TipPath:
    """The path, checked with its way from rest to rest, told, and written where it is wanted."""
    wanted = segments(move, machine, start)
    path = plan_tip_path(machine, start, wanted, move.speed, move.acceleration)
    clearance = load_clearance(machine_file("clearance.yaml", move.machine))
    plan(machine, path.trajectory, start, 1, clearance)
    print(summary(machine, path, move.speed))
    if move.out:
        save(move.out, path.trajectory)
        print(f"written: {move.out}; run it by run_excitation --trajectory {move.out} --periods 1")
    if move.picture:
        draw(move.picture, machine, path.trajectory, clearance)
        print(f"picture: {move.picture}")
    return path


def summary(machine: Machine, path: TipPath, wanted: float) -> str:
    """The planned path in a few lines."""
    points, trajectory = [path.tip[0], path.tip[-1]], path.trajectory
    begin, end = (f"({', '.join(f'{value:z.3f}' for value in point)}) m" for point in points)
    slower = f" instead of {wanted:g} m/s, for {path.limited_by}" if path.limited_by else ""
    motion = trajectory.evaluate(np.linspace(0.0, trajectory.period, 1000))
    lines = [
        f"tip from {begin} to {end}: {path.length:.3f} m in {trajectory.period:.1f} s, "
        f"at most {path.speed:.3g} m/s{slower}"
    ]
    for i, joint in enumerate(machine.joint_names):
        limit, unit = machine.limits[joint], machine.units[joint]
        position, velocity = motion.position[:, i], motion.velocity[:, i]
        share = np.maximum(velocity / limit.velocity_max, velocity / limit.velocity_min).max()
        lines.append(
            f"  {joint:<12} {position[0]:+.3f} to {position[-1]:+.3f} {unit}, between "
            f"{position.min():+.3f} and {position.max():+.3f}; {share:.0%} of its speed limit"
        )
    return "\n".join(lines)


class _Point(argparse.Action):
    """Keeps `--to` and `--through` in their order."""

    def __call__(
        self,
        parser: argparse.ArgumentParser,
        namespace: argparse.Namespace,
        values: Any,
        option_string: str | None = None,
    ) -> None:
        if len(values) not in (2, 3):
            parser.error(f"{option_string}: X Y Z or DISTANCE HEIGHT, got {len(values)} numbers")
        kind = str(option_string).removeprefix("--")
        namespace.points = [*namespace.points, (kind, tuple(values))]


def _parser() -> argparse.ArgumentParser:
    parser = command_line(prog="move", description=main.__doc__)
    points = {
        "--to": "next point of the tip [m]: three numbers in the base frame, or distance from the "
        "pillar and height; once for each line",
        "--through": "point of an arc, whose end is the next --to",
    }
    for option, meaning in points.items():
        parser.add_argument(
            option,
            dest="points",
            type=float,
            nargs="+",
            action=_Point,
            default=[],
            metavar="METRES",
            help=meaning,
        )
    parser.add_argument("--relative", action="store_true", help="count points from the present tip")
    parser.add_argument(
        "--speed",
        type=above(0.0),
        default=DEFAULT_SPEED,
        help="largest speed of the tip [m/s] (default: %(default)s)",
    )
    parser.add_argument(
        "--acceleration",
        type=above(0.0),
        default=DEFAULT_ACCELERATION,
        help="largest acceleration along the path [m/s2] (default: %(default)s)",
    )
    add_machine(parser)
    parser.add_argument(
        "--pose",
        nargs="+",
        default=[],
        metavar="JOINT=VALUE",
        help="initial positions without a crane [rad, m]; other joints are in the "
        "middle of their ranges (default: present positions of the crane)",
    )
    parser.add_argument("--out", type=Path, metavar="FILE", help="trajectory file to write")
    parser.add_argument("--picture", type=Path, metavar="FILE", help="picture to write")
    add_replace(parser)
    parser.add_argument("--run", action="store_true", help="move the crane (default: only plan)")
    parser.add_argument(
        "--enable", action="store_true", help="enable the driver before, and disable it after"
    )
    return parser


def _request(options: argparse.Namespace) -> Move:
    if options.run and options.pose:
        raise SystemExit("move: --pose plans without a crane, --run moves it; leave one out")
    return Move(**vars(options))


if __name__ == "__main__":
    sys.exit(main())
