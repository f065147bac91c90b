"""What the model is off by on a machine, always and alike: learnt, and taken off the residuals.

A transducer whose zero is off makes a flow that follows the slope of the valve's edge at the
pressures of the moment, so it shows most where an edge has next to no pressure left; what the
identification made of it is an error of the gains, up and down. A valve that follows its command
later or sooner than the model says errs with each change of its opening; of a joint that hunts, all
that adds up. A leak that is not that of the model creeps while the joint stands. In a block

    r = zero S + up max(x_E, 0) + down min(x_E, 0) + late W + leak Y

with S what a transducer adds that is 1 Pa off, W a spool that moves 1 s later, and Y a leak of
1 m3/(s Pa) past the piston. What changes with the time of day stays in the residuals, and in their
tolerance.
"""

from collections.abc import Sequence

import numpy as np
from scipy.optimize import least_squares

from crane_model.array import Array

SPAN = 20  # blocks, over which what encoders round hardly counts
EXPECTED = np.array([1e5, 0.02, 0.02, 5e-3, 1e-13])
"""Standard deviations of zero [Pa], up, down, late [s] and leak [m3/(s Pa)]."""
OUTLYING = 3.0  # times the usual residual, beyond which a span counts less
TERMS = len(EXPECTED)


def regressors(pressed: Array, course: Array, late: Array, leak: Array) -> Array:
    """(n, c, TERMS) of blocks whose transducers add `pressed` (n, c) m/Pa, spools `late` m/s and
    leaks `leak` m s-1 Pa m-3 while the piston goes `course` (n, c) m.
    """
    extending, retracting = np.maximum(course, 0.0), np.minimum(course, 0.0)
    return np.stack([pressed, extending, retracting, late, leak], axis=-1)


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
    usual = float(np.median(np.abs(residual[moving]))) if moving.any() else 0.0
    if usual == 0.0:
        return np.zeros(TERMS)
    weighted, target = columns[moving] * EXPECTED / usual, residual[moving] / usual

    def left(share: Array) -> Array:
        return np.concatenate([weighted @ share - target, share])

    found = least_squares(left, np.zeros(TERMS), loss="huber", f_scale=OUTLYING)
    return np.asarray(found.x * EXPECTED)
