"""What estimators of motion leave of a signal, so that others can be seen as they see theirs."""

import numpy as np

ORDER = 6
"""Of the response 1/(1 + (f/bandwidth)⁶): the Kalman smoother's, and that of the Fourier fit where
the acceleration jumps, as dry friction makes it."""


def smoothed_alike(
    values: np.ndarray, bandwidth: np.ndarray, step: float, periodic: bool
) -> np.ndarray:
    """`values` (n, j), sampled every `step` s, as a motion of that `bandwidth` (j,) [Hz] would be.

    An infinite bandwidth changes nothing. One whole period of values continues over its ends where
    it is `periodic`; otherwise they are mirrored there.
    """
    around = values if periodic else np.concatenate([values, values[::-1]])
    frequency = np.fft.rfftfreq(len(around), step)[:, np.newaxis]
    kept = np.fft.rfft(around, axis=0) / (1.0 + (frequency / bandwidth) ** ORDER)
    return np.fft.irfft(kept, len(around), axis=0)[: len(values)]
