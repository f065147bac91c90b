"""The simulated machine behind a CAN bus: valve unit, operator, and frames of a cycle."""

from collections.abc import Iterable, Sequence
from typing import TextIO

import numpy as np

from crane_driver.can.codec import MachineCodec
from crane_driver.can.frame import Frame
from crane_driver.can.health import Monitor
from crane_driver.can.layout import Layout
from crane_driver.can.mapping import LINES
from crane_driver.faults import UNUSABLE
from crane_model.errors import ConfigurationError, RangeError
from crane_sim.plant.sampled import MachineInMotion, Sensors
from crane_sim.sensor_faults import Faults

# The electronics of the valves: what they do with the frames that command them.

COMMAND_TIMEOUT_S = 0.1  # without a valid command, as the DBC file says of the valve unit
NEUTRAL, ENABLED, COMMAND_TIMEOUT = "Neutral", "Enabled", "CommandTimeout"


class ValveUnit:
    """Takes frames and gives valve commands; neutral until told otherwise.

    A frame of the wrong size, with a wrong checksum or a repeated counter is not accepted. Enabled
    valves that get no valid command for `COMMAND_TIMEOUT_S` go to neutral, and stay there until a
    command that does not enable them.
    """

    def __init__(self, codec: MachineCodec, joints: Sequence[str], now: float):
        self._codec = codec
        self._monitor = Monitor(codec.layout.commands, codec.layout.timing, now)
        self._commands = dict.fromkeys(joints, 0.0)
        self._last = now
        self.state = NEUTRAL
        self.refused = 0  # frames
        self.accepted: dict[str, int] = {}  # message: counter of its last accepted frame

    def receive(self, frame: Frame) -> None:
        """Take one frame of the bus; those that command no valve are passed over."""
        readings = self._codec.decode(frame)
        if readings is None:
            return
        faults = self._monitor.observe(readings)
        if any(fault.kind in UNUSABLE for fault in faults) or not readings.commands:
            self.refused += 1
            return
        self._expire(readings.steady)
        self._last = readings.steady
        self._commands.update(readings.commands)
        if readings.counter is not None:
            self.accepted[readings.message] = readings.counter
        # Without an enable signal, the valves of a machine follow every command.
        if readings.enabled is False:
            self.state = NEUTRAL
        elif self.state is not COMMAND_TIMEOUT or readings.enabled is None:
            self.state = ENABLED

    def commands(self, now: float) -> list[float]:
        """(j,) valve commands -1 to 1 at `now` [s, steady], in the order of the joints."""
        self._expire(now)
        if self.state is not ENABLED:
            return [0.0] * len(self._commands)
        return list(self._commands.values())

    def _expire(self, now: float) -> None:
        if self.state is ENABLED and now - self._last > COMMAND_TIMEOUT_S:
            self.state = COMMAND_TIMEOUT


# Actions of an operator at the machine itself: its levers, its engine, and plugs that he pulls.


class Operator:
    """Moves levers as lines of text say: `inner_boom=0.2`, `inner_boom=0`, `engine=off`.

    A lever moves the spool itself, positive in the positive direction of the joint, whatever the
    valve is commanded. While the engine is off the crane lies on its supports, and its chambers
    are vented: nothing moves, and all pressures are those of the air. `fault=TARGET.PART.KIND`
    makes a sensor or a valve fail from now on, `repaired=TARGET.PART` or `repaired=all` repairs it.
    """

    def __init__(self, joints: Sequence[str], faults: Faults | None = None):
        self.levers = dict.fromkeys(joints, 0.0)
        self.engine = True
        self._faults = faults

    def obey(self, line: str) -> None:
        """Do what one line says; `RangeError` or `ConfigurationError` says what can be said."""
        name, _, value = (part.strip() for part in line.partition("="))
        if self._faults is not None and name == "fault":
            print(f"fault: {self._faults.add(value)}", flush=True)
            return
        if self._faults is not None and name == "repaired":
            self._faults.mend(value)
            print(f"repaired: {value}", flush=True)
            return
        if name == "engine" and value in ("on", "off"):
            self.engine = value == "on"
            return
        try:
            opening = float(value)
        except ValueError:
            opening = 2.0
        if name not in self.levers or not -1.0 <= opening <= 1.0:
            raise RangeError(
                f"'{line.strip()}': write engine=on, engine=off, fault=TARGET.PART.KIND, "
                "repaired=TARGET.PART, or JOINT=OPENING with a joint of "
                f"{', '.join(self.levers)} and an opening from -1 to 1"
            )
        self.levers[name] = opening

    def follow(self, lines: TextIO, complaints: TextIO) -> None:
        """Obey every line until there are no more; a wrong one changes nothing."""
        for line in lines:
            try:
                self.obey(line)
            except (ConfigurationError, RangeError) as error:
                print(error, file=complaints, flush=True)

    def spools(self, commands: Sequence[float]) -> Iterable[float]:
        """(j,) where the spools are held: by the lever where it is moved, else by the command."""
        levers = self.levers.values()
        return [lever or command for lever, command in zip(levers, commands, strict=True)]


# The simulated crane seen from its CAN bus: frames in, frames out, by the steady clock.

MAX_STEP_S = 0.1  # a machine that was kept from running for longer loses the rest


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
        # Reports of devices; all but the valve unit report that they are well.
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
        if elapsed > MAX_STEP_S:
            self.lost += elapsed - MAX_STEP_S
            elapsed = MAX_STEP_S
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
