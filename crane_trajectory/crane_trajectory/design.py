"""`design`: find excitation trajectories by (35), or lay out sweeps, and write them with figures of
merit and a picture.
"""

import argparse
import shlex
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

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
from crane_trajectory.excitation.discrimination import DiscriminationRequest, discriminate
from crane_trajectory.excitation.limits import DesignSettings, Limit, load_design_settings
from crane_trajectory.excitation.search import (
    ExcitationProblem,
    after,
    campaign,
    machine_of,
    steps,
    workers,
)
from crane_trajectory.excitation.sweeps import design_sweeps
from crane_trajectory.motion.check import Clearance, draw, load_clearance
from crane_trajectory.motion.motion import RUN_UP
from crane_trajectory.motion.periodic import (
    LARGEST_PROBE,
    LONGEST_PERIOD,
    MOST_HARMONICS,
    SHORTEST_PERIOD,
    FourierTrajectory,
    Probe,
    load_trajectory,
)

OF_DISCRIMINATION = {"duration": 60.0, "load": 50.0, "terms": None}
"""Options that mean something with `--discriminate` alone, and what they are by default [s, kg]."""


@dataclass(frozen=True)
class DesignRequest:
    """Request of `design`."""

    period: float | None  # s, of a Fourier trajectory
    sweeps: list[float] | None  # shares of the velocity limits
    discriminate: Path | None  # folder of a diagnosis
    duration: float  # s
    load: float  # kg
    terms: Path | None
    dwell: float  # s
    harmonics: int
    criterion: CriterionKind
    columns: ColumnSet
    count: int | None
    after: list[Path]
    acceleration: list[tuple[str, float]]
    without: list[Limit]
    seed: int
    starts: int
    probe: float | None
    machine: str
    model: Path | None
    settings: Path | None
    clearance: Path | None
    out: Path
    replace: bool
    command: str  # as it was typed, with files by name: where they lay says nothing elsewhere

    @classmethod
    def of(cls, options: dict[str, Any], argv: list[str]) -> "DesignRequest":
        """From options; `ConfigurationError` if one of `--discriminate` is given without it."""
        given = [name for name in OF_DISCRIMINATION if options[name] is not None]
        if given and not options["discriminate"]:
            raise ConfigurationError(
                f"{', '.join(f'--{name}' for name in given)}: of --discriminate alone, which is "
                "not given; leave it out"
            )
        missing = {name: usual for name, usual in OF_DISCRIMINATION.items() if name not in given}
        words = [Path(word).name if "/" in word else word for word in argv]
        command = shlex.join(["ros2", "run", "crane_trajectory", "design", *words])
        return cls(**options | missing, command=command)

    @property
    def added(self) -> Probe | None:
        return None if self.probe is None else Probe(amplitude=self.probe)


def parser() -> argparse.ArgumentParser:
    """The command line of `design`."""
    result = command_line(
        description="Design excitation trajectories or sweeps within all limits, and write "
        "them with figures of merit and a picture."
    )
    what = result.add_mutually_exclusive_group(required=True)
    period = between(SHORTEST_PERIOD, LONGEST_PERIOD)
    what.add_argument("--period", type=period, help="period of a Fourier trajectory [s]")
    what.add_argument(
        "--sweeps", type=above(0.0, 1.0), nargs="+", metavar="SHARE",
        help="sweeps instead: velocities of each joint in turn, relative to its "
        "velocity limit, in both directions",
    )  # fmt: skip
    what.add_argument(
        "--discriminate", type=Path, metavar="DIR",
        help="folder of a diagnosis; the motion discriminates best between its open "
        "effects",
    )  # fmt: skip
    add = result.add_argument
    add(
        "--duration", type=between(20.0, LONGEST_PERIOD),
        help="with --discriminate: duration of the recording [s] "
        f"(default: {OF_DISCRIMINATION['duration']:g})",
    )  # fmt: skip
    add(
        "--load", type=above(0.0),
        help="with --discriminate: known mass that is available for the tip [kg] "
        f"(default: {OF_DISCRIMINATION['load']:g})",
    )  # fmt: skip
    add(
        "--terms",
        type=Path,
        metavar="FILE",
        help="with --discriminate: Python file of terms that was given to diagnose",
    )
    add("--dwell", type=above(0.0), default=3.0, help="rest between sweeps [s] (default: 3)")
    add(
        "--harmonics",
        type=whole(1, MOST_HARMONICS),
        default=5,
        help="number of harmonics (default: 5)",
    )
    add(
        "--criterion", type=one_of(CriterionKind), choices=list(CriterionKind),
        default=CriterionKind.PRODUCT, help="criterion to minimise (default: %(default)s)",
    )  # fmt: skip
    add(
        "--columns", type=one_of(ColumnSet), choices=list(ColumnSet), default=ColumnSet.BASE,
        help="terms that count: all of the model, those of the paper, or rigid bodies "
        "only",
    )  # fmt: skip
    add(
        "--count",
        type=whole(1),
        help="number of trajectories that complement each other; --out is then a new folder",
    )
    add(
        "--after",
        type=Path,
        nargs="+",
        default=[],
        help="trajectory files that were already recorded",
    )
    add(
        "--acceleration", type=_bound, nargs="+", default=[], metavar="JOINT=VALUE",
        help="acceleration limits [rad/s2, m/s2] (default: none)",
    )  # fmt: skip
    add(
        "--without", type=one_of(Limit), choices=list(Limit), nargs="+", default=[],
        help="limits to ignore",
    )  # fmt: skip
    add("--seed", type=whole(0), default=1, help="seed of the random starts (default: 1)")
    add("--starts", type=whole(1), default=16, help="number of random starts (default: 16)")
    add(
        "--probe", type=above(0.0, LARGEST_PROBE), metavar="COMMAND",
        help="magnitude of an added pseudo-random valve command, such as 0.02, which "
        "shows the speed of the valves",
    )  # fmt: skip
    add_machine(result)
    add("--model", type=Path, help="model file (default: that of the machine)")
    add("--settings", type=Path, help="design settings (YAML; default: design.yaml of the machine)")
    add(
        "--clearance",
        type=Path,
        help="clearance of the tip (YAML; default: clearance.yaml of the machine)",
    )
    add("--out", type=Path, required=True, help="trajectory file to write (YAML)")
    add_replace(result)
    return result


def _bound(text: str) -> tuple[str, float]:
    joint, _, value = text.partition("=")
    if not joint or not value or not float(value) > 0.0:
        raise argparse.ArgumentTypeError(f"must be JOINT=VALUE with a value above 0, got {text}")
    return joint, float(value)


def main(argv: Sequence[str] | None = None) -> int:
    """Command line of `ros2 run crane_trajectory design`."""
    words = list(sys.argv[1:] if argv is None else argv)
    options = vars(parser().parse_args(words))
    return run(lambda: _design(DesignRequest.of(options, words)))


def _design(request: DesignRequest) -> None:
    out, machine = request.out, request.machine
    if request.discriminate:
        files = out, *(out.with_suffix(suffix) for suffix in (".json", ".png"))
        check_out(*files, replace=request.replace)
        discriminate(
            DiscriminationRequest(
                request.discriminate, request.terms, machine, request.settings, request.clearance,
                request.duration, request.load, request.seed, request.starts, out,
                f"Found by {request.command}.",
            )
        )  # fmt: skip
        return
    model = load_model(machine_file("model.yaml", machine, request.model))
    settings = _settings(machine_file("design.yaml", machine, request.settings), model)
    clearance = load_clearance(machine_file("clearance.yaml", machine, request.clearance))
    if request.sweeps or request.count is None:
        check_out(out, out.with_suffix(".png"), replace=request.replace)
    out.parent.mkdir(parents=True, exist_ok=True)
    if request.sweeps:
        _sweeps(request, request.sweeps, settings, model, clearance)
    else:
        assert request.period is not None  # else the parser would have refused
        _search(request, request.period, settings, model, clearance)


def _settings(path: Path, model: Model) -> DesignSettings:
    settings = load_design_settings(path)
    if missing := [joint for joint in model.joints if joint not in settings.experiment.noise]:
        raise ConfigurationError(
            f"{path}: key 'experiment.noise': no entry for {', '.join(missing)}, of the model "
            f"'{model.name}'; add it, or name settings of this machine by --machine or --settings"
        )
    return settings


def _sweeps(
    request: DesignRequest,
    shares: list[float],
    settings: DesignSettings,
    model: Model,
    clearance: Clearance,
) -> None:
    machine, out, picture = machine_of(model), request.out, request.out.with_suffix(".png")
    trajectory = design_sweeps(
        machine, model.joints, clearance, settings.margins, shares, request.dwell, out.stem
    )
    update = {"provenance": f"Found by {request.command}.", "probe": request.added}
    trajectory = trajectory.model_copy(update=update)
    save(out, trajectory)
    draw(picture, machine, trajectory, clearance)
    print(f"one period of {trajectory.period:.1f} s: {_moves(trajectory.period)}")
    print(f"written: {out}, {picture}")


def _search(
    request: DesignRequest,
    period: float,
    settings: DesignSettings,
    model: Model,
    clearance: Clearance,
) -> None:
    for joint, _ in request.acceleration:
        if joint not in model.joints:
            raise ConfigurationError(
                f"--acceleration: no joint {joint}; model '{model.name}' has "
                f"{', '.join(model.joints)}"
            )
    experiment, plausible = settings.experiment, settings.plausible
    criterion = Criterion.of(model, request.criterion, request.columns, experiment, plausible)
    problem = ExcitationProblem(
        model,
        criterion,
        period,
        request.harmonics,
        settings.search,
        settings.margins,
        clearance,
        dict(request.acceleration),
        frozenset(request.without),
    )
    p = len(model.parameters)
    told = np.zeros((p, p))
    for earlier in map(_fourier, request.after):
        problem = after(problem, earlier)
        told += _information(model, earlier, settings)
    files = _files(request.out, request.count)
    total = len(files) * steps(problem, request.starts)
    with workers(request.starts) as pool, progress_bar("design", total) as bar:
        names = [file.stem for file in files]
        found = campaign(problem, names, request.seed, request.starts, pool, bar.update)
        for file, candidate in zip(files, found, strict=True):
            trajectory, picture = candidate.trajectory, file.with_suffix(".png")
            samples = settings.search.samples
            merit = figures_of_merit(model, trajectory, samples, experiment, plausible)
            told += _information(model, trajectory, settings)
            update = {
                "figures_of_merit": {k: float(f"{v:.4g}") for k, v in merit.items()},
                "provenance": _provenance(request.command, model, settings),
                "probe": request.added,
            }
            save(file, trajectory.model_copy(update=update))
            draw(picture, problem.machine, trajectory, clearance)
            bar.write(_summary(merit, relative_std_devs(model, told, plausible)))
            bar.write(f"written: {file}, {picture}")
        periods, of_each = experiment.periods, " for each trajectory" if len(files) > 1 else ""
        bar.write(f"{periods} periods of {period:g} s{of_each}: {_moves(periods * period)}")


def _files(out: Path, count: int | None) -> list[Path]:
    if count is None:
        return [out]
    try:
        out.mkdir()
    except FileExistsError:
        raise ConfigurationError(f"{out}: exists; a campaign is written to a new folder") from None
    width = len(str(count))
    return [out / f"{out.name}_{i + 1:0{width}}.yaml" for i in range(count)]


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


def _provenance(command: str, model: Model, settings: DesignSettings) -> str:
    experiment = settings.experiment
    noise = ", ".join(f"{joint} {value:g}" for joint, value in experiment.noise.items())
    columns = ", ".join(parameter.name for parameter in model.parameters)
    return (
        f"Found by {command}. "
        f"Condition numbers are those of {len(model.parameters)} columns in SI units, "
        f"{settings.search.samples} samples of a period, with the parameters {columns}; 'report' "
        "marks those with the columns of (9) instead of the first eight. "
        f"Standard deviations are predicted for {experiment.periods} periods at "
        f"{experiment.sample_rate:g} Hz and white force noise of {noise} [N m, N]."
    )


def _summary(merit: dict[str, float], together: dict[str, float]) -> str:
    lines = [f"  {name:<40}{value:10.4g}" for name, value in merit.items()]
    if together:
        worst = max(together, key=lambda name: together[name])
        lines.append(f"  worst relative_std_dev, all recorded: {worst} {together[worst]:.3g}")
    return "\n".join(lines)


def _moves(seconds: float) -> str:
    """Return how long the crane moves in an experiment whose periods last `seconds`, in words."""
    return (
        f"the crane moves for {(seconds + 2 * RUN_UP) / 60:.1f} min with start and stop, "
        "without the approach"
    )
