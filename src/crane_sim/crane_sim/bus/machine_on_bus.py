"""The stand-in machine seen from its CAN bus: frames in, frames out, by the steady clock."""

from collections.abc import Iterable

import numpy as np

from crane_driver.can.codec import MachineCodec
from crane_driver.can.frame import Frame
from crane_driver.can.layout import Layout
from crane_driver.can.mapping import LINES
from crane_model.errors import ConfigurationError
from crane_sim.bus.operator_at_machine import Operator
from crane_sim.bus.valve_unit import ValveUnit
from crane_sim.plant.machine_in_motion import MachineInMotion
from crane_sim.plant.sampled import Sensors

LONGEST_STEP = 0.1  # s; a machine that was kept from running for longer loses the rest


class MachineOnBus:
    """Plant, sensors and valve unit. Its time is the steady clock, from `start` [s] on.

    Readings are taken at even times, as devices with a clock of their own do, however late the
    process is woken to send them.
    """

    def __init__(
        self,
        layout: Layout,
        plant: MachineInMotion,
        sensors: Sensors,
        start: float,
        operator: Operator | None = None,
    ):
        """`ConfigurationError` if the layout has pressures that the machine does not measure."""
        self._codec = MachineCodec(layout)
        self._plant, self._sensors = plant, sensors
        self._joints = plant.machine.joint_names
        self._operator = operator or Operator(self._joints)  # one who touches nothing
        self.valves = ValveUnit(self._codec, self._joints, start)
        self.period = min(self._codec.cycles.values())
        self._every = {
            name: round(cycle / self.period) for name, cycle in self._codec.cycles.items()
        }
        chambers = [f"{joint}.{chamber}" for chamber in "ab" for joint in sensors.cylinders]
        self._measured = (*chambers, *LINES)
        if absent := [name for name in layout.pressures if name not in self._measured]:
            raise ConfigurationError(
                f"the mapping has the pressures {', '.join(absent)}, but the simulated crane "
                f"measures {', '.join(sorted(self._measured))}; take them out of the mapping"
            )
        # What devices say of themselves; all but the valve unit that they are well.
        self._states = {
            state.name: state.label(min(state.healthy))
            for message in layout.readings
            for state in message.states
        }
        self._start = self._time = start
        self._cycle = 0
        self.lost = 0.0  # s that the plant did not run
        self._read = self._measure()

    def exchange(self, frames: Iterable[Frame]) -> list[Frame]:
        """Take the commands of `frames`, and give the frames of the last readings."""
        for frame in frames:
            self.valves.receive(frame)
        positions, pressures = self._read
        self._states["valve_unit"] = self.valves.state
        due = [name for name, every in self._every.items() if self._cycle % every == 0]
        self._cycle += 1
        accepted = self.valves.accepted
        return [
            self._codec.reading_frame(name, positions, pressures, self._states, accepted=accepted)
            for name in due
        ]

    def run(self, until: float) -> None:
        """Let the plant run with the commands that are there, and take the next readings."""
        elapsed = until - self._time
        timed, began = self._sensors.timed, self._time - self._start
        asked = timed.commands(began, np.array(self.valves.commands(self._time)))
        commands = np.array(self._operator.spools(asked.tolist()))
        self._plant.leak(timed.passed(began))
        self._time = until
        if elapsed > LONGEST_STEP:
            self.lost += elapsed - LONGEST_STEP
            elapsed = LONGEST_STEP
        if elapsed > 0 and self._operator.engine:
            self._plant.advance(commands, elapsed)
        self._read = self._measure()

    def _measure(self) -> tuple[dict[str, float], dict[str, float]]:
        plant = self._plant
        time = self._time - self._start
        q = self._sensors.positions(plant.q, time)
        pressure_a, pressure_b = plant.pressure_a[np.newaxis], plant.pressure_b[np.newaxis]
        supply, tank = plant.supply_pressure, plant.tank_pressure
        if not self._operator.engine:
            pressure_a, pressure_b = np.zeros_like(pressure_a), np.zeros_like(pressure_b)
            supply = tank = 0.0
        read = self._sensors.pressures(
            pressure_a, pressure_b, np.array([supply]), tank, np.array([time])
        )
        pressures = np.concatenate(read, axis=None).tolist()
        return (
            dict(zip(self._joints, q.tolist(), strict=True)),
            dict(zip(self._measured, pressures, strict=True)),
        )
