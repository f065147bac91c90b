"""When the sign of a velocity is known: away from reversals and standstill."""

import numpy as np
from scipy.ndimage import binary_dilation

from crane_identification.signals.motion import SmoothedMotion

SIGMAS = 3.0
"""Speeds below this many standard deviations of the velocity estimate count as standstill."""
GUARD_CYCLES = 1.0
"""Cycles at the bandwidth of the motion over which the smoother spreads what happens at a reversal:
main lobe and first side lobe of its response."""
ROUNDING = 1e-6  # samples
SETTLING = 0.1
"""Time [s] that friction takes after a reversal until it follows (13): before, the joint presses on
bristles and seals that give way (presliding), which a model of (13) takes for inertia."""


def velocity_resolution(motion: SmoothedMotion) -> np.ndarray:
    """Speed (j,) below which the sign of the estimated velocity is not known."""
    return SIGMAS * motion.velocity_noise


def moving(
    motion: SmoothedMotion, step: float, periodic: bool, settling: float = SETTLING
) -> np.ndarray:
    """(n, j): True where joint j moves, and has done and will do so for a smoothing cycle and more.

    `settling` [s] is added to the cycle; without it, only the sign of the velocity is known.

    At standstill (13) is set-valued, and near a reversal the velocity estimate lags or leads the
    true one: rows from there are wrong by up to 2 f_c, which biases the friction parameters.
    """
    velocity = motion.velocity
    still = np.abs(velocity) <= velocity_resolution(motion)
    reversal = np.sign(velocity[1:]) * np.sign(velocity[:-1]) < 0
    still[1:] |= reversal
    still[:-1] |= reversal
    n = len(velocity)
    around = np.concatenate([still, still, still]) if periodic else still
    out = np.empty_like(around)
    for j, bandwidth in enumerate(motion.bandwidth):
        guard = int(np.ceil((GUARD_CYCLES / bandwidth + settling) / step - ROUNDING))
        out[:, j] = ~binary_dilation(around[:, j], iterations=guard)
    return out[n : 2 * n] if periodic else out
