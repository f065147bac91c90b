"""Pulsation: a line in the spectrum of the residual, faster than anything that is moved on purpose.

The rows of the evidence hold few of its periods and nothing that it depends on, so that nothing
else of a diagnosis sees it. Booms swing as fast, but in every pose at another frequency: what has
the same one in all recordings comes from elsewhere, as from a pump or from electronics.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy import ndimage, signal

from crane_identification.diagnosis.fit.runs import Run
from crane_identification.thresholds import Thresholds
from crane_model.model_file import Model

SPACING = 0.0125  # Hz, of the frequencies that are asked: finer than a minute resolves
HALF_WIDTH = 1.0  # Hz to either side, whose median is the level that a line stands out of
LOWEST_FREQUENCY = 1.0  # Hz
HIGHEST_SHARE = 0.2  # of the sampling rate: the highest frequency
TINY = np.finfo(float).tiny


@dataclass(frozen=True)
class Pulsation:
    """A line in the force of a joint at a `frequency` [Hz] that the model does not explain.

    `strength`: its rms over that of the joint's force, in the middle one of the recordings.
    """

    joint: str
    frequency: float
    strength: float


class Line(NamedTuple):
    """What may be a pulsation, and its `clearness`: log(power over level), its mean over R
    recordings times sqrt(R).
    """

    pulsation: Pulsation
    clearness: float


def clearest_lines(model: Model, runs: Sequence[Run], fewest: int) -> tuple[Line, ...]:
    """The clearest line of each joint beside the fitted `model`, whether or not it is clear enough;
    none where recordings are too short or fewer than `fewest`.
    """
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
        Line(Pulsation(joint, float(asked[k]), float(strength[k, j])), float(clear[k, j]))
        for j, (joint, k) in enumerate(zip(model.joints, best, strict=True))
    )


def pulsations(lines: Sequence[Line], thresholds: Thresholds) -> tuple[Pulsation, ...]:
    """The lines that are clear enough."""
    least = thresholds.gates.pulsation_clearness
    return tuple(one.pulsation for one in lines if one.clearness > least)


def _step(run: Run) -> float:
    """Of the samples [s]."""
    return float(np.diff(run.record.time).mean())


def _spectrum(model: Model, run: Run, asked: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(f, j) at the frequencies `asked` [Hz] (f,): log of the residual's power over the level
    around, and the rms of a line there over that of the force.
    """
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
