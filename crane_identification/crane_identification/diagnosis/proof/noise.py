"""Noise of the force: how it scatters from period to period, and from sample to sample."""

from collections.abc import Sequence
from math import comb

import numpy as np

from crane_identification.diagnosis.fit.evidence import Evidence
from crane_identification.diagnosis.fit.runs import row_noise
from crane_identification.estimation.regression import OPEN
from crane_identification.preparation.averaging import noise_of_mean
from crane_identification.preparation.run import Preparation
from crane_identification.signals.decimate import decimate

ORDER = 4
"""Of the differences between samples: of a motion of 2 Hz, sampled with 200 Hz, they keep 2e-6."""


def scatter_of_periods(averaged: Sequence[Preparation], factor: int, joints: int) -> np.ndarray:
    """Root mean square noise (j,) of the filtered force, from the scatter between periods; NaN
    where none was repeated that moves the joint.

    It holds what a motion does not repeat and what a machine does not: neither is of sensors.
    """
    power, count = np.zeros((2, joints))
    for preparation in averaged:
        repeated = len(preparation.periods)
        if repeated < 2:
            continue
        periods = np.stack([decimate(one, factor, True) for one in preparation.periods])
        gate = decimate(preparation.signed.astype(float), factor, True) > OPEN
        moved = gate.any(axis=0)
        power[moved] += noise_of_mean(periods, gate)[moved] ** 2 * repeated
        count += moved
    return np.sqrt(np.where(count > 0, power / np.maximum(count, 1), np.nan))


def scatter_of_samples(evidence: Evidence) -> np.ndarray:
    """Root mean square noise (j,) of its rows while joints move, if that of the samples is white:
    from differences of the force, in which no motion is left (Gasser, Sroka and Jennen-Steinmetz,
    Biometrika 73 (1986)).
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
