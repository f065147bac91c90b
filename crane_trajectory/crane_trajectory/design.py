"""`design`: find an excitation trajectory by (35) and write it with its figures of merit."""

import argparse
import shlex
from collections.abc import Sequence
from pathlib import Path

from tqdm import tqdm

from crane_model.cli import run
from crane_model.configuration import packaged, save
from crane_model.errors import RangeError
from crane_model.model_file import Model, load_model
from crane_trajectory.check import load_clearance
from crane_trajectory.excitation import (
    Candidate,
    DesignSettings,
    ExcitationProblem,
    load_design_settings,
    search,
)
from crane_trajectory.fourier import FourierTrajectory
from crane_trajectory.merit import figures_of_merit


def main(argv: Sequence[str] | None = None) -> int:
    """Command line of `ros2 run crane_trajectory design`."""
    arguments = _parser().parse_args(argv)
    return run(lambda: _design(arguments))


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="design", description=__doc__)
    parser.add_argument("--period", type=_seconds, required=True, help="period [s]")
    parser.add_argument("--harmonics", type=_count, default=5, help="N of (32)")
    parser.add_argument("--seed", type=_seed, default=1, help="of the random starts")
    parser.add_argument("--starts", type=_count, default=8, help="local searches to run")
    parser.add_argument("--model", type=Path, help="model file; default: the crane's own")
    parser.add_argument("--out", type=Path, required=True, help="trajectory file to write (YAML)")
    return parser


def _design(arguments: argparse.Namespace) -> None:
    settings = load_design_settings()
    model = load_model(arguments.model or packaged("crane_model", "crane_model.yaml"))
    problem = ExcitationProblem(
        model, arguments.period, arguments.harmonics, settings.search, load_clearance()
    )
    candidates = list(
        tqdm(
            search(problem, arguments.seed, arguments.starts, arguments.out.stem),
            total=arguments.starts,
            unit="start",
            desc="design",
        )
    )
    best = _best(candidates, arguments)
    merit = figures_of_merit(
        model, best, settings.search.samples, settings.experiment, settings.plausible
    )
    provenance = _provenance(arguments, model, settings)
    save(
        arguments.out,
        best.model_copy(
            update={
                "figures_of_merit": {key: float(f"{value:.4g}") for key, value in merit.items()},
                "provenance": provenance,
            }
        ),
    )
    print(_summary(candidates, merit))
    print(f"written: {arguments.out}")


def _best(candidates: list[Candidate], arguments: argparse.Namespace) -> FourierTrajectory:
    usable = [candidate for candidate in candidates if candidate.within_limits]
    if not usable:
        raise RangeError(
            f"period {arguments.period} s, {arguments.harmonics} harmonics: none of "
            f"{arguments.starts} starts led to a trajectory within the limits; try more --starts "
            "or another --seed"
        )
    return min(usable, key=lambda candidate: candidate.criterion).trajectory


def _provenance(arguments: argparse.Namespace, model: Model, settings: DesignSettings) -> str:
    command = ["ros2", "run", "crane_trajectory", "design"]
    command += ["--period", f"{arguments.period:g}", "--harmonics", str(arguments.harmonics)]
    command += ["--seed", str(arguments.seed), "--starts", str(arguments.starts)]
    if arguments.model:
        command += ["--model", arguments.model.name]
    command += ["--out", arguments.out.name]
    experiment = settings.experiment
    noise = ", ".join(f"{joint} {value:g}" for joint, value in experiment.noise.items())
    columns = ", ".join(parameter.name for parameter in model.parameters)
    return (
        f"Found by {shlex.join(command)}. "
        f"Condition numbers are those of {len(model.parameters)} columns in SI units, "
        f"{settings.search.samples} samples of a period, with the parameters {columns}. "
        f"Standard deviations are predicted for {experiment.periods} periods at "
        f"{experiment.sample_rate:g} Hz and white force noise of {noise} [N m, N]."
    )


def _summary(candidates: list[Candidate], merit: dict[str, float]) -> str:
    seconds = sum(candidate.seconds for candidate in candidates) / len(candidates)
    usable = sum(candidate.within_limits for candidate in candidates)
    lines = [f"{usable} of {len(candidates)} starts within limits, {seconds:.1f} s a start"]
    lines += [f"  {name:<40}{value:10.4g}" for name, value in merit.items()]
    return "\n".join(lines)


def _seconds(text: str) -> float:
    value = float(text)
    if not 0.0 < value < float("inf"):
        raise argparse.ArgumentTypeError(f"must be a time above 0 s, got {text}")
    return value


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
