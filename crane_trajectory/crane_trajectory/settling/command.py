"""`design --settle`: from the folder of a diagnosis to the motion that settles what it left."""

import argparse

import numpy as np

from crane_model.configuration import save
from crane_model.errors import ConfigurationError
from crane_model.machine_files import machine_file
from crane_model.model_file import Model, load_model
from crane_model.open_question import OpenQuestions, read_open
from crane_model.progress_bar import progress_bar
from crane_model.terms import load_terms
from crane_trajectory.excitation.columns import ColumnSet
from crane_trajectory.excitation.criterion import Criterion, CriterionKind
from crane_trajectory.excitation.picture import draw
from crane_trajectory.excitation.problem import ExcitationProblem, machine_of
from crane_trajectory.excitation.settings import DesignSettings, load_design_settings
from crane_trajectory.motion.check import Clearance, load_clearance
from crane_trajectory.settling.answers import beyond, lines, open_lines, plan_of
from crane_trajectory.settling.courses import CourseDraws
from crane_trajectory.settling.series import FourierDraws
from crane_trajectory.settling.settling import (
    Family,
    Machinery,
    Settling,
    model_of,
    pairs_of,
)

PERIODS = 3  # of a recording: what repeats tells its noise
HARMONICS = (3, 6)  # of Fourier series
QUICKER = (1.0, 0.4)  # periods of these, over that of a course


def settle(arguments: argparse.Namespace, provenance: str) -> None:
    """Print and write the motion; raises `CraneError` with what is wrong."""
    folder, name = arguments.settle, arguments.machine
    if arguments.terms:
        load_terms(arguments.terms)
    open_ = read_open(folder / "findings.json")
    if not open_.questions:
        print("nothing is open that a motion could settle")
        return
    model = load_model(folder / "model.yaml").of_machine()
    settings = load_design_settings(machine_file("design.yaml", name, arguments.settings))
    clearance = load_clearance(machine_file("clearance.yaml", name, arguments.clearance))
    print("\n".join(open_lines(open_)))
    asked = _settling(model, open_, settings, clearance, arguments.duration, arguments.starts)
    settling = asked.foretellable(arguments.seed)
    print("\n".join(beyond(asked, settling, open_)))
    if not settling.pairs:
        return
    with progress_bar("design", settling.steps) as bar:
        best = settling.recording(settling.search(arguments.seed, bar.update))
    arguments.out.parent.mkdir(parents=True, exist_ok=True)
    file, picture = arguments.out, arguments.out.with_suffix(".png")
    told = plan_of(settling, open_, best, file.name, arguments.load)
    save(
        file,
        best.trajectory.model_copy(update={"name": file.stem, "provenance": provenance}),
    )
    told.write(file.with_suffix(".json"))
    draw(picture, machine_of(model), best.trajectory, clearance)
    print("\n".join(lines(told)))
    print(f"{best.periods} periods, {best.duration:.0f} s:")
    print(
        f"  ros2 run crane_trajectory run_excitation --periods {best.periods} --enable "
        f"--trajectory {file}"
    )
    print(f"written: {file}, {file.with_suffix('.json')}, {picture}")


def _settling(
    model: Model,
    open_: OpenQuestions,
    settings: DesignSettings,
    clearance: Clearance,
    duration: float,
    starts: int,
) -> Settling:
    noise = np.array([open_.noise.get(joint) or np.inf for joint in model.joints])
    if not np.isfinite(noise).any() or not open_.row_rate:
        raise ConfigurationError(
            "findings.json: key 'open.noise': of no joint; diagnose with recordings that move it"
        )
    models = tuple(model_of(model, question) for question in open_.questions)
    asked = {member.joint for one in open_.questions for member in one.members}
    joints = tuple(joint for joint in model.joints if joint in asked or "all" in asked)
    courses = CourseDraws(
        machine_of(model), model.joints, joints, clearance, settings.margins, duration / PERIODS
    )
    unasked = Criterion.of(
        model, CriterionKind.RAW, ColumnSet.BASE, settings.experiment, settings.plausible
    )
    families: list[Family] = [courses]
    for harmonics, quicker in zip(HARMONICS, QUICKER, strict=True):
        families.append(
            FourierDraws(
                ExcitationProblem(
                    model,
                    unasked,
                    round(quicker * duration / PERIODS, 2),
                    harmonics,
                    settings.search,
                    settings.margins,
                    clearance,
                )
            )
        )
    machinery = Machinery(models, noise, open_.row_rate)
    return Settling(machinery, tuple(pairs_of(open_)), tuple(families), duration, starts)
