"""summary.json: the numbers of the page for programs."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from crane_identification.report.content import IdentificationReport, JointErrors
from crane_identification.scale.summed import SummedFit
from crane_model.result_file import Number, NumberByJoint, ResultFile, ResultPart


class ParameterSummary(ResultPart):
    """A parameter; null if the data do not determine it."""

    name: str
    """Name, as in model files."""
    unit: str
    """SI unit; `1` for a ratio, `counts` if readings have no unit."""
    value: Number
    """Estimate [unit]."""
    std_dev: Number
    """Its standard deviation [unit]."""


class MotionSummary(ResultPart):
    """Error of the simulated motion, driven by the measured pressures."""

    horizon: float
    """Duration of each simulation [s]."""
    windows: int
    """Number of simulations, one after the other [-]."""
    position_rms: NumberByJoint
    """Rms error at the end [rad, m]; null if the model cannot be simulated."""
    displacement_rms: NumberByJoint
    """Displacement of the joint in that time, rms [rad, m]."""
    reason: str
    """Reason why the model cannot be simulated; otherwise empty."""


class CommandedSummary(ResultPart):
    """Error of the motion simulated from valve commands alone."""

    horizon: float
    """Duration of each simulation [s]."""
    windows: int
    """Number of simulations, one after the other [-]."""
    position_rms: NumberByJoint
    """Rms error at the end [rad, m]."""
    path: NumberByJoint
    """Length of the path of the joint in that time, on average [rad, m]."""


class RecursiveSummary(ResultPart):
    """The recursion over the training recordings."""

    parameters: list[ParameterSummary]
    """Parameters at the end of the recursion."""
    heldout_relative_error: NumberByJoint
    """‖τ - τ̂‖/‖τ‖ on the validation recordings [-]."""
    samples: int
    """Number of samples [-]."""


class LackOfFitSummary(ResultPart):
    """Model error on the training recordings, and their noise."""

    ratio: NumberByJoint
    """Power of the residual over that of the noise between periods [-]; null if no period was
    repeated.
    """
    p_value: NumberByJoint
    """Probability of such a ratio by noise alone [-]."""


class Summary(ResultFile):
    """Result of `identify`. Errors are over all samples of all recordings of their kind; those of
    held-out recordings are empty without validation.
    """

    model: str
    """Name of the model."""
    date: str
    """Date of the fit, UTC."""
    estimator: str
    """`--estimator`."""
    method: str
    """Method of the fit, in words."""
    bounds: list[str]
    """Active physical constraints."""
    parameters: list[ParameterSummary]
    """Parameters in the order of the model."""
    heldout_relative_error: NumberByJoint
    """‖τ - τ̂‖/‖τ‖ on the validation recordings [-]."""
    heldout_relative_error_moving: NumberByJoint
    """The same while the sign of the joint's velocity is known [-]."""
    heldout_relative_error_without_gravity: NumberByJoint
    """The same relative to τ without its gravity part [-]."""
    noise_floor: NumberByJoint
    """Scatter of τ between periods over ‖τ‖ [-]; null if no period was repeated."""
    training_relative_error: NumberByJoint
    """‖τ - τ̂‖/‖τ‖ on the training recordings [-]."""
    friction_share: NumberByJoint
    """‖friction‖/‖τ‖ of the training recordings, by the fitted model [-]."""
    lack_of_fit: LackOfFitSummary
    """Lack of fit on the training recordings."""
    simulated_motion: MotionSummary | None
    """Simulated motion of the validation recordings; null without them."""
    simulated_from_commands: list[CommandedSummary]
    """The same from valve commands alone; empty without hydraulics or commands."""
    recursive: RecursiveSummary | None
    """Result of the recursion; null without `--recursive`."""
    hydraulics: list[ParameterSummary]
    """Values of valves and oil, as `dead_band_a.boom`; empty without commands or pressures."""
    condition_number: Number
    """Condition number of all columns in SI units [-]; null: the columns are dependent."""
    condition_number_normalized: Number
    """Condition number of the same columns scaled to norm 1 [-]."""
    training_bags: list[str]
    """Recordings that the model was fitted to."""
    validation_bags: list[str]
    """Recordings that validated the model."""
    samples: int
    """Number of fitted rows [-]."""
    warnings: list[str]
    """Warnings about recordings and results."""


class ClusterSummary(ResultFile):
    """Result of `identify --stream` or `--cluster`: values known without all rows."""

    model: str
    """Name of the model."""
    method: str
    """Method of the fit, in words."""
    parameters: list[ParameterSummary]
    """Parameters in the order of the model."""
    heldout_relative_error: NumberByJoint
    """‖τ - τ̂‖/‖τ‖ on the validation recordings [-]."""
    heldout_relative_error_without_gravity: NumberByJoint
    """The same relative to τ without its gravity part [-]."""
    noise_floor: NumberByJoint
    """Scatter of τ between periods over ‖τ‖ [-]; null if no period was repeated."""
    samples: int
    """Number of fitted rows [-]."""


def summarize(report: IdentificationReport) -> Summary:
    """The summary of a report."""
    estimate, held_out, simulated = report.fit.estimate, report.held_out, report.simulated
    recursive, recursive_held_out = report.recursive, report.recursive_held_out
    hydraulics = report.fit.model.hydraulics

    def per_joint(values: np.ndarray) -> dict[str, float | None]:
        return dict(zip(estimate.joints, values, strict=True))

    return Summary(
        model=report.fit.model.name,
        date=report.provenance.date,
        estimator=report.options.estimator.value,
        method=estimate.method,
        bounds=list(estimate.bounds),
        parameters=_parameters(estimate.names, estimate.units, estimate.values, estimate.std_devs),
        heldout_relative_error_moving=per_joint(held_out.moving) if held_out else {},
        **_held_out(estimate.joints, held_out),
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
            displacement_rms=per_joint(simulated.path),
            reason=simulated.reason,
        )
        if simulated
        else None,
        simulated_from_commands=[
            CommandedSummary(
                horizon=validation.horizon,
                windows=validation.windows,
                position_rms=per_joint(validation.position_rms),
                path=per_joint(validation.path),
            )
            for validation in report.commanded
        ],
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
        hydraulics=[
            ParameterSummary(
                name=f"{name}.{joint}", unit=value.unit, value=value.value, std_dev=value.std_dev
            )
            for joint, of_joint in (hydraulics.joints if hydraulics else {}).items()
            for name, value in of_joint.values.items()
        ],
        condition_number=estimate.condition_number,
        condition_number_normalized=estimate.condition_number_normalized,
        training_bags=report.training_bags,
        validation_bags=report.validation_bags,
        samples=estimate.samples,
        warnings=list(report.warnings),
    )


def write(path: Path | str, report: IdentificationReport) -> None:
    """Write `summarize(report)` as JSON."""
    summarize(report).write(path)


def write_summed(path: Path | str, fit: SummedFit, held_out: JointErrors | None) -> None:
    """Write what a fit by sums found, and its errors on validation recordings, as JSON."""
    information, model = fit.information, fit.model
    assert model.std_devs is not None  # of a fitted model
    ClusterSummary(
        model=model.name,
        method=model.provenance,
        parameters=_parameters(information.names, information.units, model.theta, model.std_devs),
        **_held_out(model.joints, held_out),
        samples=int(information.rows.sum()),
    ).write(path)


def _held_out(joints: Sequence[str], errors: JointErrors | None) -> dict[str, Any]:
    """Errors by field of a summary; empty without validation."""
    fields = {
        "heldout_relative_error": "relative",
        "heldout_relative_error_without_gravity": "without_gravity",
        "noise_floor": "noise_floor",
    }
    return {
        field: dict(zip(joints, getattr(errors, name), strict=True)) if errors else {}
        for field, name in fields.items()
    }


def _parameters(
    names: Sequence[str], units: Sequence[str], values: np.ndarray, std_devs: np.ndarray
) -> list[ParameterSummary]:
    return [
        ParameterSummary(name=name, unit=unit, value=value, std_dev=std_dev)
        for name, unit, value, std_dev in zip(names, units, values, std_devs, strict=True)
    ]
