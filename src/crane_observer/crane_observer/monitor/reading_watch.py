"""What readings alone tell, whatever is known of the machine: jumps, noise, values that stay."""

from collections.abc import Sequence

import numpy as np

from crane_model.array import Array, Flags
from crane_observer.monitor.blocks import SHOWN
from crane_observer.monitor.finding import SensorFinding
from crane_observer.monitor.jumps import JumpWatch
from crane_observer.monitor.readings import LOOKED, ReadingHabits
from crane_observer.monitor.signatures import COVERED, SUPPLY, Part, Wrong
from crane_observer.position.flow import FULL


class ReadingWatch:
    """Of encoders, chambers A and chambers B of j joints, and of the supply, in this order."""

    def __init__(self, joints: Sequence[str], units: Sequence[str]):
        """`units` (j,) of the encoders: rad or m."""
        parts = (Part.ENCODER, Part.PRESSURE_A, Part.PRESSURE_B)
        self.sensors = [(part, joint) for part in parts for joint in joints]
        self.sensors.append((Part.SUPPLY, SUPPLY))
        self._units, count = tuple(units), len(joints)
        full = FULL * SHOWN
        self._habits = (
            ReadingHabits(count), ReadingHabits(2 * count, full), ReadingHabits(1, full)
        )  # fmt: skip
        self._jumps = JumpWatch(count)
        self._period, self._last = 0.0, 0.0

    def read_encoders(self, time: float, position: Array) -> None:
        """(j,) as they were read [s]: between two readings there is no noise to be seen."""
        self._habits[0].add(position)
        self._jumps.add(time, position)

    def read_pressures(
        self, time: float, chamber_a: Array, chamber_b: Array, supply: float
    ) -> None:
        """(j,) (j,) Pa, and the supply, as they were read [s]."""
        self._habits[1].add(np.concatenate([chamber_a, chamber_b]))
        self._habits[2].add(np.array([supply]))
        self._period, self._last = time - self._last, time

    @property
    def noisy_now(self) -> Flags:
        """(s,) see `ReadingHabits`."""
        return np.concatenate([one.noisy_now for one in self._habits])

    @property
    def repeated(self) -> Array:
        """(s,) how many times the last reading was repeated."""
        return np.concatenate([one.repeated for one in self._habits])

    def found(self, time: float) -> list[SensorFinding]:
        """What is wrong by now [s]."""
        stuck, noisy = (
            np.concatenate([one.stuck for one in self._habits]),
            np.concatenate([one.noisy for one in self._habits]),
        )
        found = self._jumped(time)
        for k, (part, _) in enumerate(self.sensors):
            frozen = bool(stuck[k]) and part is not Part.ENCODER  # at rest an encoder is quiet
            if frozen or noisy[k]:
                found.append(self.noise(k, time, frozen))
        return found

    def noise(self, sensor: int, time: float, frozen: bool = False) -> SensorFinding:
        """That it is noisy, or `frozen`."""
        part, joint = self.sensors[sensor]
        size = float(np.concatenate([one.noise for one in self._habits])[sensor])
        unit = self._units[sensor] if part is Part.ENCODER else "Pa"
        kind, unit = (Wrong.STUCK, "") if frozen else (Wrong.NOISE, unit)
        begun = time - LOOKED * self._period
        return SensorFinding(part, joint, kind, unit, size, 0.7 * size, 1.3 * size, begun, time)

    def _jumped(self, time: float) -> list[SensorFinding]:
        found, jumps = [], self._jumps
        for j in np.flatnonzero(jumps.size).tolist():
            part, joint = self.sensors[j]
            size, spread = float(jumps.size[j]), COVERED * float(jumps.deviation[j])
            found.append(
                SensorFinding(
                    part, joint, Wrong.JUMP, self._units[j], size, size - spread, size + spread,
                    float(jumps.at[j]), time,
                )
            )  # fmt: skip
        jumps.forget()
        return found
