"""Joint angles as inertial sensors on the links show them: biased, noisy, shaken and late."""

import numpy as np

from crane_model.machine import Machine
from crane_model.sensors import SensorChain

REMEMBERED_S = 1.0  # of the motion, more than any latency


class InertialSensors:
    """What `SensorChain.inertial` says of a machine's links; the same seed gives the same noise."""

    def __init__(self, chain: SensorChain, machine: Machine, seed: int):
        self._rng = np.random.default_rng([seed, 12])
        self._sensors = list(chain.inertial.values())
        self._columns = [machine.index(joint) for joint in chain.inertial]
        self._past: list[tuple[float, np.ndarray]] = []

    def shown(self, q: np.ndarray, time: float) -> np.ndarray:
        """(j,) angles shown at a time [s] of coordinates (j,); times rise. Others stay."""
        if not self._sensors:
            return q
        self._past.append((time, np.cumsum(q[self._columns])))
        while self._past[0][0] < time - REMEMBERED_S:
            self._past.pop(0)
        times, pitches = (np.array(part) for part in zip(*self._past, strict=True))
        pitch = np.array(
            [
                np.interp(time - sensor.latency, times, pitches[:, k])
                + sensor.bias
                + sensor.noise * self._rng.standard_normal()
                + sensor.vibration * np.sin(2.0 * np.pi * sensor.frequency * time + k)
                for k, sensor in enumerate(self._sensors)
            ]
        )
        shown = q.copy()
        shown[self._columns] = np.diff(pitch, prepend=0.0)
        return shown
