"""The figures of the report: its Figs. 8 to 13, and motion from commands, one per joint of each
recording."""

from collections.abc import Sequence

import numpy as np

from crane_identification.notation import spoken, unit
from crane_identification.preparation.run import Preparation
from crane_identification.report.content import Recording, left_out, scatter
from crane_identification.report.figure import (
    MEASURED,
    MODEL,
    REFERENCE,
    SCATTER,
    Band,
    Curve,
    Figure,
    Panel,
)
from crane_identification.validation.command_validation import CommandedCourse
from crane_identification.validation.force_validation import Validation
from crane_model.model_file import Model

POSITION, VELOCITY, ACCELERATION, FORCE = "q", "q̇", "q̈", "τ"


def reference_figures(model: Model, preparation: Preparation, key: str) -> list[Figure]:
    """Fig. 8 of each joint: reference position and velocity of a period with the limits of Table 2.

    None where no reference was recorded.
    """
    reference = preparation.reference
    if reference is None:
        return []
    figures = []
    for j, joint in enumerate(model.joints):
        coordinate = model.setting.units[joint]
        limits = model.machine.limits[joint] if model.machine is not None else None
        position, velocity = (
            [Curve("reference", REFERENCE, reference.time, values[:, j], 1.6)]
            for values in (reference.position, reference.velocity)
        )
        ends = (limits.position_min, limits.position_max) if limits else ()
        speeds = (limits.velocity_min, limits.velocity_max) if limits else ()
        panels = [
            Panel(POSITION, coordinate, position, limits=ends),
            Panel(VELOCITY, f"{coordinate}/s", velocity, limits=speeds),
        ]
        figures.append(Figure(f"{key}-{joint}", spoken(joint), panels))
    return figures


def recording_figures(model: Model, recording: Recording, key: str) -> list[Figure]:
    """Fig. 9 of each joint: position, velocity and force, with the reference on top."""
    figures = []
    for j, joint in enumerate(model.joints):
        measured = _overlaid(recording.time, recording.position, recording.reference_position, j)
        velocity = _overlaid(recording.time, recording.velocity, recording.reference_velocity, j)
        force = [Curve("measured", MEASURED, recording.time, recording.force[:, j], 0.9)]
        coordinate = model.setting.units[joint]
        panels = [
            Panel(POSITION, coordinate, measured),
            Panel(VELOCITY, f"{coordinate}/s", velocity),
            Panel(FORCE, unit(model.setting.force_unit(joint)), force),
        ]
        figures.append(Figure(f"{key}-{joint}", spoken(joint), panels))
    return figures


def averaged_figures(model: Model, preparation: Preparation, key: str) -> list[Figure]:
    """Figs. 10 and 11 of each joint: averaged position, velocity and estimated acceleration."""
    record = preparation.record
    figures = []
    for j, joint in enumerate(model.joints):
        coordinate = model.setting.units[joint]
        rows = (
            (POSITION, coordinate, record.position),
            (VELOCITY, f"{coordinate}/s", record.velocity),
            (ACCELERATION, f"{coordinate}/s²", record.acceleration),
        )
        panels = [
            Panel(symbol, unit_, [Curve("estimated", MEASURED, record.time, values[:, j])])
            for symbol, unit_, values in rows
        ]
        figures.append(Figure(f"{key}-{joint}", spoken(joint), panels, left_out(preparation, j)))
    return figures


def validation_figures(model: Model, validation: Validation, key: str) -> list[Figure]:
    """Figs. 12 and 13 of each joint: measured and predicted force, and what is left below."""
    noise = scatter(validation)
    figures = []
    for j, joint in enumerate(model.joints):
        force_unit = unit(model.setting.force_unit(joint))
        time = validation.time
        measured, predicted = validation.measured[:, j], validation.predicted[:, j]
        curves = [
            Curve("measured", MEASURED, time, measured, 1.8),
            Curve("model", MODEL, time, predicted, 1.2),
        ]
        residual = [Curve("measured − model", MEASURED, time, measured - predicted)]
        panels = [
            Panel(FORCE, force_unit, curves, height=190),
            Panel(
                "τ − τ<sub>model</sub>",
                force_unit,
                residual,
                _noise_band(time, noise, j),
                height=100,
            ),
        ]
        figures.append(
            Figure(f"{key}-{joint}", spoken(joint), panels, left_out(validation.preparation, j))
        )
    return figures


def commanded_figures(model: Model, course: CommandedCourse, key: str) -> list[Figure]:
    """Position of each joint, measured and simulated from commands, and what is left below."""
    figures = []
    for j, joint in enumerate(model.joints):
        coordinate, time = model.setting.units[joint], course.time
        measured, simulated = course.measured[:, j], course.simulated[:, j]
        curves = [
            Curve("measured", MEASURED, time, measured, 1.8),
            Curve("model", MODEL, time, simulated, 1.2),
        ]
        left = [Curve("measured − model", MEASURED, time, measured - simulated)]
        panels = [
            Panel(POSITION, coordinate, curves, height=190),
            Panel("q − q<sub>model</sub>", coordinate, left, height=100),
        ]
        figures.append(Figure(f"{key}-{joint}", spoken(joint), panels))
    return figures


def _overlaid(
    time: np.ndarray, measured: np.ndarray, reference: np.ndarray | None, j: int
) -> list[Curve]:
    curves = [Curve("measured", MEASURED, time, measured[:, j], 1.8)]
    if reference is not None:
        curves.append(Curve("reference", REFERENCE, time, reference[:, j], 1.0))
    return curves


def _noise_band(time: np.ndarray, noise: np.ndarray | None, j: int) -> Sequence[Band]:
    """Two standard deviations of the averaged force to either side."""
    if noise is None:
        return ()
    return (Band("scatter between periods", SCATTER, time, -2 * noise[:, j], 2 * noise[:, j]),)
