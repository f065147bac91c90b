"""summary.json: the numbers of the page for programs."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any, TypedDict

import numpy as np

from crane_identification.report.content import IdentificationReport
from crane_identification.report.errors import JointErrors
from crane_identification.scale.information import ClusterFit


class ParameterSummary(TypedDict):
    """`value` and `std_dev` in `unit`; null where the data do not determine the parameter."""

    name: str
    unit: str
    value: float | None
    std_dev: float | None


class MotionSummary(TypedDict):
    """Per joint [rad, m]: rms error of the simulated position `horizon` seconds [s] ahead, driven
    by the measured pressures, and how far the joint itself moved in that time. Where the model
    cannot be simulated, they are null and `reason` says why; otherwise it is empty.
    """

    horizon: float
    windows: int
    position_rms: dict[str, float | None]
    displacement_rms: dict[str, float | None]
    reason: str


class RecursiveSummary(TypedDict):
    """The recursion over the training recordings, and its error on the validation recordings."""

    parameters: list[ParameterSummary]
    heldout_relative_error: dict[str, float | None]
    samples: int


class LackOfFitSummary(TypedDict):
    """Per joint: power of the residual over what the noise between periods leaves of it, and the
    probability that noise alone gives as much (null: no period was repeated).
    """

    ratio: dict[str, float | None]
    p_value: dict[str, float | None]


class Summary(TypedDict):
    """Errors are shares of one per joint, over all samples of all recordings of their kind.

    `heldout_relative_error` is ‖τ - τ̂‖/‖τ‖, `..._moving` the same where the sign of the joint's
    velocity is known, `..._without_gravity` the error relative to τ without its gravity part, and
    `noise_floor` the scatter of τ from period to period (null: no period was repeated). They are
    empty without validation. `friction_share` is ‖friction‖/‖τ‖ of the training data by the fitted
    model. The condition numbers are those of all columns in SI units, and of the same columns
    scaled to norm 1 (null: rank deficient). `samples` counts the fitted rows. `bounds` names the
    physical constraints that hold the values back. `recursive` is null where it was not asked for.
    `hydraulics` is that section of model.yaml, null where no valve command or pressure was logged.
    """

    model: str
    date: str
    estimator: str
    method: str
    bounds: list[str]
    parameters: list[ParameterSummary]
    heldout_relative_error: dict[str, float | None]
    heldout_relative_error_moving: dict[str, float | None]
    heldout_relative_error_without_gravity: dict[str, float | None]
    noise_floor: dict[str, float | None]
    training_relative_error: dict[str, float | None]
    friction_share: dict[str, float | None]
    lack_of_fit: LackOfFitSummary
    simulated_motion: MotionSummary | None
    recursive: RecursiveSummary | None
    hydraulics: dict[str, Any] | None
    condition_number: float | None
    condition_number_normalized: float | None
    training_bags: list[str]
    validation_bags: list[str]
    samples: int
    warnings: list[str]


def summarize(report: IdentificationReport) -> Summary:
    """The summary of a report, as plain numbers, strings, lists and dictionaries."""
    estimate, held_out, simulated = report.fit.estimate, report.held_out, report.simulated
    recursive, recursive_held_out = report.recursive, report.recursive_held_out
    hydraulics = report.fit.model.hydraulics

    def per_joint(values: np.ndarray) -> dict[str, float | None]:
        return {joint: _number(v) for joint, v in zip(estimate.joints, values, strict=True)}

    return Summary(
        model=report.fit.model.name,
        date=report.provenance.date,
        estimator=report.options.estimator.value,
        method=estimate.method,
        bounds=list(estimate.bounds),
        parameters=_parameters(estimate.names, estimate.units, estimate.values, estimate.std_devs),
        heldout_relative_error=per_joint(held_out.relative) if held_out else {},
        heldout_relative_error_moving=per_joint(held_out.moving) if held_out else {},
        heldout_relative_error_without_gravity=per_joint(held_out.without_gravity)
        if held_out
        else {},
        noise_floor=per_joint(held_out.noise_floor) if held_out else {},
        training_relative_error=per_joint(report.trained.relative),
        friction_share=per_joint(report.friction_share),
        lack_of_fit=LackOfFitSummary(
            ratio=per_joint(report.fit.lack_of_fit.ratio),
            p_value=per_joint(report.fit.lack_of_fit.p_value),
        ),
        simulated_motion=MotionSummary(
            horizon=simulated.horizon,
            windows=simulated.windows,
            position_rms=per_joint(simulated.position_rms),
            displacement_rms=per_joint(simulated.displacement_rms),
            reason=simulated.reason,
        )
        if simulated
        else None,
        recursive=RecursiveSummary(
            parameters=_parameters(
                estimate.names, estimate.units, recursive.values[-1], recursive.std_devs[-1]
            ),
            heldout_relative_error=per_joint(recursive_held_out.relative)
            if recursive_held_out
            else {},
            samples=recursive.samples,
        )
        if recursive
        else None,
        hydraulics=None if hydraulics is None else hydraulics.model_dump(mode="json"),
        condition_number=_number(estimate.condition_number),
        condition_number_normalized=_number(estimate.condition_number_normalized),
        training_bags=report.training_bags,
        validation_bags=report.validation_bags,
        samples=estimate.samples,
        warnings=list(report.warnings),
    )


def write(path: Path | str, report: IdentificationReport) -> None:
    """Write `summarize(report)` as JSON."""
    text = json.dumps(summarize(report), indent=2, ensure_ascii=False, allow_nan=False)
    Path(path).write_text(text + "\n", encoding="utf-8")


class ClusterSummary(TypedDict):
    """As `Summary`, what is known without the rows of the training recordings."""

    model: str
    method: str
    parameters: list[ParameterSummary]
    heldout_relative_error: dict[str, float | None]
    heldout_relative_error_without_gravity: dict[str, float | None]
    noise_floor: dict[str, float | None]
    samples: int


def write_of_cluster(path: Path | str, fit: ClusterFit, held_out: JointErrors | None) -> None:
    """Write what a fit on a cluster found, and its errors on validation recordings, as JSON."""
    information, model = fit.information, fit.model
    assert model.std_devs is not None  # of a fitted model

    def per_joint(values: np.ndarray) -> dict[str, float | None]:
        return {joint: _number(v) for joint, v in zip(model.joints, values, strict=True)}

    content = ClusterSummary(
        model=model.name,
        method=model.provenance,
        parameters=_parameters(information.names, information.units, model.theta, model.std_devs),
        heldout_relative_error=per_joint(held_out.relative) if held_out else {},
        heldout_relative_error_without_gravity=per_joint(held_out.without_gravity)
        if held_out
        else {},
        noise_floor=per_joint(held_out.noise_floor) if held_out else {},
        samples=int(information.rows.sum()),
    )
    text = json.dumps(content, indent=2, ensure_ascii=False, allow_nan=False)
    Path(path).write_text(text + "\n", encoding="utf-8")


def _parameters(
    names: Sequence[str], units: Sequence[str], values: np.ndarray, std_devs: np.ndarray
) -> list[ParameterSummary]:
    return [
        ParameterSummary(name=name, unit=unit, value=_number(value), std_dev=_number(std_dev))
        for name, unit, value, std_dev in zip(names, units, values, std_devs, strict=True)
    ]


def _number(value: float) -> float | None:
    """JSON has neither NaN nor infinity."""
    return float(value) if np.isfinite(value) else None
