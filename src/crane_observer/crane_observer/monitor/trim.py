"""What the model is off by on a machine, always and alike: learnt, and taken off the residuals.

A transducer whose zero is off makes a flow that follows the slope of the valve's edge at the
pressures of the moment, so it shows most where an edge has next to no pressure left; what the
identification made of it is an error of the gains, up and down. In a block

    r = zero S + up max(x_E, 0) + down min(x_E, 0)

with S what a transducer adds that is 1 Pa off. What changes with the time of day stays in the
residuals, and in their tolerance.
"""

from collections.abc import Sequence

import numpy as np
from scipy.optimize import least_squares

from crane_model.array import Array

SPAN = 20  # blocks, over which what encoders round hardly counts
ZERO, GAIN = 1e5, 0.02  # Pa and 1: standard deviations of what is to be expected
OUTLYING = 3.0  # times the usual residual, beyond which a span counts less
TERMS = 3


def regressors(pressed: Array, course: Array) -> Array:
    """(n, c, TERMS) of blocks whose transducers add `pressed` (n, c) m/Pa while the piston goes
    `course` (n, c) m.
    """
    return np.stack([pressed, np.maximum(course, 0.0), np.minimum(course, 0.0)], axis=-1)


def fitted(recordings: Sequence[tuple[Array, Array]]) -> Array:
    """(c, TERMS) from residuals (n, c) of blocks and their regressors (n, c, TERMS)."""
    residual = np.concatenate([_spans(one) for one, _ in recordings])
    columns = np.concatenate([_spans(one) for _, one in recordings])
    return np.array(
        [_robust(residual[:, c], columns[:, c]) for c in range(residual.shape[1])]
    ).reshape(-1, TERMS)


def _spans(blocks: Array) -> Array:
    whole = len(blocks) // SPAN
    return blocks[: whole * SPAN].reshape(whole, SPAN, *blocks.shape[1:]).sum(axis=1)


def _robust(residual: Array, columns: Array) -> Array:
    """(TERMS,) by Huber's loss, with what is to be expected as measurements."""
    moving = np.any(columns != 0.0, axis=1)
    scale = np.array([ZERO, GAIN, GAIN])
    usual = float(np.median(np.abs(residual[moving]))) if moving.any() else 0.0
    if usual == 0.0:
        return np.zeros(TERMS)
    weighted, target = columns[moving] * scale / usual, residual[moving] / usual

    def left(share: Array) -> Array:
        return np.concatenate([weighted @ share - target, share])

    found = least_squares(left, np.zeros(TERMS), loss="huber", f_scale=OUTLYING)
    return np.asarray(found.x * scale)
