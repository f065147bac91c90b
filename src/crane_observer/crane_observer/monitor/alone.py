"""The monitor of a machine whose hydraulics are not identified: every sensor by itself."""

import numpy as np

from crane_model.array import Array
from crane_model.model_file import Model
from crane_observer.monitor.blocks import BLOCK, FlowBlock, Sample
from crane_observer.monitor.finding import RivalEncoder, SensorFinding
from crane_observer.monitor.reading_watch import ReadingWatch
from crane_observer.monitor.signatures import Part, Wrong
from crane_observer.monitor.standing import StandingWatch


class SensorsAlone:
    """Takes what `SensorComparison` takes, and finds what readings alone tell."""

    def __init__(self, model: Model):
        self._model = model
        self.taken: Array = np.zeros(0)  # nothing is compared
        self.forget()

    def forget(self) -> None:
        """Begin anew: sensors were mended."""
        units = self._model.setting.units
        joints = self._model.joints
        self.readings = ReadingWatch(joints, [units[joint] for joint in joints])
        self._standing, self._command = StandingWatch(len(joints)), np.zeros(len(joints))
        self.findings: list[SensorFinding] = []
        self._looked = -np.inf

    def take_block(self) -> FlowBlock | None:
        """None ever."""
        return None

    def command(self, stamp: float, command: Array) -> None:
        """Valve commands (j,) in -1..1; how late they reach the valves is not known."""
        self._command = command

    def add(self, sample: Sample) -> list[SensorFinding]:
        """What was found by now; of each sensor, what was found first."""
        self._standing.add(sample, self._command)
        if sample.time < self._looked + BLOCK:
            return []
        self._looked = sample.time
        known = {one.sensor for one in self.findings}
        found = [*self.readings.found(sample.time), *self._stuck(sample.time)]
        found = [one for one in found if one.sensor not in known]
        self.findings += found
        return found

    def _stuck(self, time: float) -> list[SensorFinding]:
        """Valves that do not open, or encoders that do not show it."""
        return [
            SensorFinding(
                Part.VALVE, self._model.joints[j], Wrong.STUCK, "", 1.0, 1.0, 1.0,
                float(self._standing.since[j]), time,
                RivalEncoder(self._model.joints[j], Wrong.STUCK),
            )
            for j in np.flatnonzero(self._standing.standing).tolist()
        ]  # fmt: skip

    def interrupted(self) -> list[SensorFinding]:
        """Nothing waits."""
        return []
