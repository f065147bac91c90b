"""Figures of the report: its Figs. 8 to 13, and motion from commands, one per joint each."""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from markupsafe import Markup

from crane_identification.estimation.autoregression import LackOfFit
from crane_identification.notation import listed, percent, plain, shown, spoken, unit
from crane_identification.preparation.run import Preparation
from crane_identification.report.content import IdentificationReport, Recording, left_out, scatter
from crane_identification.report.html import (
    MEASURED,
    MODEL,
    REFERENCE,
    SCATTER,
    TRUE_VALUE,
    Band,
    Curve,
    Figure,
    Panel,
)
from crane_identification.report.tables import parameter_symbol, with_headings
from crane_identification.signals.decimate import KEPT_SHARE
from crane_identification.signals.kalman import KalmanSmoother
from crane_identification.signals.motion import MotionEstimator
from crane_identification.signals.routes import ButterworthDifferentiator, FourierFit
from crane_identification.validation.force_validation import Validation
from crane_identification.validation.motion_validation import CommandedCourse
from crane_model.model_file import Model

POSITION, VELOCITY, ACCELERATION, FORCE = "q", "q̇", "q̈", "τ"
PANELS = 4  # of a figure, above each other
SETTLED_TIME_SHARE = 0.2
"""Share of the time after which all of an estimate is to be seen: before, it is off its panel."""


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
        curves, residual = _compared(time, validation.measured[:, j], validation.predicted[:, j])
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
        curves, residual = _compared(time, course.measured[:, j], course.simulated[:, j])
        panels = [
            Panel(POSITION, coordinate, curves, height=190),
            Panel("q − q<sub>model</sub>", coordinate, residual, height=100),
        ]
        figures.append(Figure(f"{key}-{joint}", spoken(joint), panels))
    return figures


def _compared(
    time: np.ndarray, measured: np.ndarray, predicted: np.ndarray
) -> tuple[list[Curve], list[Curve]]:
    curves = [
        Curve("measured", MEASURED, time, measured, 1.8),
        Curve("model", MODEL, time, predicted, 1.2),
    ]
    return curves, [Curve("measured − model", MEASURED, time, measured - predicted)]


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


# How the recordings were turned into an estimate, in words.


def processing(report: IdentificationReport) -> list[tuple[str, str]]:
    """Steps of the processing: what was done, and with which numbers."""
    fit, options = report.fit, report.options
    step = fit.preparations[0].step
    chosen = options.motion or (FourierFit() if options.average else KalmanSmoother())
    steps = [("Velocity and acceleration", _motion(chosen))]
    steps += [("Bandwidth", line) for line in _bandwidths(report)]
    steps += [(p.source, _periods(p)) for p in fit.preparations]
    steps.append(("Parallel filter", _filter(fit.decimation, step)))
    steps.append(("Reversals", _reversals(options.mask_reversals)))
    steps.append(("Estimate", f"{fit.estimate.method}; {fit.estimate.samples} rows"))
    steps.append(("Residual against noise", _lack_of_fit(fit.lack_of_fit)))
    return steps


def _lack_of_fit(left: LackOfFit) -> str:
    """Power of the residual over that of the noise between periods, and the test of lack of fit."""
    parts = [
        f"{spoken(joint)} {plain(float(ratio), 3)} (p = {plain(float(p_value), 2)})"
        for joint, ratio, p_value in zip(left.joints, left.ratio, left.p_value, strict=True)
        if np.isfinite(ratio)
    ]
    if not parts:
        return "not known: no period was repeated"
    return f"power of the residual over that of the noise between periods: {listed(parts)}"


def _motion(estimator: MotionEstimator) -> str:
    match estimator:
        case FourierFit():
            return (
                "least-squares Fourier series of the averaged period, differentiated exactly; "
                "harmonics that noise outweighs are damped"
            )
        case KalmanSmoother(jerk_density=None):
            return "Kalman smoother driven by white jerk, tuned by the likelihood of the readings"
        case KalmanSmoother():
            return f"Kalman smoother, density of the jerk {estimator.jerk_density} SI"
        case ButterworthDifferentiator():
            return (
                f"zero-phase Butterworth filter of order {estimator.order} at "
                f"{plain(estimator.cutoff)} Hz, central differences"
            )
    return type(estimator).__name__


def _bandwidths(report: IdentificationReport) -> Iterator[str]:
    preparations = report.fit.preparations
    parts = []
    for j, joint in enumerate(report.fit.model.joints):
        values = [float(p.bandwidth[j]) for p in preparations]
        low, high = plain(min(values), 2), plain(max(values), 2)
        parts.append(f"{spoken(joint)} {low if low == high else f'{low} to {high}'} Hz")
    yield f"motion follows the truth up to: {listed(parts)}"


def _periods(preparation: Preparation) -> str:
    rate = f"{plain(1.0 / preparation.step)} Hz"
    averaging = preparation.averaging
    if averaging is None:
        return f"not averaged; {len(preparation.record)} samples at {rate}"
    parts = [f"mean of {averaging.used} periods of {plain(averaging.period, 4)} s at {rate}"]
    if averaging.transient:
        parts.append(f"left out as transient: {averaging.transient}")
    if averaging.incomplete > 0:
        parts.append(f"{plain(averaging.incomplete)} s fill no whole period")
    return "; ".join(parts)


def _filter(factor: int, step: float) -> str:
    if factor == 1:
        return "none; every sample is a row"
    return (
        f"regressor and force through the same zero-phase low-pass, every {factor}th sample kept "
        f"({plain(1.0 / (factor * step))} Hz), so that only {plain(KEPT_SHARE, 1)} of the "
        "bandwidth of the motion is used"
    )


def _reversals(masked: bool) -> str:
    if masked:
        return "rows where the sign of the joint's velocity is not known are left out of the fit"
    return "sgn of the estimated velocity as it comes; no row is left out"


# The recursion over the training recordings beside the fit: its table and how it settled.


class RecursiveRow(NamedTuple):
    """One parameter by the recursion and by the fit; `difference` in standard deviations."""

    symbol: Markup
    unit: str
    value: str
    std_dev: str
    fitted: str
    fitted_std_dev: str
    difference: str


class RecursiveGroup(NamedTuple):
    """Parameters of one family and joint under a common heading."""

    heading: str
    rows: list[RecursiveRow]


class RecursiveError(NamedTuple):
    """Held-out error of one joint."""

    joint: str
    recursive: str
    fitted: str


def recursive_groups(report: IdentificationReport) -> list[RecursiveGroup]:
    """All parameters in the order of the model; none without the recursion."""
    recursive, estimate = report.recursive, report.fit.estimate
    if recursive is None:
        return []
    groups: list[RecursiveGroup] = []
    for i, (heading, parameter) in enumerate(with_headings(report.fit.model)):
        value, std_dev = float(recursive.values[-1, i]), float(recursive.std_devs[-1, i])
        fitted, fitted_std_dev = float(estimate.values[i]), float(estimate.std_devs[i])
        spread = float(np.hypot(std_dev, fitted_std_dev))
        if not groups or groups[-1].heading != heading:
            groups.append(RecursiveGroup(heading, []))
        groups[-1].rows.append(
            RecursiveRow(
                parameter_symbol(parameter.name),
                unit(parameter.unit),
                *shown(value, std_dev, parameter.minimum)[:2],
                *shown(fitted, fitted_std_dev, parameter.minimum)[:2],
                plain((value - fitted) / spread, 2),
            )
        )
    return groups


def recursive_errors(report: IdentificationReport) -> list[RecursiveError]:
    """Recursive errors of each joint; none without recursion or validation."""
    recursive, fitted = report.recursive_held_out, report.held_out
    if recursive is None or fitted is None:
        return []
    pairs = zip(report.fit.model.joints, recursive.relative, fitted.relative, strict=True)
    return [RecursiveError(spoken(joint), percent(a), percent(b)) for joint, a, b in pairs]


def settling_figures(report: IdentificationReport) -> list[Figure]:
    """Each parameter over the time of the recordings, one after the other."""
    recursive = report.recursive
    if recursive is None:
        return []
    figures: list[Figure] = []
    panels: dict[str, list[Panel]] = {}
    for i, (heading, parameter) in enumerate(with_headings(report.fit.model)):
        panels.setdefault(heading, []).append(_settling(report, i, parameter.name, parameter.unit))
    for heading, all_of in panels.items():
        for first in range(0, len(all_of), PANELS):
            key = f"settling-{len(figures)}"
            figures.append(Figure(key, heading, all_of[first : first + PANELS]))
    return figures


def _settling(report: IdentificationReport, i: int, name: str, unit_: str) -> Panel:
    recursive = report.recursive
    assert recursive is not None
    time, values = recursive.time, recursive.values[:, i]
    spread = 2.0 * np.where(np.isfinite(recursive.std_devs[:, i]), recursive.std_devs[:, i], np.nan)
    fitted = report.fit.estimate.values[i]
    known = {"fit": (MODEL, fitted)}
    if report.true_values is not None and name in report.true_values:
        known["true value"] = (TRUE_VALUE, report.true_values[name])
    constants = [
        Curve(which, colour, time[[0, -1]], np.array([value, value]))
        for which, (colour, value) in known.items()
        if np.isfinite(value)
    ]
    settled = time >= SETTLED_TIME_SHARE * time[-1]
    seen = np.concatenate([(values - spread)[settled], (values + spread)[settled]])
    seen = np.append(seen, [curve.values[0] for curve in constants])
    return Panel(
        str(parameter_symbol(name)),
        unit(unit_),
        [*constants, Curve("recursion", MEASURED, time, values, 1.6)],
        [Band("±2 σ", SCATTER, time, values - spread, values + spread)],
        span=_widened(float(np.nanmin(seen)), float(np.nanmax(seen))),
    )


def _widened(low: float, high: float) -> tuple[float, float]:
    room = 0.08 * (high - low) or 1e-3 * abs(high) or 1.0
    return low - room, high + room
