"""What a sensor may do wrong."""

from collections.abc import Sequence

import numpy as np

from crane_model.machine import JOINTS


class SensorFault:
    """A law between true signals and what noise-free sensors show of them.

    `values` are the parameters in the order of the form; `joint` is that of the faulty sensor.
    """

    def __init__(self, joint: str, values: Sequence[float]):
        self.column = JOINTS.index(joint)
        self.values = tuple(values)

    def positions(self, q: np.ndarray) -> np.ndarray:
        """Coordinates (..., 4) [rad, m] as the encoders see them."""
        return q

    def pressures(
        self, time: np.ndarray, chamber_a: np.ndarray, chamber_b: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Pressures of the chambers (n, 4) [Pa] as the transducers see them at `time` (n,) [s]."""
        return chamber_a, chamber_b
