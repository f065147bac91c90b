"""A controller that is led with what the scale weighs, from the readings that both are shown."""

import numpy as np

from crane_model.model_file import Model
from crane_observer.scale.scale import Scale
from crane_trajectory.control.choice import led_by_model
from crane_trajectory.control.interface import ControlCondition, Controller, SensorReading, Wanted
from crane_trajectory.control.tip_load import FedLoad, ToldLoad


class FedController:
    """Scale and controller as the nodes `scale` and `trajectory` have them, in one loop."""

    def __init__(self, controller: Controller, model: Model, heaviest: float):
        led = led_by_model(controller)
        assert led is not None
        self._controller, self._led = controller, led
        self._scale, self.load = Scale(model), FedLoad(heaviest)
        machine = self._scale.machine
        self._columns = np.array([machine.index(joint) for joint in model.joints])
        self._time = 0.0

    @property
    def preview(self) -> float:
        return self._controller.preview

    @property
    def by_model(self) -> np.ndarray:
        return self._controller.by_model

    @property
    def conditions(self) -> tuple[ControlCondition, ...]:
        return self._controller.conditions

    def start(self, command: np.ndarray) -> None:
        self._controller.start(command)

    def command(self, dt: float, reading: SensorReading, wanted: Wanted) -> np.ndarray:
        self._time += dt
        at = self._columns
        self._scale.add_encoders(self._time, reading.position[at])
        pressures = reading.pressure_a[at], reading.pressure_b[at]
        for one in self._scale.add_pressures(self._time, *pressures):
            load = one.load
            self.load.tell(ToldLoad(one.time, load.mass, load.deviation, one.condition.name))
        self._led.carry(self.load.at(self._time))
        return self._controller.command(dt, reading, wanted)
