"""How much of what a model leaves of a recording is the weight of loads that come and go.

With r what the model leaves of the drives' forces, each in units of its rms, and h what 1 kg at the
tip asks of them. A load pulls at all joints, with one mass. A force of one joint, as of friction
that follows the way since a reversal, leaves the others alone.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from crane_identification.data.log import Log
from crane_identification.options import Options
from crane_identification.preparation.prepare import prepare
from crane_identification.preparation.run import Preparation
from crane_model.model_file import Model
from crane_observer.scale.balance import MeanMotion, TipMechanics

WINDOW = 0.25  # s, over which forces are averaged, so that noise is
NOTHING = 1e-12  # square of a pull [1/kg^2] or a force that is none


@dataclass(frozen=True)
class Leftover:
    """Of a recording in windows: their `time` (w,) [s], what the model leaves (w, j), what 1 kg
    pulls (w, j) [1/kg].
    """

    time: np.ndarray
    left: np.ndarray
    pull: np.ndarray

    @classmethod
    def of(cls, model: Model, log: Log, options: Options) -> Self:
        """`DataError` where the recording cannot be prepared."""
        runs = prepare(model, log, replace(options, average=False))
        parts = [_left_and_pull(model, run) for run in runs]
        return cls(*(np.concatenate(one) for one in zip(*parts, strict=True)))

    def load_share(self, changes: Sequence[float]) -> float:
        """Share 0..1 of the energy of r that loads explain, each constant between the `changes`."""
        energy, explained = float((self.left**2).sum()), 0.0
        for along, across in self._sums(changes):
            explained += float(along.sum()) ** 2 / max(float(across.sum()), NOTHING)
        return explained / energy if energy > 0.0 else 0.0

    def likeness(self, begin: float, change: float, end: float, weighed: float) -> float:
        """At least 1 where r, from `begin` to `end` [s], steps at a `change` as a load does whose
        step the scale `weighed` [kg]; the smaller the less.

        Each joint may have its own m_j h_j of any cause, and m_j a step d_j. Beside the constant
        part of m_j, n_j is left of the squares of h_j. So one mass explains (sum n d)^2 / sum n of
        the steps, and one joint alone n_j d_j^2: less, unless others fall behind half of its step.
        And to take out what was weighed leaves less than before where that is at most twice the
        mass found, sum n d / sum n.
        """
        within = (self.time >= begin) & (self.time < end)
        sides = Leftover(self.time[within], self.left[within], self.pull[within])._sums([change])
        if len(sides) < 2:
            return 0.0
        (before, square_before), (after, square_after) = sides
        step = after / np.maximum(square_after, NOTHING)
        step -= before / np.maximum(square_before, NOTHING)
        told = square_before * square_after / np.maximum(square_before + square_after, NOTHING)
        mass = float((told * step).sum() / max(float(told.sum()), NOTHING))
        alone = float((told * step**2).max())
        together = mass**2 * float(told.sum())
        return min(together / max(alone, NOTHING), 2.0 * mass / weighed)

    def _sums(self, changes: Sequence[float]) -> list[tuple[np.ndarray, np.ndarray]]:
        """Sums (j,) of r h and of h^2, in each part between the `changes` that has windows."""
        part = np.searchsorted(changes, self.time, side="right")
        rows = [part == number for number in np.unique(part)]
        products, squares = self.left * self.pull, self.pull**2
        return [(products[one].sum(axis=0), squares[one].sum(axis=0)) for one in rows]


def _left_and_pull(model: Model, run: Preparation) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Time (w,) [s], and in windows (w, j) what the model leaves and what 1 kg asks, over the
    rms of each joint's force.
    """
    record = run.record
    force = record.needed("force", "the check of loads")
    unit = np.sqrt((force**2).mean(axis=0))
    left = np.where(run.moving, force - model.predict(record), 0.0) / unit
    mechanics, joints = TipMechanics.of(model), len(unit)
    zero, unknown = np.zeros(joints), np.full(joints, np.nan)
    count = max(1, round(len(left) * run.step / WINDOW))
    windows = np.array_split(np.arange(len(left)), count)
    middle = [rows[len(rows) // 2] for rows in windows]
    weight = np.array(
        [
            mechanics.balance(MeanMotion(q, zero, zero, unknown, unknown)).mass
            for q in record.position[middle]
        ]
    )
    moved = np.array([run.moving[rows].mean(axis=0) for rows in windows])
    mean = np.array([left[rows].mean(axis=0) for rows in windows])
    return record.time[middle], mean, weight * moved / unit
