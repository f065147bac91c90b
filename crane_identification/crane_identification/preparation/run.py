"""Preparation of one run of a recording: records, moving rows and averaged periods."""

from dataclasses import dataclass, replace

import numpy as np
from scipy.ndimage import binary_dilation
from scipy.stats import t as student

from crane_identification.data.log import Log
from crane_identification.data.resample import Samples
from crane_identification.options import Options
from crane_identification.signals.kalman import KalmanSmoother
from crane_identification.signals.motion import SmoothedMotion, encoder_resolution
from crane_identification.signals.routes import estimate_period
from crane_model.cylinders import generalized_forces
from crane_model.errors import DataError
from crane_model.model_file import Model
from crane_model.progress_bar import Progress
from crane_model.record import Record

STANDSTILL_SIGMAS = 3.0
"""Speeds below this many standard deviations of the velocity estimate count as standstill."""
GUARD_CYCLES = 1.0
"""Cycles at the bandwidth of the motion over which the smoother spreads what happens at a reversal:
main lobe and first side lobe of its response."""
SAMPLE_ROUNDING = 1e-6  # samples
SETTLING_S = 0.1
"""Time [s] that friction takes after a reversal until it follows (13): before, the joint presses on
bristles and seals that give way (presliding), which a model of (13) takes for inertia."""
REFERENCE_SIGNALS = ("reference_position", "reference_velocity", "reference_acceleration")
RECORD_SIGNALS = (
    *("pressure_a", "pressure_b", "supply_pressure", "tank_pressure"),
    *("slew_position", "command", "temperature"),
)
TRANSIENT = 2.0
"""A first period that differs from the later ones by this many times their scatter is transient."""
LACKING = 3
"""Samples that a period may lack and count as whole."""
LOCAL = 0.04
"""Share of the period over which the scatter is taken as equally large, and a drift is sought."""


def velocity_resolution(motion: SmoothedMotion) -> np.ndarray:
    """Speed (j,) below which the sign of the estimated velocity is not known."""
    return STANDSTILL_SIGMAS * motion.velocity_noise


def moving(
    motion: SmoothedMotion, step: float, periodic: bool, settling: float = SETTLING_S
) -> np.ndarray:
    """(n, j): True where joint j moves, and has done and will do so for a smoothing cycle and more.

    `settling` [s] is added to the cycle; without it, only the sign of the velocity is known.

    At standstill (13) is set-valued, and near a reversal the velocity estimate lags or leads the
    true one: rows from there are wrong by up to 2 f_c, which biases the friction parameters.
    """
    velocity = motion.velocity
    still = np.abs(velocity) <= velocity_resolution(motion)
    reversal = np.sign(velocity[1:]) * np.sign(velocity[:-1]) < 0
    still[1:] |= reversal
    still[:-1] |= reversal
    n = len(velocity)
    around = np.concatenate([still, still, still]) if periodic else still
    out = np.empty_like(around)
    for j, bandwidth in enumerate(motion.bandwidth):
        guard = int(np.ceil((GUARD_CYCLES / bandwidth + settling) / step - SAMPLE_ROUNDING))
        out[:, j] = ~binary_dilation(around[:, j], iterations=guard)
    return out[n : 2 * n] if periodic else out


@dataclass(frozen=True)
class Averaging:
    """How a recording was averaged.

    `period` [s]; `used` whole periods, the last ones; `transient` whole periods before them were
    left out, and `incomplete` [s] of the periodic part fills no whole period. `drift` of the force;
    `change` as of `change_between_periods`.
    """

    period: float
    used: int
    transient: int
    incomplete: float
    drift: "Drift"
    change: float = 0.0


@dataclass(frozen=True)
class Drift:
    """Steady change from period to period, per joint (j,); NaN for fewer than three periods.

    `rate`: root mean square change of the force a period [N m or N]. `p_value`: how likely scatter
    that is none would look so.
    """

    rate: np.ndarray
    p_value: np.ndarray


@dataclass(frozen=True)
class Preparation:
    """One run of a recording, ready for the regressor.

    `record`: n samples every `step` s with motion and generalized force; one averaged period if
    `averaging` is not None. `moving` (n, j): where the sign of the velocity is known, and
    friction has settled behind a reversal; `signed` (n, j): where the sign is known; of an average
    both hold in each of its periods. `bandwidth` (j,) [Hz] of the motion. `periods` (M, n, j): the
    generalized forces that were averaged. `reference`: the record along the motion that was asked
    for, None where it was not recorded.
    """

    source: str
    record: Record
    step: float
    moving: np.ndarray
    signed: np.ndarray
    bandwidth: np.ndarray
    averaging: Averaging | None
    periods: np.ndarray
    reference: Record | None
    changing: float = 0.0

    @property
    def periodic(self) -> bool:
        """Return whether the record is one whole period, so that it continues over its ends."""
        return self.averaging is not None


def signals_of(model: Model, samples: Samples, rows: np.ndarray) -> dict[str, np.ndarray]:
    """Signals of a record besides time and motion, on the given rows; absent if not logged.

    `coordinates` are the joints and, if it is logged, the slew joint at the end.
    """
    names = ("position", "force", *RECORD_SIGNALS, *REFERENCE_SIGNALS)
    logged = {name: getattr(samples, name) for name in names}
    signals = {name: values[rows] for name, values in logged.items() if values is not None}
    if "force" not in signals:
        if model.machine is None or "pressure_a" not in signals:
            raise DataError(
                f"{samples.source}: holds neither generalized forces nor, with a machine in the "
                f"model, chamber pressures to compute them from (27); map or record one of them"
            )
        signals["force"] = generalized_forces(
            model.machine,
            signals["position"],
            signals["pressure_a"],
            signals["pressure_b"],
            model.joints,
        )
    slew = [signals["slew_position"]] if "slew_position" in signals else []
    signals["coordinates"] = np.column_stack([signals["position"], *slew])
    return signals


def resolution_of(log: Log) -> np.ndarray:
    """Encoder resolution (coordinates,) of the readings as they were logged."""
    signals = [log.position] if log.slew_position is None else [log.position, log.slew_position]
    return np.concatenate(
        [
            encoder_resolution(signal.value.reshape(len(signal.time), -1))
            if signal.resolution is None
            else signal.resolution
            for signal in signals
        ]
    )


def along_reference(record: Record, signals: dict[str, np.ndarray]) -> Record | None:
    """`record` with the motion that was asked for, where all of it is known."""
    motion = [signals[name] for name in REFERENCE_SIGNALS if name in signals]
    if len(motion) < len(REFERENCE_SIGNALS) or not all(
        np.isfinite(values).all() for values in motion
    ):
        return None
    position, velocity, acceleration = motion
    return replace(record, position=position, velocity=velocity, acceleration=acceleration)


def record_of(
    model: Model,
    time: np.ndarray,
    signals: dict[str, np.ndarray],
    motion: SmoothedMotion,
    mask_reversals: bool,
) -> Record:
    """The record (n samples) of signals along an estimated motion.

    The last coordinate of the motion is the slew joint, where that was logged. Without
    `mask_reversals` every velocity counts as known.
    """
    joints = len(model.joints)
    record = Record(
        joints=model.joints,
        time=time,
        position=motion.position[:, :joints],
        velocity=motion.velocity[:, :joints],
        acceleration=motion.acceleration[:, :joints],
        force=signals["force"],
        pressure_a=signals.get("pressure_a"),
        pressure_b=signals.get("pressure_b"),
        supply_pressure=signals.get("supply_pressure"),
        tank_pressure=signals.get("tank_pressure"),
        command=signals.get("command"),
        temperature=signals.get("temperature"),
        velocity_resolution=velocity_resolution(motion)[:joints] if mask_reversals else None,
    )
    if "slew_position" not in signals:
        return record
    return replace(
        record,
        slew_position=motion.position[:, joints],
        slew_velocity=motion.velocity[:, joints],
        slew_acceleration=motion.acceleration[:, joints],
    )


def where_moving(
    model: Model,
    motion: SmoothedMotion,
    step: float,
    periodic: bool,
    options: Options,
    settling: float = SETTLING_S,
) -> np.ndarray:
    """(n, j): where the sign of the velocity is known, or everywhere if nothing is masked.

    Friction of a motor that several joints turn needs the sign of its speed, on the rows of each.
    """
    if not options.mask_reversals:
        return np.ones((len(motion.position), len(model.joints)), dtype=bool)
    known = moving(motion, step, periodic, settling)[:, : len(model.joints)]
    for term in model.terms:
        if turned_by := term.turned_by(model.setting):
            at, shares = [model.joints.index(joint) for joint in turned_by], [*turned_by.values()]
            motor = replace(
                motion,
                velocity=motion.velocity[:, at] @ np.array(shares)[:, np.newaxis],
                velocity_noise=np.array([np.linalg.norm(motion.velocity_noise[at] * shares)]),
                bandwidth=motion.bandwidth[at].min(keepdims=True),
            )
            known[:, at] &= moving(motor, step, periodic, settling)
    return known


# Averaging over periods (37)-(38), and the noise that the scatter between periods reveals.


def averaged(
    model: Model,
    log: Log,
    samples: Samples,
    rows: np.ndarray,
    length: int,
    options: Options,
    progress: Progress,
    since: float,
) -> Preparation:
    """The mean over the last whole periods of the run (37)-(38)."""
    signals = signals_of(model, samples, rows)
    encoder = resolution_of(log)
    step = 1.0 / samples.rate
    whole = whole_periods(len(rows), length)
    signals = {name: completed(values, length, whole) for name, values in signals.items()}
    transient = transient_periods(fold(signals["position"], length, whole))
    used = min(whole - transient, options.periods or whole)
    mean = {name: fold(values, length, used).mean(axis=0) for name, values in signals.items()}
    resolution = resolution_of_mean(fold(signals["coordinates"], length, used), encoder)
    motion = estimate_period(options.motion, mean["coordinates"], step, resolution, progress)
    middle = len(signals["position"]) - (used + 1) * length / 2.0  # sample that the mean begins at
    time = since + samples.time[rows[0]] + step * (middle + np.arange(length))
    alike, signed_alike = _moving_alike(model, encoder, signals, step, length, used, options)
    known = where_moving(model, motion, step, True, options) & alike
    periods = fold(signals["force"], length, used)
    record = record_of(model, time, mean, motion, options.mask_reversals)
    remainder = max(len(rows) - whole * length, 0) * step
    return Preparation(
        source=log.source,
        record=record,
        step=step,
        moving=known,
        signed=where_moving(model, motion, step, True, options, settling=0.0) & signed_alike,
        bandwidth=motion.bandwidth[: len(model.joints)],
        reference=along_reference(record, mean),
        averaging=Averaging(
            *(length * step, used, whole - used, remainder, drift(periods, known)),
            change_between_periods(
                fold(signals["position"], length, used), periods, encoder[: len(model.joints)]
            ),
        ),
        periods=periods,
    )


def _moving_alike(
    model: Model,
    resolution: np.ndarray,
    signals: dict[str, np.ndarray],
    step: float,
    length: int,
    periods: int,
    options: Options,
) -> tuple[np.ndarray, np.ndarray]:
    """(length, j): where each joint moves in all of the last `periods`, and in one direction.

    First where friction has settled in all of them, then where the sign of the velocity is known.
    A joint that comes to rest on its way sets off again at another time in each period: the mean
    force is then none that friction (13) gives at the mean velocity.
    """
    if not options.mask_reversals:
        everywhere = np.ones((length, len(model.joints)), dtype=bool)
        return everywhere, everywhere
    motion = KalmanSmoother().estimate(signals["position"], step, resolution)
    settled, signed = (
        np.abs(fold(np.sign(motion.velocity) * known, length, periods).sum(axis=0)) == periods
        for known in (moving(motion, step, False), moving(motion, step, False, settling=0.0))
    )
    return settled, signed


def whole_periods(samples: int, length: int) -> int:
    """How many whole periods of `length` samples there are in `samples`.

    N samples span N - 1 steps, and streams do not begin and end together: of several periods the
    last may lack `LACKING` samples.
    """
    nearly = (samples + LACKING) // length
    return nearly if nearly > 1 else samples // length


def completed(values: np.ndarray, length: int, periods: int) -> np.ndarray:
    """`values` (n, ...), and what they lack of whole periods, as it was one period before."""
    lacking = max(periods * length - len(values), 0)
    begin = len(values) - length
    return np.concatenate([values, values[begin : begin + lacking]])


def fold(values: np.ndarray, length: int, periods: int) -> np.ndarray:
    """The last `periods` whole periods of `values` (n, ...): (periods, length, ...)."""
    last = values[len(values) - periods * length :]
    return last.reshape(periods, length, *values.shape[1:])


def transient_periods(position: np.ndarray) -> int:
    """How many of the first of M periods (M, n, j) belong to the transient.

    A period is compared with the mean of those behind it, while these are at least two.
    """
    first = 0
    while len(position) - first >= 3:
        later = position[first + 1 :]
        scatter = np.sqrt((later.var(axis=0, ddof=1)).mean(axis=0))
        expected = scatter * np.sqrt(1 + 1 / len(later))
        deviation = np.sqrt(((position[first] - later.mean(axis=0)) ** 2).mean(axis=0))
        if not (deviation > TRANSIENT * expected).any():
            break
        first += 1
    return first


def change_between_periods(
    position: np.ndarray, force: np.ndarray, resolution: np.ndarray
) -> float:
    """Largest change of the force of a joint between M periods (M, n, j), over its rms.

    White noise, which a mean reduces, does not count. Return 0 for a single period, and if all
    positions repeat to within the `resolution` (j,) of their readings: then the machine repeats its
    motion, and the mean force belongs to it, whatever else changes the force.
    """
    if (
        len(position) < 2
        or (np.sqrt(position.var(axis=0, ddof=1).mean(axis=0)) <= resolution).all()
    ):
        return 0.0
    deviation = force - force.mean(axis=0)
    power = (deviation**2).sum(axis=0).mean(axis=0)
    white = 0.5 * (np.diff(deviation, axis=1) ** 2).sum(axis=0).mean(axis=0)
    change = np.maximum(power - white, 0.0) / (len(force) - 1)
    rms = np.sqrt((force**2).mean(axis=(0, 1)))
    return float((np.sqrt(change)[rms > 0.0] / rms[rms > 0.0]).max(initial=0.0))


def noise_of_mean(periods: np.ndarray, used: np.ndarray) -> np.ndarray:
    """Root mean square noise (j,) left in the average of M periods (M, n, j), without any model.

    Over the `used` (n, j) samples; NaN for a single period, which has no scatter.
    """
    count = len(periods)
    if count < 2:
        return np.full(periods.shape[2], np.nan)
    variance = np.where(used, periods.var(axis=0, ddof=1), 0.0).sum(axis=0)
    return np.sqrt(variance / np.maximum(used.sum(axis=0), 1) / count)


def resolution_of_mean(periods: np.ndarray, resolution: np.ndarray) -> np.ndarray:
    """Resolution (j,) that an encoder would need to round like the mean of M periods (M, n, j).

    Periods that differ by more than the `resolution` (j,) of the readings round independently, and
    averaging halves the error of rounding with every fourfold number; equal ones round alike.
    """
    rounding = resolution**2 / 12
    if len(periods) < 2:
        return resolution
    independent = np.minimum(periods.var(axis=0, ddof=1).mean(axis=0), rounding)
    return np.sqrt(12 * (rounding - independent + independent / len(periods)))


def drift(periods: np.ndarray, used: np.ndarray) -> Drift:
    """The steady change in M periods (M, n, j) and whether their scatter explains it.

    Over the `used` (n, j) samples. Of the power of the scatter the contrast along the number of the
    period has one part in M - 1 if there is no drift, whatever the noise and its correlation. This
    share is taken in each of many stretches of the period, so that all count alike: a drift shows
    in most of them, a joint that vibrates, or sets off late in one of the periods, in a few. As
    these lie side by side, neighbouring stretches count as less than two where they are alike.
    """
    count, samples, joints = periods.shape
    if count < 3:
        return Drift(np.full(joints, np.nan), np.full(joints, np.nan))
    number = np.arange(count) - (count - 1) / 2
    length = np.linalg.norm(number)
    deviation = np.where(used, periods - periods.mean(axis=0), 0.0)
    contrast = np.tensordot(number / length, deviation, axes=1)  # (n, j)
    starts = np.arange(0, samples, max(int(LOCAL * samples), 1))
    steady, whole = (
        np.add.reduceat(power, starts) for power in (contrast**2, (deviation**2).sum(axis=0))
    )  # (stretches, j)
    expected = 1.0 / (count - 1)
    p_value = np.full(joints, np.nan)
    for j in range(joints):
        seen = whole[:, j] > 0.0
        if seen.sum() > 2:
            p_value[j] = _p_value(steady[seen, j] / whole[seen, j], expected)
    # Without what the scatter adds to it.
    change = np.maximum(steady.sum(axis=0) - expected * whole.sum(axis=0), 0.0) / (1.0 - expected)
    return Drift(np.sqrt(change / np.maximum(used.sum(axis=0), 1)) / length, p_value)


def _p_value(share: np.ndarray, expected: float) -> float:
    """How likely neighbours (n,) that are alike have a mean so far above the expected one."""
    above = share.mean() - expected
    deviation = share - share.mean()
    power = (deviation**2).sum()
    if not power > 0.0:
        return 0.0 if above > 0.0 else 1.0
    alike = max(float((deviation[1:] * deviation[:-1]).sum() / power), 0.0)
    independent = max(len(share) * (1.0 - alike) / (1.0 + alike), 2.0)
    error = np.sqrt(power / (len(share) - 1) / independent)
    return float(student.sf(above / error, independent - 1.0))
