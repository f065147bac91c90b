"""A plant led by a controller that is shown all of its sensors, and the reference ahead."""

import numpy as np

from crane_sim.plant.machine_in_motion import MachineInMotion
from crane_sim.plant.sampled import Pressures, Sensors
from crane_trajectory.control.interface import Controller, Point, SensorReading, Wanted
from crane_trajectory.motion.motion import Reference


class Led:
    """Answers what sensors show, cycle by cycle, from rest."""

    def __init__(
        self,
        controller: Controller,
        plant: MachineInMotion,
        sensors: Sensors,
        now: Reference,
        ahead: Reference,
    ):
        """`now` is the reference of each cycle, `ahead` the one `controller.preview` later."""
        joints = plant.machine.joint_names
        self._controller, self._plant, self._sensors = controller, plant, sensors
        self._now, self._ahead = now, ahead
        self._fitted = [joints.index(name) for name in sensors.cylinders]
        self._nothing = np.full(len(joints), np.nan)
        self._last: float | None = None
        self._read: list[Pressures] = []
        controller.start(np.zeros(len(joints)))

    def command(self, k: int, time: float, q: np.ndarray, velocity: np.ndarray) -> np.ndarray:
        """Commands (j,) that answer what encoders show (j,), (j,) in cycle k, at its time [s]."""
        plant, at = self._plant, np.array([time])
        chambers = plant.pressure_a[np.newaxis], plant.pressure_b[np.newaxis]
        read = self._sensors.pressures(
            *chambers, np.array([plant.supply_pressure]), plant.tank_pressure, at
        )
        self._read.append(read)
        p_a, p_b = self._nothing.copy(), self._nothing.copy()
        p_a[self._fitted], p_b[self._fitted] = read.chamber_a[0], read.chamber_b[0]
        now, ahead = (Point(*(part[k] for part in one[:3])) for one in (self._now, self._ahead))
        dt = 0.0 if self._last is None else time - self._last
        self._last = time
        reading = SensorReading(q, velocity, p_a, p_b, float(read.supply[0]))
        return self._controller.command(dt, reading, Wanted(now, ahead))

    @property
    def pressures(self) -> Pressures:
        """What transducers showed in all cycles."""
        return Pressures(*(np.concatenate(parts) for parts in zip(*self._read, strict=True)))
