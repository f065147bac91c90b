"""`design`: find excitation trajectories by (35), or lay out sweeps, and write them with figures of
merit and a picture.
"""

import argparse
import shlex
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from crane_model.cli import (
    above,
    add_machine,
    add_replace,
    between,
    check_out,
    command_line,
    one_of,
    run,
    whole,
)
from crane_model.configuration import save
from crane_model.errors import ConfigurationError
from crane_model.machine_files import machine_file
from crane_model.model_file import Model, load_model
from crane_model.progress_bar import progress_bar
from crane_trajectory.excitation.criterion import (
    ColumnSet,
    Criterion,
    CriterionKind,
    figures_of_merit,
    information,
    one_period,
    relative_std_devs,
)
from crane_trajectory.excitation.limits import DesignSettings, Limit, load_design_settings
from crane_trajectory.excitation.picture import draw
from crane_trajectory.excitation.search import (
    ExcitationProblem,
    after,
    campaign,
    machine_of,
    steps,
    workers,
)
from crane_trajectory.excitation.sweeps import design_sweeps
from crane_trajectory.motion.check import Clearance, load_clearance
from crane_trajectory.motion.motion import RUN_UP
from crane_trajectory.motion.periodic import (
    LARGEST,
    LONGEST_PERIOD,
    MOST_HARMONICS,
    SHORTEST_PERIOD,
    FourierTrajectory,
    Probe,
    load_trajectory,
)
from crane_trajectory.settling.settling import settle

# The command line of `design`.

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


def main(argv: Sequence[str] | None = None) -> int:
    """Command line of `ros2 run crane_trajectory design`."""
    argv = list(sys.argv[1:] if argv is None else argv)
    arguments = parser().parse_args(argv)
    return run(lambda: _design(meant(arguments), argv))


def _design(arguments: argparse.Namespace, argv: list[str]) -> None:
    name = arguments.machine
    if arguments.settle:
        out = arguments.out
        files = out, *(out.with_suffix(suffix) for suffix in (".json", ".png"))
        check_out(*files, replace=arguments.replace)
        settle(arguments, f"Found by {_command(argv)}.")
        return
    model = load_model(machine_file("model.yaml", name, arguments.model))
    settings = _settings(machine_file("design.yaml", name, arguments.settings), model)
    clearance = load_clearance(machine_file("clearance.yaml", name, arguments.clearance))
    if arguments.sweeps or arguments.count is None:
        check_out(arguments.out, arguments.out.with_suffix(".png"), replace=arguments.replace)
    arguments.out.parent.mkdir(parents=True, exist_ok=True)
    if arguments.sweeps:
        _sweeps(arguments, argv, settings, model, clearance)
    else:
        _search(arguments, argv, settings, model, clearance)


def _settings(path: Path, model: Model) -> DesignSettings:
    settings = load_design_settings(path)
    if missing := [joint for joint in model.joints if joint not in settings.experiment.noise]:
        raise ConfigurationError(
            f"{path}: key 'experiment.noise': no entry for {', '.join(missing)}, of the model "
            f"'{model.name}'; add it, or name settings of this machine by --machine or --settings"
        )
    return settings


def _sweeps(
    arguments: argparse.Namespace,
    argv: list[str],
    settings: DesignSettings,
    model: Model,
    clearance: Clearance,
) -> None:
    machine = machine_of(model)
    trajectory = design_sweeps(
        machine,
        model.joints,
        clearance,
        settings.margins,
        arguments.sweeps,
        arguments.dwell,
        arguments.out.stem,
    )
    update = {"provenance": f"Found by {_command(argv)}.", "probe": _probe(arguments)}
    trajectory = trajectory.model_copy(update=update)
    save(arguments.out, trajectory)
    draw(arguments.out.with_suffix(".png"), machine, trajectory, clearance)
    print(f"period {trajectory.period:.1f} s, in which {_moves(trajectory.period)}")
    print(f"written: {arguments.out}, {arguments.out.with_suffix('.png')}")


def _search(
    arguments: argparse.Namespace,
    argv: list[str],
    settings: DesignSettings,
    model: Model,
    clearance: Clearance,
) -> None:
    for joint, _ in arguments.acceleration:
        if joint not in model.joints:
            raise ConfigurationError(
                f"--acceleration: no joint {joint}; model '{model.name}' has "
                f"{', '.join(model.joints)}"
            )
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
        progress_bar("design", total) as bar,
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
                        "probe": _probe(arguments),
                    }
                ),
            )
            picture = file.with_suffix(".png")
            draw(picture, problem.machine, trajectory, clearance)
            bar.write(_summary(merit, relative_std_devs(model, told, settings.plausible)))
            bar.write(f"written: {file}, {picture}")
        periods, of_each = settings.experiment.periods, " of each" if len(files) > 1 else ""
        recorded = f"{periods} periods{of_each}, {arguments.period:g} s long"
        bar.write(f"in {recorded}, {_moves(periods * arguments.period)}")


def _probe(arguments: argparse.Namespace) -> Probe | None:
    return None if arguments.probe is None else Probe(amplitude=arguments.probe)


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


def _moves(seconds: float) -> str:
    """How long the crane moves in an experiment, if its periods last `seconds`."""
    return (
        f"the crane moves for {(seconds + 2 * RUN_UP) / 60:.1f} min, start and stop included; "
        "before that it goes to where they begin"
    )
