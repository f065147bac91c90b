"""A load that nobody has announced: with what the scale tells of it, and without, in one run."""

import numpy as np
import pytest
from benchmarks.controlled import drive
from benchmarks.controlled_machines import loaded
from benchmarks.controlled_rows import (
    BOOMS,
    FLOW,
    Measured,
    controller,
    motion,
    of_stock,
    row,
)

from crane_model import Model
from crane_observer.payload.estimator import PayloadEstimator
from crane_trajectory.control.choice import led_by_model
from crane_trajectory.control.controller import Controller, SensorReading, Wanted, WrappedController
from crane_trajectory.control.flow_feedforward import FedLoad, ToldLoad

LOAD, HEAVIEST = 100.0, 150.0  # kg
AS_MUCH = 1.1  # times the largest step of a command without it


class FedController(WrappedController):
    """Payload estimator and controller as their nodes have them, in one loop: both are
    shown the same readings.
    """

    def __init__(self, controller: Controller, model: Model, heaviest: float):
        led = led_by_model(controller)
        assert led is not None
        super().__init__(controller)
        self._led = led
        self._scale, self.load = PayloadEstimator(model), FedLoad(heaviest)
        machine = self._scale.machine
        self._columns = np.array([machine.index(joint) for joint in model.joints])
        self._time = 0.0

    def command(self, dt: float, reading: SensorReading, wanted: Wanted) -> np.ndarray:
        self._time += dt
        at = self._columns
        self._scale.add_encoders(self._time, reading.position[at])
        pressures = reading.pressure_a[at], reading.pressure_b[at]
        for one in self._scale.add_pressures(self._time, *pressures):
            load = one.load
            self.load.tell(ToldLoad(one.time, load.mass, load.deviation, one.condition.name))
        self._led.carry(self.load.at(self._time))
        return super().command(dt, reading, wanted)


def test_load_that_the_scale_tells(measured: Measured) -> None:
    crane, known = loaded(LOAD), of_stock()
    alone = drive(motion(), crane, controller(FLOW, crane, known))
    fed = FedController(controller(FLOW, crane, known), known.model, HEAVIEST)
    told = drive(motion(), crane, fed)
    found = {"not told": alone.score().rms[BOOMS], "told": told.score().rms[BOOMS]}
    what = f"{LOAD:.0f} kg more in the gripper, {FLOW} fed by the scale, RMS"
    row(measured, what, "booms: a third of it not told", found)
    assert not alone.worst.stops and not told.worst.stops
    assert fed.load.mass == pytest.approx(LOAD, rel=0.02)
    assert (found["told"] <= found["not told"] / 3.0)[:2].all()
    assert found["told"][2] <= found["not told"][2]
    before, after = (np.abs(np.diff(one.recording.command, axis=0)).max() for one in (alone, told))
    assert after <= AS_MUCH * before
