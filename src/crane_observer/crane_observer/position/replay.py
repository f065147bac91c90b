"""The position estimator over a recording: the numbers of the node, and smoothed backwards in time.

Smoothing goes backwards over what a filter did (Rauch-Tung-Striebel). With d the correction of a
mean, and errors e, where e_s = S e + n and N is the covariance of n:

    prediction  C = P F^T (I - S')^T ((I - S') P' (I - S')^T + N')^-1
                d = C d'             S = I + C (S' - I) F
                N = C (N' + (S' - I) Q (S' - I)^T) C^T
    correction  K the gain           S = S' (I - K H)
                d = d' + x' - x      N = N' + S' K R K^T S'^T

with ' after the step, and P_s = S P S^T + N, which holds for any gains. C is the one with the least
P_s. If all states are estimated it is P F^T P'^-1; if some are considered and not estimated, of
which nothing is learnt in hindsight either, that one would make states less sure.
"""

from collections.abc import Callable, Iterator, Sequence
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numba import njit
from scipy.linalg import cho_factor, cho_solve

from crane_model.array import Array, Flags
from crane_model.model_file import Model
from crane_observer.position.estimator import EstimatorCondition, PositionEstimator, WindowEstimate
from crane_observer.position.filter import Filter, Hypotheses, mixed
from crane_observer.position.state import (
    Correction,
    FlowWindow,
    Gaussian,
    KeptGaussian,
    PoseEstimate,
    Prediction,
)
from crane_observer.recording import CommandReading, EncoderReading, HeardRecording

RIDGE = 1e-11  # of a variance, where states are known to move as one
CHAPTER = 200  # windows, which are gone through again at once: all steps of one are kept
CONFIDENCE = 1.96  # standard deviations
ONLINE_COLOR, SMOOTHED_COLOR = "tab:blue", "tab:orange"


class KnownLater:
    """Knowledge at a moment from all later data; at first there are none."""

    def __init__(self, size: int):
        self._d, self._S, self._N = np.zeros(size), np.eye(size), np.zeros((size, size))

    def of(self, state: Gaussian) -> Gaussian:
        """The state smoothed, which the filter had at this moment."""
        P = self._S @ state.P @ self._S.T + self._N
        return Gaussian(state.x + self._d, 0.5 * (P + P.T), state.estimated)

    def back(self, step: Prediction | Correction) -> None:
        if isinstance(step, Correction):
            kept, noise = closed(step.before.P, step.H, step.variance, step.before.estimated)
            self._N = self._N + self._S @ noise @ self._S.T
            self._S = self._S @ kept
            self._d = self._d + step.after.x - step.before.x
        else:
            self._predict(step)

    def _predict(self, step: Prediction) -> None:
        P, F, after = step.before.P, step.F, step.after.P
        away = self._S - np.eye(len(after))
        learnt = away @ after @ away.T + self._N
        known = slice(step.before.estimated)
        scale = 1.0 / np.sqrt(np.diag(after)[known])
        alike = learnt[known, known] * np.outer(scale, scale) + RIDGE * np.eye(len(scale))
        shared = (away @ F @ P)[known, known] * scale[:, np.newaxis]
        C = np.zeros_like(P)
        C[known, known] = -cho_solve(cho_factor(alike), shared).T * scale
        noise = after - F @ P @ F.T
        self._N = C @ (self._N + away @ noise @ away.T) @ C.T
        self._S = np.eye(len(after)) + C @ away @ F
        self._d = C @ self._d


def transition(step: Prediction | Correction) -> Array:
    """(size, size) of errors over a step: e' = S e + noise."""
    if isinstance(step, Prediction):
        return step.F
    return closed(step.before.P, step.H, step.variance, step.before.estimated)[0]


@njit(cache=True, error_model="numpy")
def closed(P: Array, H: Array, variance: Array, estimated: int) -> tuple[Array, Array]:
    """I - K H and K R K^T of what `crane_observer.position.state.correct` does to P (n, n)."""
    n = len(P)
    P, kept, noise = P.copy(), np.eye(n), np.zeros((n, n))
    for r in range(len(variance)):
        if not np.isfinite(variance[r]):
            continue
        seen = P @ H[r]
        gain = seen / (H[r] @ seen + variance[r])
        gain[estimated:] = 0.0
        step = np.eye(n) - np.outer(gain, H[r])
        kept = step @ kept
        noise = step @ noise @ step.T + variance[r] * np.outer(gain, gain)
        P = step @ P @ step.T + variance[r] * np.outer(gain, gain)
    return kept, noise


class Past:
    """Windows as they were gone through, and what was known at the beginning of each chapter."""

    def __init__(self, begun: Hypotheses):
        self._begun = [begun.copied()]
        self._chapters: list[list[FlowWindow]] = [[]]

    def add(self, window: FlowWindow, after: Hypotheses) -> None:
        """One more window, and what is known after it."""
        self._chapters[-1].append(window)
        if len(self._chapters[-1]) == CHAPTER:
            self._begun.append(after.copied())
            self._chapters.append([])

    def smoothed(self, after: Hypotheses) -> list[PoseEstimate]:
        """Estimates after each window, of the starts that are still possible in the end."""
        courses = [
            _backwards([_of(hypotheses, last.start) for hypotheses in self._begun], self._chapters)
            for last in after.filters
        ]
        return [mixed(estimates, after.scores) for estimates in zip(*courses, strict=True)]


class _Mark(NamedTuple):
    steps: int  # that were kept until then
    state: Gaussian
    told: PoseEstimate


def _of(hypotheses: Hypotheses, start: Array) -> Filter:
    """The filter from this start; a copy has the same one."""
    return next(hypothesis for hypothesis in hypotheses.filters if hypothesis.start is start)


def _backwards(
    begun: Sequence[Filter], chapters: Sequence[Sequence[FlowWindow]]
) -> list[PoseEstimate]:
    known = begun[0].known
    later, found = KnownLater(known.layout.size), list[PoseEstimate]()
    for first, windows in zip(reversed(begun), reversed(chapters), strict=True):
        again = first.copied()
        kept = again.state = KeptGaussian(first.state)
        marks = []
        for window in windows:
            told = again.step(window)
            marks.append(_Mark(len(kept.steps), kept.now(), told))
        for mark in reversed(marks):
            while len(kept.steps) > mark.steps:
                later.back(kept.steps.pop())
            found.append(_smoothed(mark, later.of(mark.state), again))
        while kept.steps:
            later.back(kept.steps.pop())
    found.reverse()
    for k, (before, after) in enumerate(pairwise(found), start=1):
        displacement = after.position - before.position
        found[k] = after._replace(velocity=displacement / (after.time - before.time))
    return found


def _smoothed(mark: _Mark, smoothed: Gaussian, of: Filter) -> PoseEstimate:
    """With a load that may hide at rest as it could then."""
    known, told = of.known, of.known.layout.told
    hidden = mark.told.covariance - mark.state.P[np.ix_(told, told)]
    return mark.told._replace(
        position=np.clip(smoothed.x[told[:-1]], known.low, known.high),
        covariance=smoothed.P[np.ix_(told, told)] + hidden,
        load=float(smoothed.x[told[-1]]),
    )


class EstimatedCourse(NamedTuple):
    """Estimates at n times, of j joints."""

    time: Array  # (n,) s
    position: Array  # (n, j)
    velocity: Array  # (n, j)
    deviation: Array  # (n, j)
    load: Array  # (n,) kg
    load_deviation: Array  # (n,) kg
    covariance: Array  # (n, j + 1, j + 1)
    observable: Flags  # (n, j)
    changed: Flags  # (n,) a load came or went
    conditions: tuple[EstimatorCondition, ...]

    @classmethod
    def of(cls, told: Sequence[WindowEstimate]) -> "EstimatedCourse":
        poses = [window.estimate for window in told]
        deviation = np.array([pose.deviation for pose in poses])

        def column(name: str) -> Array:
            return np.array([getattr(pose, name) for pose in poses])

        return cls(
            column("time"), column("position"), column("velocity"), deviation[:, :-1],
            column("load"), deviation[:, -1], column("covariance"),
            np.array([window.observable for window in told]),
            np.array([pose.surprised for pose in poses]),
            tuple(window.condition for window in told),
        )  # fmt: skip


def replay(
    estimator: PositionEstimator, recording: HeardRecording, hidden: Flags
) -> EstimatedCourse:
    """Feed a recording to an estimator, without the encoders that are `hidden` (j,)."""
    return EstimatedCourse.of(list(_told(estimator, recording, hidden)))


def replay_smoothed(
    estimator: PositionEstimator,
    recording: HeardRecording,
    hidden: Flags,
    watch: Callable[[float], None] = lambda _: None,
) -> tuple[EstimatedCourse, EstimatedCourse]:
    """As `replay`, with all that came later, too; `watch` gets each window's time [s]."""
    past, told = Past(estimator.hypotheses), []
    for window in _told(estimator, recording, hidden):
        told.append(window)
        past.add(estimator.window, estimator.hypotheses)
        watch(window.estimate.time)
    later = past.smoothed(estimator.hypotheses)
    smoothed = [now._replace(estimate=pose) for now, pose in zip(told, later, strict=True)]
    return EstimatedCourse.of(told), EstimatedCourse.of(smoothed)


def _told(
    estimator: PositionEstimator, recording: HeardRecording, hidden: Flags
) -> Iterator[WindowEstimate]:
    for reading in recording.readings():
        if isinstance(reading, EncoderReading):
            estimator.add_encoders(reading.time, np.where(hidden, np.nan, reading.position))
        elif isinstance(reading, CommandReading):
            estimator.add_command(*reading)
        elif (told := estimator.add_pressures(*reading)) is not None:
            yield told


def draw(
    path: Path, model: Model, course: EstimatedCourse, smoothed: EstimatedCourse,
    reference: Array, hidden: Flags,
) -> None:  # fmt: skip
    """Draw errors over time, as told and smoothed, and the load.

    `reference` (n, j) is what encoders said; of joints that are `hidden` (j,) it was not used.
    """
    from matplotlib.figure import Figure  # a second to import

    joints = len(model.joints)
    figure = Figure(figsize=(9.0, 2.2 * (joints + 1)), layout="constrained")
    axes = figure.subplots(joints + 1, 1, sharex=True)
    drawn = ((course, ONLINE_COLOR, "estimate"), (smoothed, SMOOTHED_COLOR, "smoothed"))
    for j, joint in enumerate(model.joints):
        unit = "mm" if model.setting.units[joint] == "m" else "mrad"
        for shown, color, name in drawn:
            around = CONFIDENCE * 1e3 * shown.deviation[:, j]
            error = 1e3 * (shown.position[:, j] - reference[:, j])
            axes[j].fill_between(shown.time, -around, around, color=color, alpha=0.15, linewidth=0)
            axes[j].plot(shown.time, error, linewidth=0.8, color=color, label=f"{name} − encoder")
        dark = np.where(course.observable[:, j], np.nan, 0.0)
        axes[j].plot(course.time, dark, color="tab:red", linewidth=3, label="not observable")
        axes[j].set_ylabel(f"{joint.replace('_', ' ')}\n[{unit}]")
        axes[j].set_title("without its encoder" if hidden[j] else "with its encoder", fontsize=9)
    axes[0].legend(loc="upper right", fontsize=8, title="with 95 % bands", title_fontsize=8)
    for shown, color, _ in drawn:
        low, high = (shown.load + sign * CONFIDENCE * shown.load_deviation for sign in (-1.0, 1.0))
        axes[-1].fill_between(shown.time, low, high, color=color, alpha=0.15, linewidth=0)
        axes[-1].plot(shown.time, shown.load, linewidth=0.8, color=color)
    axes[-1].set_ylabel("load [kg]")
    axes[-1].set_ylim(-30.0, max(50.0, 1.2 * float(course.load.max())))
    axes[-1].set_xlabel("time [s]")
    figure.savefig(path, dpi=110)
