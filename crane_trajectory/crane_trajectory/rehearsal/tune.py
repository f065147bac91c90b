"""`ros2 run crane_trajectory tune`: tries a controller on the twin of the crane. Nothing moves."""

import argparse
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np

from crane_model import cli
from crane_model.arguments import between
from crane_model.errors import ConfigurationError, CraneError
from crane_model.machine import Machine
from crane_model.machine_files import machine_file
from crane_model.model_file import load_model
from crane_model.progress_bar import progress_bar
from crane_model.whole_crane import identified
from crane_trajectory.control.choice import NAMES, PD_DEAD_ZONE, controller
from crane_trajectory.control.controller import load_gains
from crane_trajectory.control.interface import Controller
from crane_trajectory.motion.check import load_clearance
from crane_trajectory.motion.motion import Motion, plan
from crane_trajectory.motion.periodic import PeriodicTrajectory, load_trajectory
from crane_trajectory.rehearsal.margins import (
    DELAYS,
    SCALES,
    TRIALS,
    WANTED_DELAY,
    WANTED_SCALE,
    JointMargins,
    margins,
)
from crane_trajectory.rehearsal.trials import Tried, run_trials


class MarginError(CraneError):
    """A joint of the twin swings with gains or delays that it ought to stand."""


def main(argv: Sequence[str] | None = None) -> int:
    """Try a controller on the twin of an identified crane, and print its margins; nothing moves."""
    options = _parser().parse_args(argv)
    return cli.run(lambda: _tune(options))


def _parser() -> argparse.ArgumentParser:
    parser = cli.command_line(prog="tune", description=main.__doc__)
    parser.add_argument(
        "--model", type=Path, required=True, help="model file with identified hydraulics"
    )
    parser.add_argument(
        "--law", choices=NAMES, default=PD_DEAD_ZONE, help="as of the trajectory node"
    )
    parser.add_argument(
        "--feedback-scale",
        type=between(0.05, 2.0),
        default=1.0,
        help="of the gains of laws that use the model, as of the trajectory node (default: 1)",
    )
    cli.add_machine(parser)
    parser.add_argument(
        "--controller", type=Path, help="file of the gains of (36) (default: the machine's)"
    )
    parser.add_argument(
        "--trajectory",
        type=Path,
        default=Path("excitation_20s.yaml"),
        help="file, or a bare name: that of the machine (default: %(default)s)",
    )
    return parser


def _tune(options: argparse.Namespace) -> None:
    model = load_model(options.model)
    machine, _ = identified(model)
    name = options.machine
    gains = load_gains(machine_file("controller.yaml", name, options.controller), machine).arrays
    trajectory = load_trajectory(machine_file("", name, options.trajectory))
    motion = _motion(machine, trajectory, machine_file("clearance.yaml", name))

    def made(scale: float) -> Controller:
        scaled = gains._replace(kp=scale * gains.kp, kd=scale * gains.kd)
        return controller(options.law, machine, scaled, model, scale * options.feedback_scale)

    def progress(cycles: Iterable[int]) -> Iterable[int]:
        return progress_bar("twin", over=cycles)

    tried = run_trials(model, motion, TRIALS, made, progress)
    found = dict(zip(model.joints, margins(tried), strict=True))
    _tell(machine, options.law, tried, found)
    if lacking := [joint for joint in machine.joint_names if joint not in model.joints]:
        print(f"not tried, the model lacks them: {', '.join(lacking)}")
    bad = {joint: one for joint, one in found.items() if not one.suffice}
    if bad:
        raise MarginError(
            f"{', '.join(bad)}: too near to swinging; wanted are {WANTED_SCALE:g} times the gains "
            f"and {1e3 * WANTED_DELAY:g} ms. "
            + _advice(options, bad, dict(zip(machine.joint_names, gains.kp, strict=True)))
        )
    swinging = [joint for joint, one in found.items() if not one.both]
    print(
        f"each margin suffices; both at once make {', '.join(swinging)} oscillate"
        if swinging
        else "margins suffice, also both at once"
    )


def _motion(machine: Machine, trajectory: PeriodicTrajectory, clearance: Path) -> Motion:
    """One period from rest where it begins; other joints in the middle of their ranges."""
    limits = machine.limits.values()
    start = np.array([0.5 * (one.position_min + one.position_max) for one in limits])
    begin = trajectory.evaluate(np.zeros(1)).position[0]
    for joint, position in zip(trajectory.joint_names, begin, strict=True):
        if joint not in machine.joint_names:
            raise ConfigurationError(
                f"trajectory '{trajectory.name}': moves {joint}, which {machine.name} does not have"
            )
        start[machine.index(joint)] = position
    return plan(machine, trajectory, start, 1, load_clearance(clearance))


def _tell(machine: Machine, law: str, tried: Tried, found: dict[str, JointMargins]) -> None:
    """Print a row for each joint."""
    print(f"{law} on the twin, up to {SCALES[-1]:g} times the gains and {1e3 * DELAYS[-1]:g} ms:")
    print(f"{'joint':16s}{'RMS error':>14s}{'gain margin':>14s}{'delay margin':>14s}  both")
    for (joint, one), rms in zip(found.items(), tried.rms[0], strict=True):
        error = f"{1e3 * rms:.2f} m{machine.units[joint]}"
        gain = f"{_least(one.gain, SCALES)}{one.gain:g}"
        delay = f"{_least(one.delay, DELAYS)}{1e3 * one.delay:g} ms"
        both = "stands" if one.both else "swings"
        print(f"{joint:16s}{error:>14s}{gain:>14s}{delay:>14s}  {both}")
    print(f"both: {WANTED_SCALE:g} times the gains and {1e3 * WANTED_DELAY:g} ms at once")


def _least(value: float, steps: Sequence[float]) -> str:
    return ">= " if value == steps[-1] else ""


def _advice(options: argparse.Namespace, bad: dict[str, JointMargins], kp: dict[str, float]) -> str:
    if options.law == PD_DEAD_ZONE:
        changes = (f"kp of {joint} to {one.advised * kp[joint]:.3g}" for joint, one in bad.items())
        return f"Lower {', '.join(changes)} in the controller file, kd alike, and tune again"
    scale = options.feedback_scale * min(one.advised for one in bad.values())
    return f"Give feedback_scale {scale:.2g} to the trajectory node, and tune with it again"
