"""The monitor of a machine whose hydraulics are not identified: every sensor by itself."""

import numpy as np

from crane_model.array import Array
from crane_model.model_file import Model
from crane_observer.monitor.blocks import BLOCK, FlowBlock, Sample
from crane_observer.monitor.finding import SensorFinding
from crane_observer.monitor.reading_watch import ReadingWatch


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
        self.findings: list[SensorFinding] = []
        self._looked = -np.inf

    def take_block(self) -> FlowBlock | None:
        """None ever."""
        return None

    def command(self, stamp: float, command: Array) -> None:
        """Without hydraulics, a command says nothing."""

    def add(self, sample: Sample) -> list[SensorFinding]:
        """What was found by now; of each sensor, what was found first."""
        if sample.time < self._looked + BLOCK:
            return []
        self._looked = sample.time
        known = {one.sensor for one in self.findings}
        found = [one for one in self.readings.found(sample.time) if one.sensor not in known]
        self.findings += found
        return found

    def interrupted(self) -> list[SensorFinding]:
        """Nothing waits."""
        return []
