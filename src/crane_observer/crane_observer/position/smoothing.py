"""What the position sensor would have told, had it known all that came later."""

from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from crane_model.array import Array
from crane_observer.position.filter import Filter
from crane_observer.position.gaussian import Gaussian, KeptGaussian
from crane_observer.position.hypotheses import Hypotheses, mixed
from crane_observer.position.smoother import KnownLater
from crane_observer.position.window import FlowWindow, PoseEstimate

CHAPTER = 200  # windows, which are gone through again at once: all steps of one are kept


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
            _backwards([_of(one, last.start) for one in self._begun], self._chapters)
            for last in after.filters
        ]
        return [mixed(of_one, after.scores) for of_one in zip(*courses, strict=True)]


class _Mark(NamedTuple):
    """After a window."""

    steps: int  # that were kept until then
    state: Gaussian
    told: PoseEstimate


def _of(hypotheses: Hypotheses, start: Array) -> Filter:
    """The filter from this start; a copy has the same one."""
    return next(one for one in hypotheses.filters if one.start is start)


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
            found.append(_told(mark, later.of(mark.state), again))
        while kept.steps:
            later.back(kept.steps.pop())
    found.reverse()
    for k, (before, after) in enumerate(pairwise(found), start=1):
        way = after.position - before.position
        found[k] = after._replace(velocity=way / (after.time - before.time))
    return found


def _told(mark: _Mark, smoothed: Gaussian, of: Filter) -> PoseEstimate:
    """With a load that may hide at rest as it could then."""
    known, told = of.known, of.known.layout.told
    hidden = mark.told.covariance - mark.state.P[np.ix_(told, told)]
    return mark.told._replace(
        position=np.clip(smoothed.x[told[:-1]], known.low, known.high),
        covariance=smoothed.P[np.ix_(told, told)] + hidden,
        load=float(smoothed.x[told[-1]]),
    )
