"""How much of what a model leaves of a recording is the weight of loads that come and go."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from crane_identification.data.log import Log
from crane_identification.options import Options
from crane_identification.preparation.prepare import prepare
from crane_identification.preparation.run import Preparation
from crane_model.errors import DataError
from crane_model.model_file import Model
from crane_observer.scale.balance import MeanMotion, TipMechanics

WINDOW = 0.25  # s, over which forces are averaged, so that noise is


def load_share(model: Model, log: Log, options: Options, changes: Sequence[float]) -> float:
    """Share 0..1 of the energy that the model leaves which loads explain, each constant between
    the `changes` [s]; 0 where the recording cannot be prepared.

    With r what the model leaves of the drives' forces, each in units of its rms, and h_m what 1 kg
    at the tip asks of them: by how much r falls when it is fitted by h_m in each part.
    """
    try:
        runs = prepare(model, log, replace(options, average=False))
    except DataError:
        return 0.0
    parts = [_left_and_pull(model, run) for run in runs]
    time, left, pull = (np.concatenate(one) for one in zip(*parts, strict=True))
    part = np.searchsorted(changes, time)
    energy, explained = float((left**2).sum()), 0.0
    for number in np.unique(part):
        r, h = left[part == number].ravel(), pull[part == number].ravel()
        explained += float(r @ h) ** 2 / max(float(h @ h), 1e-12)
    return explained / energy if energy > 0.0 else 0.0


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
