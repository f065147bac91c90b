"""How the recordings were turned into an estimate, in words."""

from collections.abc import Iterator

import numpy as np

from crane_identification.estimation.autoregression import LackOfFit
from crane_identification.notation import listed, plain, spoken
from crane_identification.preparation.run import Preparation
from crane_identification.report.content import IdentificationReport
from crane_identification.signals.butterworth import ButterworthDifferentiator
from crane_identification.signals.decimate import KEPT_SHARE
from crane_identification.signals.fourier import FourierFit
from crane_identification.signals.kalman import KalmanSmoother
from crane_identification.signals.motion import MotionEstimator


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
