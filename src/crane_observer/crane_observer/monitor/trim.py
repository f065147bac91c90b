"""What the model is off by on a machine, always and alike: learnt, and taken off the residuals.

A transducer whose zero is off makes a flow that follows the slope of the valve's edge at the
pressures of the moment, so it shows most where an edge has next to no pressure left; what the
identification made of it is an error of the gains, up and down. A dead zone that is off makes the
slowest motions err most, and oil that is softer each change of pressure. A valve that follows its
command later or sooner than the model says errs with each change of its opening; of a joint that
hunts, all that adds up. A leak that is not that of the model creeps while the joint stands. In a
block

    r = zero S + up X + down X' + wider N - wider' N' + softer C + late W + leak Y

with S what a transducer adds that is 1 Pa off, X and X' the way of the piston that extends and
retracts, N and N' what an opening wider by the whole stroke adds on it, C oil that is twice as
soft, W a spool that moves 1 s later, and Y a leak of 1 m3/(s Pa) past the piston. What changes
with the time of day stays in the residuals, and in their tolerance.
"""

from collections.abc import Sequence

import numpy as np
from scipy.optimize import least_squares

from crane_model.array import Array

SPAN = 20  # blocks, over which what encoders round hardly counts
EXPECTED = np.array([1e5, 0.02, 0.02, 2e-4, 2e-4, 0.05, 5e-3, 1e-13])
"""Standard deviations of zero [Pa], up, down, dead zones [of the stroke], softer, late [s] and leak
[m3/(s Pa)]."""
OUTLYING = 3.0  # times the usual residual, beyond which a span counts less
ROUNDS = 3  # of the fit, each beside what the last one left
TERMS = len(EXPECTED)


def regressors(
    pressed: Array, course: Array, null: Array, squeezed: Array, late: Array, leak: Array
) -> Array:
    """(n, c, TERMS) of blocks whose transducers add `pressed` (n, c) m/Pa, openings `null` m,
    oil `squeezed` m, spools `late` m/s and leaks `leak` m s-1 Pa m-3 while the piston goes
    `course` (n, c) m.
    """
    extending, retracting = np.maximum(course, 0.0), np.minimum(course, 0.0)
    opens, closes = null * (course > 0.0), -null * (course < 0.0)
    return np.stack([pressed, extending, retracting, opens, closes, squeezed, late, leak], axis=-1)


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
    columns, residual = columns[moving] * EXPECTED, residual[moving]
    share = np.zeros(TERMS)
    for _ in range(ROUNDS):
        usual = float(np.median(np.abs(residual - columns @ share))) if len(residual) else 0.0
        if usual == 0.0:
            break
        weighted, target = columns / usual, residual / usual

        def left(x: Array, columns: Array = weighted, target: Array = target) -> Array:
            return np.concatenate([columns @ x - target, x])

        share = least_squares(left, share, loss="huber", f_scale=OUTLYING).x
    return np.asarray(share * EXPECTED)
