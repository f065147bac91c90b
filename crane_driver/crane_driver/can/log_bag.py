"""A bus log of a crane as the bag that the driver's topics would have made."""

import math
from collections import Counter
from collections.abc import Iterable, Mapping

import numpy as np

from crane_bags.clocks import LARGEST_JUMP
from crane_bags.types import CYLINDER_PRESSURES, JOINT_STATES, VALVE_COMMAND
from crane_bags.writer import BagWriter
from crane_driver.can.assembly import Assembly, Complete
from crane_driver.can.codec import DriverCodec
from crane_driver.can.decoder import Readings
from crane_driver.can.foreign import HeardCommands
from crane_driver.can.frame import Frame
from crane_driver.can.health import Monitor
from crane_driver.can.layout import Layout
from crane_driver.can.mapping import LINES
from crane_driver.faults import UNUSABLE, Fault
from crane_model.errors import DataError


class LogBag:
    """Writes /joint_states, /cylinder_pressures and /valve_command from frames, those that the
    mapping has.

    Velocity and effort are NaN: they are no measurements, and who reads the bag computes them.
    """

    def __init__(self, bag: BagWriter, layout: Layout):
        self._driver, self._heard = DriverCodec(layout), HeardCommands(layout)
        self._monitor: Monitor | None
        self._newest: int  # ns
        self._layout = layout
        self._begin()
        self._cylinders = list(
            dict.fromkeys(name.split(".")[0] for name in layout.pressures if name not in LINES)
        )
        self._joint_states = bag.add_arrays(JOINT_STATES, layout.positions)
        self._nothing = np.full(len(layout.positions), np.nan)
        self._cylinder_pressures = (
            bag.add_arrays(CYLINDER_PRESSURES, self._cylinders) if self._cylinders else None
        )
        self._valve_command = (
            bag.add_arrays(VALVE_COMMAND, layout.valves) if layout.valves else None
        )
        self._left_out = 0  # cycles, before time went back
        self.written: Counter[str] = Counter()  # messages by topic
        self.faults: Counter[tuple[str, str]] = Counter()  # by message and kind

    @property
    def incomplete(self) -> int:
        """Cycles of positions or pressures left out because one of their frames is not there."""
        return self._left_out + self._positions.incomplete + self._pressures.incomplete

    @property
    def unused(self) -> Mapping[tuple[int, bool], int]:
        """Frames that the mapping does not use, by identifier (and whether it is extended)."""
        unknown = self._heard.unknown
        return {key: count for key, count in self._driver.unknown.items() if key in unknown}

    def add(self, frame: Frame) -> None:
        """Write what this frame completes; if time goes back, cycles begin anew.

        `DataError` if two devices send one message.
        """
        if frame.stamp < self._newest - LARGEST_JUMP:
            self.finish()
            self._left_out = self.incomplete
            self._begin()
        self._newest = max(self._newest, frame.stamp)
        command, faults = self._heard.observe(frame)
        self._count(faults)
        if command and self._valve_command:
            spool = list(command.commands.values())
            self._valve_command.write(command.stamp, command.stamp, spool)
            self.written[VALVE_COMMAND.name] += 1
        if readings := self._driver.decode(frame):
            self._monitor = self._monitor or Monitor(
                self._layout.readings, self._layout.timing, frame.steady
            )
            faults = [*self._monitor.check(frame.steady), *self._monitor.observe(readings)]
            self._count(faults)
            if not any(fault.kind in UNUSABLE for fault in faults):
                self._readings(readings)
        for message, (first, second) in {**self._driver.conflicts, **self._heard.conflicts}.items():
            raise DataError(
                f"message {message}: {first} and {second} both send it, and the DBC names neither; "
                "write the id of the device that is meant into the DBC, or each as a message"
            )

    def _begin(self) -> None:
        self._newest = 0
        self._monitor = None
        self._positions = Assembly(self._layout, "positions")
        self._pressures = Assembly(self._layout, "pressures")

    def finish(self) -> None:
        """Write what still waits for other frames, of which no more come."""
        self._write(self._positions.finish(), self._pressures.finish())

    def _readings(self, readings: Readings) -> None:
        self._write(self._positions.add(readings), self._pressures.add(readings))

    def _write(self, positions: Iterable[Complete], pressures: Iterable[Complete]) -> None:
        for complete in positions:
            position = list(complete.values.values())
            self._joint_states.write(
                complete.stamp, complete.stamp, position, self._nothing, self._nothing
            )
            self.written[JOINT_STATES.name] += 1
        if self._cylinder_pressures is None:
            return
        for complete in pressures:
            self._cylinder_pressures.write(
                complete.stamp, complete.stamp, *self._pressure_fields(complete)
            )
            self.written[CYLINDER_PRESSURES.name] += 1

    def _pressure_fields(self, complete: Complete) -> list[list[float] | float]:
        value = complete.values
        return [
            [value.get(f"{one}.a", math.nan) for one in self._cylinders],
            [value.get(f"{one}.b", math.nan) for one in self._cylinders],
            value.get("supply", math.nan),
            value.get("tank", math.nan),
        ]

    def _count(self, faults: Iterable[Fault]) -> None:
        for fault in faults:
            self.faults[fault.source, str(fault.kind)] += 1
