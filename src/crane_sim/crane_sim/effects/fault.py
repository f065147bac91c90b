"""What a sensor may do wrong."""

from collections.abc import Sequence

import numpy as np

from crane_model.machine import Machine


def measured_joints(machine: Machine) -> tuple[str, ...]:
    """The joints whose chamber pressures are measured, from the base to the tip."""
    return tuple(joint for joint, one in machine.cylinders.items() if one.pressure_sensors)


class SensorFault:
    """A law between true signals and what noise-free sensors show of them.

    `values` are the parameters in the order of the form; `joint` is that of the faulty sensor.
    """

    def __init__(self, machine: Machine, joint: str, values: Sequence[float]):
        self.column = machine.index(joint)
        self.measured = [machine.index(one) for one in measured_joints(machine)]
        self.values = tuple(values)

    def positions(self, q: np.ndarray) -> np.ndarray:
        """Coordinates (..., j) [rad, m] as the encoders see them."""
        return q

    def pressures(
        self, time: np.ndarray, chamber_a: np.ndarray, chamber_b: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Pressures of the chambers (n, j) [Pa] as the transducers see them at `time` (n,) [s]."""
        return chamber_a, chamber_b
