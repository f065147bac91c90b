"""What the machine's sensors show of the plant: encoders, pressure transducers, their noise."""

from typing import NamedTuple

import numpy as np

from crane_model.machine import JOINTS, Machine
from crane_model.sensors import SensorChain


class Pressures(NamedTuple):
    """Readings of n samples [Pa]; columns are the cylinders that have transducers."""

    chamber_a: np.ndarray  # (n, k)
    chamber_b: np.ndarray  # (n, k)
    supply: np.ndarray  # (n,)
    tank: np.ndarray  # (n,)


class Sensors:
    """The sensors of the stand-in machine; the same seed gives the same noise and jitter.

    The one place where true signals become readings: whatever else a sensor may do wrong (an
    offset, a gain, a delay) is added here.
    """

    def __init__(self, chain: SensorChain, machine: Machine, seed: int):
        self._chain = chain
        self._rng = np.random.default_rng(seed)
        self.cylinders = tuple(
            joint for joint in JOINTS if machine.cylinders[joint].pressure_sensors
        )
        self._fitted = [JOINTS.index(joint) for joint in self.cylinders]

    def instants(self, start: float, count: int) -> np.ndarray:
        """(count,) sampling instants [s], one period apart but for jitter."""
        return self._chain.sample_times(self._rng, start, count)

    def positions(self, q: np.ndarray) -> np.ndarray:
        """Encoder readings of the coordinates (..., 4) [rad, m]."""
        return self._chain.measure_positions(q)

    def pressures(
        self, chamber_a: np.ndarray, chamber_b: np.ndarray, supply: np.ndarray, tank: float
    ) -> Pressures:
        """Transducer readings of true pressures (n, 4), (n, 4), (n,) and the tank's [Pa]."""
        measure = self._chain.measure_pressure
        return Pressures(
            measure(self._rng, chamber_a[:, self._fitted]),
            measure(self._rng, chamber_b[:, self._fitted]),
            measure(self._rng, supply),
            measure(self._rng, np.full_like(supply, tank)),
        )
