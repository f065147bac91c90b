"""What the machine's sensors show of the plant: encoders, pressure transducers, their noise."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from crane_model.machine import Machine
from crane_model.sensors import SensorChain
from crane_sim.effects.fault import SensorFault, measured_joints


class Pressures(NamedTuple):
    """Readings of n samples [Pa]; columns are the cylinders that have transducers."""

    chamber_a: np.ndarray  # (n, k)
    chamber_b: np.ndarray  # (n, k)
    supply: np.ndarray  # (n,)
    tank: np.ndarray  # (n,)


class Sensors:
    """The sensors of the stand-in machine; the same seed gives the same noise and jitter.

    The one place where true signals become readings: `faults` are what else the sensors do wrong,
    one after the other, before noise and converters.
    """

    def __init__(
        self, chain: SensorChain, machine: Machine, seed: int, faults: Sequence[SensorFault] = ()
    ):
        self._chain = chain
        self.faults = tuple(faults)
        self._rng = np.random.default_rng(seed)
        self._joints = machine.joint_names
        self.cylinders = measured_joints(machine)
        self._fitted = [machine.index(joint) for joint in self.cylinders]

    def instants(self, start: float, count: int) -> np.ndarray:
        """(count,) sampling instants [s], one period apart but for jitter."""
        return self._chain.sample_times(self._rng, start, count)

    def positions(self, q: np.ndarray) -> np.ndarray:
        """Encoder readings of the coordinates (..., j) [rad, m]."""
        for fault in self.faults:
            q = fault.positions(q)
        return self._chain.measure_positions(self._joints, q)

    def pressures(
        self,
        chamber_a: np.ndarray,
        chamber_b: np.ndarray,
        supply: np.ndarray,
        tank: float,
        time: np.ndarray | None = None,
    ) -> Pressures:
        """Transducer readings of true pressures (n, j), (n, j), (n,) and the tank's [Pa].

        `time` (n,) [s] is when they are read, by default all at once.
        """
        if time is None:
            time = np.zeros(len(supply))
        for fault in self.faults:
            chamber_a, chamber_b = fault.pressures(time, chamber_a, chamber_b)
        measure = self._chain.measure_pressure
        return Pressures(
            measure(self._rng, chamber_a[:, self._fitted]),
            measure(self._rng, chamber_b[:, self._fitted]),
            measure(self._rng, supply),
            measure(self._rng, np.full_like(supply, tank)),
        )
