"""The command line of `design`."""

import argparse
from pathlib import Path

from crane_model.arguments import above, between, one_of, whole
from crane_model.cli import add_machine, add_replace, command_line
from crane_model.errors import ConfigurationError
from crane_trajectory.excitation.columns import ColumnSet
from crane_trajectory.excitation.criterion import CriterionKind
from crane_trajectory.excitation.limits import Limit
from crane_trajectory.motion.fourier import LONGEST_PERIOD, MOST_HARMONICS, SHORTEST_PERIOD
from crane_trajectory.motion.probe import LARGEST

OF_SETTLING = {"duration": 60.0, "load": 50.0, "terms": None}
"""Options that mean something with `--settle` alone, and what they are by default [s, kg]."""


def meant(arguments: argparse.Namespace) -> argparse.Namespace:
    """The arguments, with what is not given of OF_SETTLING; `ConfigurationError` where one of these
    is given without `--settle`.
    """
    given = [name for name in OF_SETTLING if getattr(arguments, name) is not None]
    if given and not arguments.settle:
        raise ConfigurationError(
            f"{', '.join(f'--{name}' for name in given)}: of --settle alone, which is not given; "
            "leave it out"
        )
    missing = {name: usual for name, usual in OF_SETTLING.items() if name not in given}
    return argparse.Namespace(**vars(arguments) | missing)


def parser() -> argparse.ArgumentParser:
    """What it takes."""
    result = command_line(
        description="Find excitation trajectories by (35), or lay out sweeps, and write them with "
        "figures of merit and a picture."
    )
    what = result.add_mutually_exclusive_group(required=True)
    period = between(SHORTEST_PERIOD, LONGEST_PERIOD)
    what.add_argument("--period", type=period, help="of a Fourier trajectory (32) [s]")
    what.add_argument(
        "--sweeps",
        type=above(0.0, 1.0),
        nargs="+",
        metavar="SHARE",
        help="instead: every joint in turn at these shares of its velocity limit, both ways",
    )
    what.add_argument(
        "--settle",
        type=Path,
        metavar="DIR",
        help="instead: what settles best what the diagnosis in DIR left open",
    )
    result.add_argument(
        "--duration",
        type=between(20.0, LONGEST_PERIOD),
        help=f"with --settle, of the recording [s] (default: {OF_SETTLING['duration']:g})",
    )
    result.add_argument(
        "--load",
        type=above(0.0),
        help="with --settle, a known mass that there is to hang at the tip [kg] "
        f"(default: {OF_SETTLING['load']:g})",
    )
    result.add_argument(
        "--terms", type=Path, metavar="FILE", help="with --settle, as it was given to diagnose"
    )
    result.add_argument("--dwell", type=above(0.0), default=3.0, help="rest between sweeps [s]")
    result.add_argument("--harmonics", type=whole(1, MOST_HARMONICS), default=5, help="N of (32)")
    result.add_argument(
        "--criterion",
        type=one_of(CriterionKind),
        choices=list(CriterionKind),
        default=CriterionKind.PRODUCT,
        help="to minimise (35)",
    )
    result.add_argument(
        "--columns",
        type=one_of(ColumnSet),
        choices=list(ColumnSet),
        default=ColumnSet.BASE,
        help="that the criterion is of: all of the model, those of (9), or of rigid bodies alone",
    )
    result.add_argument(
        "--count", type=whole(1), help="trajectories of a campaign; --out is then a new folder"
    )
    result.add_argument(
        "--after", type=Path, nargs="+", default=[], help="trajectories already recorded"
    )
    result.add_argument(
        "--acceleration",
        type=_bound,
        nargs="+",
        default=[],
        metavar="JOINT=VALUE",
        help="bounds [rad/s2, m/s2]; none by default",
    )
    result.add_argument(
        "--without",
        type=one_of(Limit),
        choices=list(Limit),
        nargs="+",
        default=[],
        help="limits that do not count",
    )
    result.add_argument("--seed", type=whole(0), default=1, help="of the random starts")
    result.add_argument("--starts", type=whole(1), default=16, help="local searches to run")
    result.add_argument(
        "--probe",
        type=above(0.0, LARGEST),
        metavar="COMMAND",
        help="add a pseudo-random command of this size, such as 0.02, on top of the motion: it "
        "tells how fast the valves are, in a recording of its own",
    )
    add_machine(result)
    result.add_argument("--model", type=Path, help="model file; default: the machine's")
    result.add_argument("--settings", type=Path, help="of the search; default: the machine's")
    result.add_argument("--clearance", type=Path, help="of the tip; default: the machine's")
    result.add_argument("--out", type=Path, required=True, help="trajectory file to write (YAML)")
    add_replace(result)
    return result


def _bound(text: str) -> tuple[str, float]:
    joint, _, value = text.partition("=")
    if not joint or not value or not float(value) > 0.0:
        raise argparse.ArgumentTypeError(f"must be JOINT=VALUE with a value above 0, got {text}")
    return joint, float(value)
