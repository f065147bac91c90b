"""`design`: find excitation trajectories by (35), or lay out sweeps, and write them with figures of
merit and a picture."""

import argparse
import shlex
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from tqdm import tqdm

from crane_model.cli import run
from crane_model.configuration import packaged, save
from crane_model.errors import ConfigurationError
from crane_model.machine import JOINTS
from crane_model.model_file import Model, load_model
from crane_trajectory.check import Clearance, load_clearance
from crane_trajectory.excitation.campaign import after, campaign
from crane_trajectory.excitation.columns import ColumnSet
from crane_trajectory.excitation.criterion import Criterion, Kind
from crane_trajectory.excitation.limits import Limit
from crane_trajectory.excitation.picture import draw
from crane_trajectory.excitation.problem import ExcitationProblem, planar_machine
from crane_trajectory.excitation.search import steps, workers
from crane_trajectory.excitation.settings import DesignSettings, load_design_settings
from crane_trajectory.excitation.sweeps import design_sweeps
from crane_trajectory.fourier import FourierTrajectory
from crane_trajectory.merit import figures_of_merit, information, one_period, relative_std_devs
from crane_trajectory.periodic import load_trajectory


def main(argv: Sequence[str] | None = None) -> int:
    """Command line of `ros2 run crane_trajectory design`."""
    argv = list(sys.argv[1:] if argv is None else argv)
    arguments = _parser().parse_args(argv)
    return run(lambda: _design(arguments, argv))


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(description=__doc__)
    what = parser.add_mutually_exclusive_group(required=True)
    what.add_argument("--period", type=_positive, help="of a Fourier trajectory (32) [s]")
    what.add_argument(
        "--sweeps",
        type=_share,
        nargs="+",
        metavar="SHARE",
        help="instead: every joint in turn at these shares of its velocity limit, both ways",
    )
    parser.add_argument("--dwell", type=_positive, default=3.0, help="rest between sweeps [s]")
    parser.add_argument("--harmonics", type=_count, default=5, help="N of (32)")
    parser.add_argument(
        "--criterion", type=Kind, choices=list(Kind), default=Kind.PRODUCT, help="to minimise (35)"
    )
    parser.add_argument(
        "--columns",
        type=ColumnSet,
        choices=list(ColumnSet),
        default=ColumnSet.BASE,
        help="that the criterion is of: all of the model, those of (9), or of rigid bodies alone",
    )
    parser.add_argument(
        "--count", type=_count, help="trajectories of a campaign; --out is then a new folder"
    )
    parser.add_argument(
        "--after", type=Path, nargs="+", default=[], help="trajectories already recorded"
    )
    parser.add_argument(
        "--acceleration",
        type=_bound,
        nargs="+",
        default=[],
        metavar="JOINT=VALUE",
        help="bounds [rad/s2, m/s2]; none by default",
    )
    parser.add_argument(
        "--without",
        type=Limit,
        choices=list(Limit),
        nargs="+",
        default=[],
        help="limits that do not count",
    )
    parser.add_argument("--seed", type=_seed, default=1, help="of the random starts")
    parser.add_argument("--starts", type=_count, default=16, help="local searches to run")
    parser.add_argument("--model", type=Path, help="model file; default: the crane's own")
    parser.add_argument("--settings", type=Path, help="of the search; default: data/design.yaml")
    parser.add_argument("--clearance", type=Path, help="of the tip; default: data/clearance.yaml")
    parser.add_argument("--out", type=Path, required=True, help="trajectory file to write (YAML)")
    return parser


def _design(arguments: argparse.Namespace, argv: list[str]) -> None:
    settings = load_design_settings(arguments.settings)
    model = load_model(arguments.model or packaged("crane_model", "crane_model.yaml"))
    clearance = load_clearance(arguments.clearance)
    arguments.out.parent.mkdir(parents=True, exist_ok=True)
    if arguments.sweeps:
        _sweeps(arguments, argv, settings, model, clearance)
    else:
        _search(arguments, argv, settings, model, clearance)


def _sweeps(
    arguments: argparse.Namespace,
    argv: list[str],
    settings: DesignSettings,
    model: Model,
    clearance: Clearance,
) -> None:
    machine = planar_machine(model)
    trajectory = design_sweeps(
        machine,
        clearance,
        settings.margins,
        arguments.sweeps,
        arguments.dwell,
        arguments.out.stem,
    )
    trajectory = trajectory.model_copy(update={"provenance": f"Found by {_command(argv)}."})
    save(arguments.out, trajectory)
    draw(arguments.out.with_suffix(".png"), machine, trajectory, clearance)
    print(f"period {trajectory.period:.1f} s")
    print(f"written: {arguments.out}, {arguments.out.with_suffix('.png')}")


def _search(
    arguments: argparse.Namespace,
    argv: list[str],
    settings: DesignSettings,
    model: Model,
    clearance: Clearance,
) -> None:
    criterion = Criterion.of(
        model,
        arguments.criterion,
        arguments.columns,
        settings.experiment,
        settings.plausible,
    )
    problem = ExcitationProblem(
        model,
        criterion,
        arguments.period,
        arguments.harmonics,
        settings.search,
        settings.margins,
        clearance,
        dict(arguments.acceleration),
        frozenset(arguments.without),
    )
    p = len(model.parameters)
    told = np.zeros((p, p))
    for earlier in map(_fourier, arguments.after):
        problem = after(problem, earlier)
        told += _information(model, earlier, settings)
    files = _files(arguments)
    total = len(files) * steps(problem, arguments.starts)
    with (
        workers(arguments.starts) as pool,
        tqdm(total=total, desc="design", unit="search", disable=not sys.stderr.isatty()) as bar,
    ):
        names = [file.stem for file in files]
        found = campaign(problem, names, arguments.seed, arguments.starts, pool, bar.update)
        for file, candidate in zip(files, found, strict=True):
            trajectory = candidate.trajectory
            merit = figures_of_merit(
                model, trajectory, settings.search.samples, settings.experiment, settings.plausible
            )
            told += _information(model, trajectory, settings)
            save(
                file,
                trajectory.model_copy(
                    update={
                        "figures_of_merit": {k: float(f"{v:.4g}") for k, v in merit.items()},
                        "provenance": _provenance(argv, model, settings),
                    }
                ),
            )
            picture = file.with_suffix(".png")
            draw(picture, problem.machine, trajectory, clearance)
            bar.write(_summary(merit, relative_std_devs(model, told, settings.plausible)))
            bar.write(f"written: {file}, {picture}")


def _files(arguments: argparse.Namespace) -> list[Path]:
    if arguments.count is None:
        return [arguments.out]
    try:
        arguments.out.mkdir()
    except FileExistsError:
        raise ConfigurationError(
            f"{arguments.out}: exists; a campaign is written to a new folder"
        ) from None
    width = len(str(arguments.count))
    return [
        arguments.out / f"{arguments.out.name}_{i + 1:0{width}}.yaml"
        for i in range(arguments.count)
    ]


def _fourier(path: Path) -> FourierTrajectory:
    trajectory = load_trajectory(path)
    if not isinstance(trajectory, FourierTrajectory):
        raise ConfigurationError(f"{path}: --after takes Fourier trajectories, got sweeps")
    return trajectory


def _information(
    model: Model, trajectory: FourierTrajectory, settings: DesignSettings
) -> np.ndarray:
    regressor = one_period(model, trajectory, settings.search.samples)
    return information(model, regressor, trajectory.period, settings.experiment)


def _provenance(argv: list[str], model: Model, settings: DesignSettings) -> str:
    experiment = settings.experiment
    noise = ", ".join(f"{joint} {value:g}" for joint, value in experiment.noise.items())
    columns = ", ".join(parameter.name for parameter in model.parameters)
    return (
        f"Found by {_command(argv)}. "
        f"Condition numbers are those of {len(model.parameters)} columns in SI units, "
        f"{settings.search.samples} samples of a period, with the parameters {columns}; 'report' "
        "marks those with the columns of (9) instead of the first eight. "
        f"Standard deviations are predicted for {experiment.periods} periods at "
        f"{experiment.sample_rate:g} Hz and white force noise of {noise} [N m, N]."
    )


def _command(argv: list[str]) -> str:
    """The command, with files by name: where they lay says nothing elsewhere."""
    words = [Path(word).name if "/" in word else word for word in argv]
    return shlex.join(["ros2", "run", "crane_trajectory", "design", *words])


def _summary(merit: dict[str, float], together: dict[str, float]) -> str:
    lines = [f"  {name:<40}{value:10.4g}" for name, value in merit.items()]
    if together:
        worst = max(together, key=lambda name: together[name])
        lines.append(f"  worst relative_std_dev, all recorded: {worst} {together[worst]:.3g}")
    return "\n".join(lines)


def _positive(text: str) -> float:
    value = float(text)
    if not 0.0 < value < float("inf"):
        raise argparse.ArgumentTypeError(f"must be a time above 0 s, got {text}")
    return value


def _share(text: str) -> float:
    value = float(text)
    if not 0.0 < value <= 1.0:
        raise argparse.ArgumentTypeError(f"must be above 0 and at most 1, got {text}")
    return value


def _bound(text: str) -> tuple[str, float]:
    joint, _, value = text.partition("=")
    if joint not in JOINTS or not value or not float(value) > 0.0:
        raise argparse.ArgumentTypeError(
            f"must be JOINT=VALUE with a joint of {', '.join(JOINTS)} and a value above 0, "
            f"got {text}"
        )
    return joint, float(value)


def _seed(text: str) -> int:
    value = int(text)
    if value < 0:
        raise argparse.ArgumentTypeError(f"must be at least 0, got {text}")
    return value


def _count(text: str) -> int:
    value = int(text)
    if value < 1:
        raise argparse.ArgumentTypeError(f"must be at least 1, got {text}")
    return value
