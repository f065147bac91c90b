"""Do the training recordings determine the model, or only what they happened to ask of it?

A fit that is good on its own recordings may be wrong on others, where some joints always moved
alike: then only combinations of parameters are known, though well enough for a small residual.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from crane_identification.estimation.rows import Rows, balancing, solve_weighted
from crane_identification.notation import listed, short_percent, spoken
from crane_identification.preparation.run import Preparation

PARTS = 4
"""Parts of each recording, each left out in turn."""
WORSE_LEFT_OUT = 3.0
"""Error where left out over that of the fit, above which recordings do not determine a model. Of a
robot with six axes: 2.4 and 1.6 of two and three recordings that do, 6 and 20 of single ones."""
VISIBLE_ERROR = 0.03
"""Share of the force below which an error is none to speak of."""
FLAT = 0.05
"""Width of a motion in one direction of the joints' space, over the mean width of a joint, below
which it does not count. Of the robot: 0.003 to 0.03 against 0.19 and more."""


def undetermined(rows: Rows, trained: np.ndarray, preparations: Sequence[Preparation]) -> str:
    """A warning if parts of the training recordings do not foretell the others; else empty.

    `trained` (j,) is the error of the fit relative to the force.
    """
    left = left_out(rows)
    worse = [
        f"{spoken(joint)} {short_percent(float(there))} against {short_percent(float(here))}"
        for joint, there, here in zip(rows.joints, left, trained, strict=True)
        if there > max(WORSE_LEFT_OUT * here, VISIBLE_ERROR)
    ]
    if not worse:
        return ""
    count, joints = spanned(preparations), len(rows.joints)
    alike = (
        f" The joints move alike: their motion spans {count} of {joints} dimensions."
        if count < joints
        else ""
    )
    return (
        "These recordings do not determine the model: a quarter that is left out is foretold worse "
        f"than it is fitted ({listed(worse)}).{alike} Add recordings of other motions, or what is "
        "known beforehand (--prior)."
    )


def left_out(rows: Rows) -> np.ndarray:
    """Error of each joint (j,) relative to its force, each part foretold by the others; NaN where
    the others have too few rows.
    """
    weights = balancing(rows)
    part = np.empty(len(rows.run), dtype=int)
    for run in np.unique(rows.run):
        own = np.flatnonzero(rows.run == run)
        part[own] = np.arange(len(own)) * PARTS // len(own)
    errors, forces = np.zeros((2, len(rows.joints)))
    for k in range(PARTS):
        others, one = _of(rows, part != k), _of(rows, part == k)
        if others.samples <= len(rows.names):
            return np.full(len(rows.joints), np.nan)
        values = solve_weighted(others, weights).values
        errors += one.norms(one.residual(values)) ** 2
        forces += one.norms(one.force) ** 2
    return np.sqrt(np.divide(errors, forces, out=np.full_like(errors, np.nan), where=forces > 0.0))


def spanned(preparations: Sequence[Preparation]) -> int:
    """In how many directions of the joints' space the motion is wide."""
    position = np.concatenate([one.record.position for one in preparations])
    deviation = position - position.mean(axis=0)
    width = deviation.std(axis=0)
    scaled = deviation / np.where(width > 0.0, width, 1.0)
    singular = np.linalg.svd(scaled, compute_uv=False) / np.sqrt(len(scaled))
    return int((singular > FLAT).sum())


def _of(rows: Rows, chosen: np.ndarray) -> Rows:
    return replace(rows, used=rows.used & chosen[:, np.newaxis])
