"""The gap between model and measurement on recordings that took no part, before and after."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import comb
from typing import NamedTuple, SupportsIndex

import numpy as np
from scipy import ndimage, signal
from scipy.stats import ttest_1samp
from sklearn.ensemble import HistGradientBoostingRegressor
from threadpoolctl import threadpool_limits

from crane_identification.data.log import Log
from crane_identification.diagnosis.candidates import Weighed, with_own_loads
from crane_identification.diagnosis.constants import FEWEST_ROWS
from crane_identification.diagnosis.evidence import TINY, Evidence, Run
from crane_identification.diagnosis.fit import Fitted
from crane_identification.diagnosis.judgement import HeldOutChange
from crane_identification.estimation.regression import LEAST_OPEN_SHARE
from crane_identification.preparation.run import Preparation, noise_of_mean
from crane_identification.signals.decimate import decimate
from crane_identification.signals.gated import reached, row_noise
from crane_identification.thresholds import Gates, Method, Thresholds
from crane_identification.validation.motion_validation import (
    CommandedRun,
    CommandValidation,
    MotionValidation,
    validate_motion,
    validate_runs,
)
from crane_model.errors import CraneError
from crane_model.hydraulics.simulation import simulated_circuit
from crane_model.model_file import Model

# Noise of the force: how it scatters from period to period, and from sample to sample.

ORDER = 4
"""Differences of this order keep 2e-6 of a motion of 2 Hz that is sampled with 200 Hz."""


def scatter_of_periods(averaged: Sequence[Preparation], factor: int, joints: int) -> np.ndarray:
    """Noise (j,) of the filtered force by the scatter between periods; NaN if unknown."""
    power, count = np.zeros((2, joints))
    for preparation in averaged:
        repeated = len(preparation.periods)
        if repeated < 2:
            continue
        periods = np.stack([decimate(one, factor, True) for one in preparation.periods])
        gate = decimate(preparation.signed.astype(float), factor, True) > LEAST_OPEN_SHARE
        moved = gate.any(axis=0)
        power[moved] += noise_of_mean(periods, gate)[moved] ** 2 * repeated
        count += moved
    return np.sqrt(np.where(count > 0, power / np.maximum(count, 1), np.nan))


def scatter_of_samples(evidence: Evidence) -> np.ndarray:
    """Root mean square noise (j,) of the rows, if that of the samples is white: from differences of
    the force, in which no motion is left (Gasser, Sroka and Jennen-Steinmetz, Biometrika 73, 1986).
    """
    joints = len(evidence.joints)
    weights = np.array([(-1.0) ** k * comb(ORDER, k) for k in range(ORDER + 1)])
    inside = slice(ORDER // 2, -(ORDER // 2))
    power, count = np.zeros((2, joints))
    for run in evidence.runs:
        force = run.record.needed("force", "the noise of samples")
        if len(force) <= ORDER:
            continue
        windows = np.lib.stride_tricks.sliding_window_view(force, ORDER + 1, axis=0)
        moving = run.gate[inside, :joints] > 0.0
        power += (((windows @ weights) ** 2) * moving).sum(axis=0)
        count += moving.sum(axis=0)
    variance = power / np.maximum(count, 1) / (weights**2).sum()
    return np.sqrt(variance) * row_noise(evidence.runs[0].factor)


# A flexible learner: how much of a residual any law of the logged quantities could explain.

ITERATIONS = 80
SEED = 7
BLOCK = 10  # rows, some seconds: longer than what a residual remembers


@dataclass(frozen=True)
class Learnt:
    """Share (j,) of a residual that its out-of-fold prediction explains, how likely chance gives
    such gains, and root mean square of what is explained over that of the force. Folds that are
    predicted worse than zero count as not explained.
    """

    share: np.ndarray
    p_value: np.ndarray
    strength: np.ndarray

    def follows_law(self, thresholds: Thresholds) -> np.ndarray:
        """Return whether a joint (j,) follows a law, beyond chance and errors of the processing."""
        limit = thresholds.method.false_alarm_rate / 2.0 / len(self.share)
        return (self.p_value < limit) & (self.strength > thresholds.gates.smallest_strength)


@threadpool_limits.wrap(limits=1)  # so few rows are learnt faster by one thread than by several
def learn(evidence: Evidence, residual: np.ndarray, fold: np.ndarray) -> Learnt:
    """Predict the residual (n, c) of each fold (n,) from the others, on each joint (j,)."""
    known = evidence.known

    def learnt(j: int) -> tuple[float, float, float]:
        used, measured = evidence.used[:, j], residual[:, j]
        prediction, gain = np.zeros((2, len(used)))
        if used.sum() < FEWEST_ROWS:
            return 0.0, 1.0, 0.0
        for number in np.unique(fold[used]):
            inside = used & (fold != number)
            outside = used & (fold == number)
            if inside.sum() < FEWEST_ROWS:
                continue
            model = fitted(known.values[inside], measured[inside])
            expected = model.predict(known.values[outside])
            actual = measured[outside]
            gain[outside] = actual**2 - (actual - expected) ** 2
            if gain[outside].sum() > 0.0:
                prediction[outside] = expected
        power = float((measured[used] ** 2).sum())
        left = float(((measured - prediction)[used] ** 2).sum())
        share = 1.0 - left / power if power > 0.0 else 0.0
        strength = np.sqrt(max(power - left, 0.0) / used.sum()) / evidence.force_rms[j]
        # Neighbours, alike, count as one block: chance that the true mean is at most zero.
        count = used.sum() // BLOCK
        blocks = gain[used][: count * BLOCK].reshape(-1, BLOCK).mean(axis=1)
        p_value = float(ttest_1samp(blocks, 0.0, alternative="greater").pvalue)
        return share, p_value, strength

    return Learnt(*np.array(list(map(learnt, range(len(evidence.joints))))).T)


def fitted(values: np.ndarray, target: np.ndarray) -> HistGradientBoostingRegressor:
    """The learner on rows (n, f)."""
    learner = HistGradientBoostingRegressor(
        max_iter=ITERATIONS,
        learning_rate=0.1,
        max_leaf_nodes=15,
        min_samples_leaf=20,
        l2_regularization=1.0,
        early_stopping=False,
        random_state=SEED,
    )
    return learner.fit(values, target)


@threadpool_limits.wrap(limits=1)
def predict_elsewhere(evidence: Evidence, residual: np.ndarray, other: Evidence) -> np.ndarray:
    """The residual (n', j) of other evidence as learnt from this one."""
    here, there = evidence.known, other.known
    out = np.zeros_like(other.force)
    for j in range(residual.shape[1]):
        used = evidence.used[:, j]
        if used.sum() >= FEWEST_ROWS:
            out[:, j] = fitted(here.values[used], residual[used, j]).predict(there.values)
    return out


OF_PERIODS = "the scatter between periods"
OF_SAMPLES = "what the scatter of samples and surveyed lengths account for"
RESOLUTION = 1e-6  # relative error, below which numbers are rounding


@dataclass(frozen=True)
class HeldOut:
    """Per joint (j,), relative to the rms of the force: error `before` and `after`, the `floor` of
    noise, and the `best` that a flexible learner reaches.
    """

    joints: tuple[str, ...]
    before: np.ndarray
    after: np.ndarray
    floor: np.ndarray
    best: np.ndarray
    method: Method

    @property
    def reachable(self) -> np.ndarray:
        """Error that some model reaches (j,): noise, the learner, or the error `after`."""
        return np.fmin(np.fmin(self.method.clean_factor * self.floor, self.best), self.after)

    @property
    def closed(self) -> np.ndarray:
        """Share (j,) of the explainable gap, in energy, that is closed; NaN if there is none."""
        return np.array([self.closed_on([j]) for j in range(len(self.joints))])

    def closed_on(self, joints: Sequence[int]) -> float:
        """The share of several joints together, each in units of its reachable error."""
        own = list(joints)
        unit = np.maximum(self.reachable[own], RESOLUTION) ** 2
        before, after, least = (
            float((error[own] ** 2 / unit).sum())
            for error in (self.before, self.after, self.reachable)
        )
        explainable = before - least
        gap = explainable > self.method.explainable_share * before
        return (before - after) / explainable if gap else np.nan

    def change(self, j: SupportsIndex) -> HeldOutChange:
        return HeldOutChange(self.joints[j], float(self.before[j]), float(self.after[j]))

    def is_noise(self, joints: Sequence[int]) -> bool:
        own = list(joints)
        return bool((self.before[own] <= self.method.clean_factor * self.floor[own]).all())


@dataclass(frozen=True)
class Gap(HeldOut):
    """Errors of all held-out rows and, in `trained`, of those where training went. `uncertain`:
    error that the standard deviations of values that are kept allow. `loads` of the held-out
    recordings, which `carried` holds. `sample_noise`: that of the held-out force over its rms.
    """

    training_before: np.ndarray
    training_after: np.ndarray
    motion_before: MotionValidation
    motion_after: MotionValidation
    loads: tuple[Weighed, ...]
    carried: Model
    sample_noise: np.ndarray
    uncertain: np.ndarray | float = 0.0
    trained: HeldOut | None = None

    @property
    def held_to(self) -> HeldOut:
        return self.trained or self

    @property
    def largest_before(self) -> np.ndarray:
        return np.maximum(self.before, self.training_before)

    @property
    def worst(self) -> int:
        """Number of the joint whose force errs most, beyond what is noise there."""
        error, noise = self.largest_before, np.nan_to_num(self.method.clean_factor * self.floor)
        return int(np.argmax(error**2 - np.minimum(noise, error) ** 2))

    def over(self, errors: np.ndarray, scatter: str) -> np.ndarray:
        """Errors (j,) over what the `scatter` accounts for; NaN if unknown."""
        if scatter == OF_PERIODS:
            return errors / np.maximum(self.floor, RESOLUTION)
        return errors / np.hypot(self.sample_noise, self.method.surveyed_error)

    def beyond(self, errors: np.ndarray, gates: Gates, scatter: str) -> np.ndarray:
        """Return whether errors (j,) are more than noise, uncertain values and surveyed lengths."""
        periods = scatter == OF_PERIODS
        factor = gates.floor_factor if periods else gates.sample_noise_factor
        beyond: np.ndarray = (
            (self.over(errors, scatter) > factor)
            & (errors > gates.floor_factor * self.uncertain)
            & (errors > self.method.surveyed_error * periods)
        )
        return beyond


class Unchanged(NamedTuple):
    """Training residual (n, c) of the model before, its prediction held out, and its motion."""

    training: np.ndarray
    expected: np.ndarray
    motion: MotionValidation


def unchanged(fit: Fitted) -> Unchanged:
    """The part of the gap that no effect changes."""
    left, j = fit.evidence.residual(fit.before), len(fit.before.joints)
    expected = predict_elsewhere(fit.evidence.moving, left[:, :j], fit.held_out.moving)
    return Unchanged(left, expected, _motion(fit, fit.before))


def _motion(fit: Fitted, model: Model) -> MotionValidation:
    return validate_motion(model, [run.record for run in fit.held_out.runs])


def measure(fit: Fitted, after: Model, method: Method, known: Unchanged) -> Gap:
    """The errors before and after, with the load of each recording, held out."""
    before, training, held_out = fit.before, fit.evidence, fit.held_out
    j = len(before.joints)
    noise = scatter_of_periods(fit.periods, held_out.runs[0].factor, j)
    doubt = uncertain(held_out, after) if training.keeps else 0.0
    after, loads = with_own_loads(after, training, held_out)
    old, new = held_out.residual(before), held_out.residual(after)
    learnt = np.minimum(np.abs(old), np.abs(new))  # close to reversals, what the better one leaves
    learnt[:, :j] = known.expected - old[:, :j]

    def errors(rows: Evidence) -> HeldOut:
        size = np.maximum(rows.over_zones(rows.force), TINY)
        first, last, best = (rows.over_zones(values) / size for values in (old, new, learnt))
        return HeldOut(rows.joints, first, last, noise / size, np.minimum(best, first), method)

    return Gap(
        **vars(errors(held_out)),
        training_before=training.relative(known.training),
        training_after=training.relative(training.residual(after)),
        motion_before=known.motion,
        motion_after=known.motion if after is before else _motion(fit, after),
        loads=loads,
        carried=after,
        sample_noise=scatter_of_samples(held_out)
        / np.maximum(held_out.over_zones(held_out.force), TINY),
        uncertain=doubt,
        trained=errors(where_trained(training, held_out)),
    )


def where_trained(training: Evidence, held_out: Evidence) -> Evidence:
    """The held-out rows that see each joint within the range that it went through in training."""
    joints = len(training.joints)
    used = training.used.reshape(len(training.time), -1, joints).any(axis=1)
    q = np.concatenate([run.record.position[run.kept] for run in training.runs])
    low = np.where(used, q, np.inf).min(axis=0)
    high = np.where(used, q, -np.inf).max(axis=0)
    beyond = []
    for run in held_out.runs:
        outside = (run.record.position < low) | (run.record.position > high)
        beyond.append(reached(outside & (low <= high), run.factor))
    zones = held_out.used.shape[1] // joints
    return replace(held_out, used=held_out.used & ~np.tile(np.concatenate(beyond), zones))


def uncertain(evidence: Evidence, model: Model) -> np.ndarray:
    """Error (j,) of the force, relative to it, that the standard deviations of values make."""
    assert model.std_devs is not None  # of values that are kept
    parts = evidence.regressor(model) * model.std_devs
    return evidence.relative(np.linalg.norm(parts, axis=2))


# Pulsation: a line in the spectrum of the residual, faster than anything that is moved on purpose.
#
# The rows of the evidence hold few of its periods and nothing that it depends on, so that nothing
# else of a diagnosis sees it. Booms swing as fast, but in every pose at another frequency: what has
# the same one in all recordings comes from elsewhere, as from a pump or from electronics.

SPACING = 0.0125  # Hz, of the frequencies that are asked: finer than a minute resolves
HALF_WIDTH = 1.0  # Hz to either side, whose median is the level that a line stands out of
LOWEST_FREQUENCY = 1.0  # Hz
HIGHEST_SHARE = 0.2  # of the sampling rate: the highest frequency


class Line(NamedTuple):
    """A line at a `frequency` [Hz], its relative rms, and mean log(power/level) √recordings."""

    joint: str
    frequency: float
    relative_magnitude: float
    clearness: float


def clearest_lines(model: Model, runs: Sequence[Run], fewest: int) -> tuple[Line, ...]:
    """The clearest line that the `model` leaves on each joint; none of too few recordings."""
    longest = dict[str, Run]()
    for run in runs:
        other = longest.get(run.source)
        if other is None or len(run.record) > len(other.record):
            longest[run.source] = run
    if len(longest) < fewest:
        return ()
    highest = min(HIGHEST_SHARE / _step(run) for run in longest.values())
    asked = np.arange(LOWEST_FREQUENCY, highest, SPACING)
    if not len(asked):
        return ()
    spectra = [_spectrum(model, run, asked) for run in longest.values()]
    clear = np.mean([ratio for ratio, _ in spectra], axis=0) * np.sqrt(len(spectra))
    strength = np.median([strength for _, strength in spectra], axis=0)
    best = clear.argmax(axis=0)
    return tuple(
        Line(joint, float(asked[k]), float(strength[k, j]), float(clear[k, j]))
        for j, (joint, k) in enumerate(zip(model.joints, best, strict=True))
    )


def pulsations(lines: Sequence[Line], thresholds: Thresholds) -> tuple[Line, ...]:
    """The lines that are clear enough."""
    least = thresholds.gates.pulsation_clearness
    return tuple(one for one in lines if one.clearness > least)


def _step(run: Run) -> float:
    return float(np.diff(run.record.time).mean())


def _spectrum(model: Model, run: Run, asked: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Log of the residual's power over the level, and relative rms of a line (f, j each)."""
    force = run.record.needed("force", "a search for pulsation")
    residual = force - model.predict(run.record)
    window = signal.windows.hann(len(force))[:, np.newaxis]
    count = max(round(1.0 / (SPACING * _step(run))), len(force))
    size = np.abs(np.fft.rfft((residual - residual.mean(axis=0)) * window, n=count, axis=0))
    frequency = np.fft.rfftfreq(count, _step(run))
    width = round(2.0 * HALF_WIDTH / float(frequency[1]))
    level = np.stack([ndimage.median_filter(one, width, mode="nearest") for one in size.T], axis=1)
    clear = 2.0 * np.log(np.maximum(size, TINY) / np.maximum(level, TINY))
    rms = np.sqrt(2.0) * size / window.sum() / np.maximum(np.sqrt((force**2).mean(axis=0)), TINY)

    def at(values: np.ndarray) -> np.ndarray:
        columns = [np.interp(asked, frequency, column) for column in values.T]
        return np.stack(columns, axis=1)

    return at(clear), at(rms)


# The third comparison: motion simulated from valve commands alone, before and after findings.


@dataclass(frozen=True)
class Commanded:
    """Errors before and after for each horizon, or the `reason` why there are none."""

    pairs: tuple[tuple[CommandValidation, CommandValidation], ...] = ()
    reason: str = ""


def commanded(fit: Fitted, after: Model, logs: Sequence[Log]) -> Commanded:
    """Both models through the hydraulics that the model file holds, along the same windows."""
    before, by_source = fit.before, {log.source: log for log in logs}
    runs = []
    for run in fit.held_out.runs:
        log, time = by_source[run.source], run.record.time
        record = replace(run.record, time=time - fit.session.since(log))  # of its commands
        runs.append(CommandedRun(log, record, float(time[1] - time[0])))
    try:
        simulated_circuit(before)
        first = validate_runs(before, runs)
        second = first if after is before else validate_runs(after, runs)
    except CraneError as error:
        return Commanded(reason=str(error))
    return Commanded(tuple(zip(first, second, strict=True)))
