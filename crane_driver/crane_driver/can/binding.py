"""From a mapping file and a DBC to a layout, with every contradiction named."""

import math
from collections import defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import fields
from pathlib import Path
from typing import TypeVar

from cantools.database.can import Message, Signal
from cantools.j1939 import pgn_from_frame_id

from crane_driver import constants
from crane_driver.can.codec import SignalBits
from crane_driver.can.dbc import (
    Dbc,
    codes_of,
    fills_byte,
    is_scaled,
    load_dbc,
    raw_limits,
    to_channel,
)
from crane_driver.can.frame import show_id
from crane_driver.can.layout import (
    MEASUREMENTS,
    UNPROTECTED,
    Channel,
    Codes,
    DeviceState,
    Echo,
    Layout,
    MessageLayout,
    Protected,
    ValveChannel,
    ValveDirection,
)
from crane_driver.can.mapping import (
    LINES,
    UNITS,
    Mapping,
    PositionSignal,
    PressureSignal,
    Protection,
    StateSignal,
    ValveSignal,
    identifiers,
    spellings,
    unit_of,
)
from crane_model.configuration import load
from crane_model.errors import ConfigurationError
from crane_model.machine import Machine

LARGEST_FRAME_BYTES = 8  # bytes, of classical CAN
QUANTITY = {"rad": "angle", "m": "length"}
COMMAND_QUANTITIES = ("ratio", "pressure", "current")
Entry = TypeVar("Entry")


def load_layout(
    machine: Machine, mapping: Path | str, dbc: Path | str, listen_only: bool = False
) -> Layout:
    """Read which signals of a machine's bus are its readings and its commands.

    Parameters
    ----------
    machine
        Machine whose joints and cylinders the mapping names.
    mapping, dbc
        Mapping file (YAML), and DBC file of the bus.
    listen_only
        Whether nothing will be sent: then the mapping needs no commands, and those that it has need
        not say what to send.

    Returns
    -------
    Layout
        Messages with the gain and offset of each signal in SI units.

    Raises
    ------
    ConfigurationError
        Lists everything that does not fit together: file, key, message, signal.
    """
    binder = _Binder(machine, Path(mapping), load(mapping, Mapping), load_dbc(dbc), listen_only)
    return binder.layout()


class _Binder:
    def __init__(self, machine: Machine, path: Path, mapping: Mapping, dbc: Dbc, listen_only: bool):
        self.machine, self.path, self.mapping, self.dbc = machine, path, mapping, dbc
        self.listen_only = listen_only
        self.problems: list[str] = []
        self.used: dict[str, str] = {}  # signal: key that uses it
        self.positions: dict[str, list[Channel]] = defaultdict(list)
        self.pressures: dict[str, list[Channel]] = defaultdict(list)
        self.commands: dict[str, list[ValveChannel]] = defaultdict(list)
        self.states: dict[str, list[DeviceState]] = defaultdict(list)
        self.echoes: dict[str, list[Echo]] = defaultdict(list)
        self.enable: dict[str, str] = {}
        self.constants: dict[str, dict[str, float]] = defaultdict(dict)
        self.protection: dict[str, Protected] = {}

    def layout(self) -> Layout:
        self._bind()
        received = dict.fromkeys((*self.positions, *self.pressures, *self.states, *self.echoes))
        sent = dict.fromkeys((*self.commands, *self.enable, *self.constants))
        for name in self.protection.keys() - received.keys() - sent.keys():
            self._problem(f"protection.{name}", f"nothing else is mapped from message {name}")
        for message, echoes in self.echoes.items():
            for name in (echo.command for echo in echoes if echo.command not in sent):
                self._problem(
                    f"protection.{name}.accepted", f"{message} accepts what is sent; {name} is not"
                )
        if not self.listen_only:
            self._check_sent(received, sent)
        self._require_free_identifiers((*received, *sent))
        readings = tuple(self._message(name) for name in received)
        commands = tuple(self._message(name) for name in sent)
        if self.problems:
            raise ConfigurationError("\n".join(self.problems))
        codes = self.mapping.codes == "j1939"
        return Layout(readings, commands, self.mapping.timing, self.mapping.canopen, codes)

    def _bind(self) -> None:
        mapping, joints = self.mapping, self.machine.joint_names
        chambers = [f"{joint}.{chamber}" for joint in self.machine.cylinders for chamber in "ab"]
        for name, position in self._known("positions", "joint", mapping.positions, joints):
            quantity = QUANTITY[self.machine.units[name]]
            self._bind_reading(f"positions.{name}", name, position, quantity)
        named = self._known("pressures", "pressure", mapping.pressures, (*chambers, *LINES))
        for name, pressure in named:
            self._bind_reading(f"pressures.{name}", name, pressure, "pressure")
        for name, valve in self._known("commands", "joint", mapping.commands, joints):
            self._bind_valve(f"commands.{name}", name, valve)
        for name, state in mapping.states.items():
            self._bind_state(f"states.{name}", name, state)
        enable = mapping.enable
        for signal in (enable,) if isinstance(enable, str) else enable:
            if found := self._use("enable", signal):
                if found[0].name in self.enable:
                    self._problem("enable", f"two signals of {found[0].name}; give one a message")
                self.enable[found[0].name] = found[1].name
        for name, value in mapping.constants.items():
            self._bind_constant(f"constants.{name}", name, value)
        for name, protection in mapping.protection.items():
            self._bind_protection(f"protection.{name}", name, protection)

    def _known(
        self, key: str, kind: str, entries: dict[str, Entry], names: Sequence[str]
    ) -> list[tuple[str, Entry]]:
        """The entries that the machine has a `kind` for; others are noted."""
        if unknown := [name for name in entries if name not in names]:
            self._problem(
                key, f"no {kind} {', '.join(unknown)}; {self.machine.name} has {', '.join(names)}"
            )
        return [(name, entry) for name, entry in entries.items() if name in names]

    def _bind_reading(
        self, key: str, name: str, entry: PositionSignal | PressureSignal, quantity: str
    ) -> None:
        found = self._use(key, entry.signal)
        fault = entry.fault and self._fault_signal(key, entry.fault, entry.signal)
        if not found or (unit := self._unit(key, found, entry.unit, quantity)) is None:
            return
        sign = entry.sign if isinstance(entry, PositionSignal) else 1
        group = self.positions if isinstance(entry, PositionSignal) else self.pressures
        message, signal = found
        codes = self._codes(message, signal)
        channel = to_channel(name, signal, sign * unit, -sign * entry.zero, fault, codes)
        group[message.name].append(channel)

    def _bind_valve(self, key: str, name: str, entry: ValveSignal) -> None:
        if entry.signal:
            side = 0 if entry.direction is None else 1
            self._bind_side(key, name, entry, entry.signal, side)
        if entry.positive and entry.negative:
            self._bind_side(key, name, entry, entry.positive, entry.sign)
            self._bind_side(key, name, entry, entry.negative, -entry.sign)

    def _bind_side(
        self, key: str, name: str, entry: ValveSignal, signal_name: str, side: int
    ) -> None:
        """Bind a signal of a valve command that carries the commands of one `side`; 0: of both."""
        found = self._use(key, signal_name)
        direction = self._direction(f"{key}.direction", entry) if entry.direction else None
        if not found or (unit := self._unit(key, found, entry.unit, *COMMAND_QUANTITIES)) is None:
            return
        named = unit_of(entry.unit)
        if entry.full is None and named and named.quantity != "ratio":
            self._problem(
                f"{key}.full",
                f"full is needed: the signal at full opening, in {entry.unit}; where each side of "
                "the valve has a signal, name them as positive and negative",
            )
            return
        message, signal = found
        gain = 1.0 / entry.full if entry.full else unit
        least, most = min(side, 0) if side else -1, max(side, 0) if side else 1
        channel = to_channel(
            name, signal, (side or entry.sign) * gain, 0.0, None, self._codes(message, signal)
        )
        if side == 0 and max(channel.low, -channel.high) > -abs(channel.gain):
            self._problem(
                f"{key}.signal",
                f"signal {signal_name} carries {channel.low:g} to {channel.high:g} as a ratio, one "
                "side of the valve only; give both sides as positive and negative, or direction",
            )
        elif not self.listen_only:
            self._check_side(key, signal_name, channel, least, most)
        common = {known.name: getattr(channel, known.name) for known in fields(channel)}
        valve = ValveChannel(**common, least=least, most=most, direction=direction)
        self.commands[message.name].append(valve)

    def _check_side(
        self, key: str, signal_name: str, channel: Channel, least: int, most: int
    ) -> None:
        if not (channel.low <= least and channel.high >= most):
            self._problem(
                key,
                f"signal {signal_name} carries {channel.low:g} to {channel.high:g} as a ratio, a "
                f"valve command needs {least} to {most}; correct its range or unit in the DBC, or "
                "full",
            )
        neutral = channel.gain * channel.raw(0.0) + channel.offset
        if (least == 0 or most == 0) and abs(neutral) > constants.NEUTRAL_OPENING_SHARE:
            self._problem(
                key,
                f"signal {signal_name} cannot carry 0, the nearest is {neutral:g} of the full "
                "opening: a neutral command would open the valve; correct its offset in the DBC",
            )

    def _direction(self, key: str, entry: ValveSignal) -> ValveDirection | None:
        direction = entry.direction
        assert direction is not None  # asked for nothing else
        if not (found := self._use(key, direction.signal)):
            return None
        given = {
            way: value
            for way in ("positive", "negative", "neutral")
            if (value := getattr(direction, way)) is not None
        }
        labels = {str(label): int(value) for value, label in (found[1].choices or {}).items()}
        numbers = {
            way: value if isinstance(value, int) else labels.get(value)
            for way, value in given.items()
        }
        if unknown := [str(given[way]) for way, number in numbers.items() if number is None]:
            self._problem(
                key,
                f"signal {direction.signal} has no value {', '.join(unknown)}; "
                f"it has {', '.join(labels) or 'no value table'}",
            )
            return None
        if len(set(numbers.values())) < len(numbers):
            self._problem(key, f"two directions have one value: {given}")
        positive, negative = numbers["positive"], numbers["negative"]
        assert positive is not None and negative is not None  # checked above
        if entry.sign < 0:
            positive, negative = negative, positive
        return ValveDirection(found[1].name, positive, negative, numbers.get("neutral"))

    def _bind_state(self, key: str, name: str, entry: StateSignal) -> None:
        if not (found := self._use(key, entry.signal)):
            return
        message, signal = found
        labels = {int(value): str(label) for value, label in (signal.choices or {}).items()}
        numbers = {label: value for value, label in labels.items()}
        if unknown := [
            label for label in entry.healthy if isinstance(label, str) and label not in numbers
        ]:
            self._problem(
                f"{key}.healthy",
                f"signal {entry.signal} has no value {', '.join(unknown)}; "
                f"it has {', '.join(numbers) or 'no value table'}",
            )
            return
        healthy = {label if isinstance(label, int) else numbers[label] for label in entry.healthy}
        self.states[message.name].append(DeviceState(name, signal.name, labels, frozenset(healthy)))

    def _bind_constant(self, key: str, name: str, raw: float) -> None:
        if not (found := self._use(key, name)):
            return
        message, signal = found
        low, high = raw_limits(signal)
        if not low <= raw <= high or (raw != int(raw) and not signal.is_float):
            self._problem(key, f"{raw:g} is not a raw value of {name}: {low:g} to {high:g}")
        self.constants[message.name][signal.name] = raw

    def _bind_protection(self, key: str, name: str, entry: Protection) -> None:
        if name not in self.dbc.messages:
            self._problem(key, f"no message {name} in {self.dbc.path}{self._messages()}")
            return
        counter = entry.counter and self._use(f"{key}.counter", f"{name}.{entry.counter}")
        crc = entry.crc and self._use(f"{key}.crc", f"{name}.{entry.crc}")
        if counter and (counter[1].is_signed or is_scaled(counter[1])):
            self._problem(
                f"{key}.counter", f"signal {name}.{entry.counter} is signed or scaled, no counter"
            )
        if crc and not fills_byte(crc[1]):
            self._problem(
                f"{key}.crc", f"signal {name}.{entry.crc} is not one whole byte of the frame"
            )
        first, last = raw_limits(counter[1]) if counter else (0, -1)
        if entry.accepted and (echo := self._use(f"{key}.accepted", entry.accepted)):
            low, high = raw_limits(echo[1])
            if is_scaled(echo[1]) or low > first or high < last:
                self._problem(
                    f"{key}.accepted",
                    f"signal {entry.accepted} carries {low:g} to {high:g}, the counter runs from "
                    f"{first:g} to {last:g}, not scaled",
                )
            self.echoes[echo[0].name].append(Echo(name, echo[1].name, int(high)))
        self.protection[name] = Protected(
            counter[1].name if counter else None,
            int(first),
            int(last - first) + 1,
            crc[1].name if crc else None,
            crc[1].start // 8 if crc else 0,
            entry.data_id,
        )

    def _codes(self, message: Message, signal: Signal) -> Codes:
        return codes_of(message, signal) if self.mapping.codes == "j1939" else MEASUREMENTS

    def _use(self, key: str, name: str) -> tuple[Message, Signal] | None:
        """Message and signal called `name`; None, and a problem noted, if absent or taken."""
        found = self._find(key, name)
        if name in self.used:
            self._problem(key, f"signal {name} is already mapped by '{self.used[name]}'")
            return None
        self.used[name] = key
        return found

    def _find(self, key: str, name: str) -> tuple[Message, Signal] | None:
        message_name, signal_name = name.split(".")
        message = self.dbc.messages.get(message_name)
        if message is None:
            self._problem(key, f"no message {message_name} in {self.dbc.path}{self._messages()}")
            return None
        for signal in message.signals:
            if signal.name == signal_name:
                return message, signal
        names = ", ".join(signal.name for signal in message.signals)
        self._problem(
            key, f"message {message_name} of {self.dbc.path} has no signal {signal_name}: {names}"
        )
        return None

    def _messages(self) -> str:
        names = list(self.dbc.messages)
        return f"; it has {', '.join(names)}" if len(names) <= 20 else ""

    def _fault_signal(self, key: str, fault: str, reading: str) -> str | None:
        """The fault signal of a reading; several readings may share it."""
        if fault.split(".")[0] != reading.split(".")[0]:
            self._problem(f"{key}.fault", f"{fault} and {reading} are not in the same message")
            return None
        found = self._find(f"{key}.fault", fault)
        return found and found[1].name

    def _unit(
        self, key: str, found: tuple[Message, Signal], unit: str, *quantities: str
    ) -> float | None:
        """Size of a signal's unit in SI units; None, and a problem noted, if it does not fit."""
        message, signal = found
        fitting = ", ".join(
            name for name, (kind, _) in UNITS.items() if kind in quantities and name
        )
        named = unit_of(unit)
        if named is None or named.quantity not in quantities:
            measured = " or ".join(quantities)
            self._problem(f"{key}.unit", f"'{unit}' is none of {measured}: {fitting}")
            return None
        stated = signal.unit
        if stated and unit_of(stated) != named:
            shown = "' or '".join(dict.fromkeys(spellings(stated)))
            known = "" if unit_of(stated) else f", which is none of {fitting}; correct the DBC"
            self._problem(
                f"{key}.unit", f"'{unit}', but {message.name}.{signal.name} is in '{shown}'{known}"
            )
            return None
        return named.size

    def _check_sent(self, received: dict[str, None], sent: dict[str, None]) -> None:
        """Check that all is known of the messages that are sent."""
        if not self.mapping.commands:
            self._problem(
                "commands", "no valve is mapped; map one, or only listen (driver: listen_only)"
            )
        for name in received.keys() & sent.keys():
            self._problem(
                "commands", f"message {name} cannot both be sent and hold what is received"
            )
        for name in sent:
            self._require_every_signal(name)

    def _require_every_signal(self, name: str) -> None:
        for signal in self.dbc.messages[name].signals:
            if f"{name}.{signal.name}" not in self.used:
                self._problem(
                    "constants", f"what shall be sent as {name}.{signal.name}? Give its raw value"
                )
        if self.dbc.messages[name].is_multiplexed():
            self._problem("commands", f"message {name} is multiplexed, it cannot be sent")
        elif SignalBits(self.dbc.messages[name]).overlap:
            self._problem("commands", f"signals of message {name} overlap, it cannot be sent")

    def _require_free_identifiers(self, names: Iterable[str]) -> None:
        """CANopen devices take their messages first; no signal may be mapped from them."""
        taken = identifiers(self.mapping.canopen)
        for name in names:
            message = self.dbc.messages[name]
            if not message.is_extended_frame and message.frame_id in taken:
                shown = show_id(message.frame_id, False)
                use = taken[message.frame_id]
                self._problem("canopen", f"message {name} has the id {shown}, that of the {use}")

    def _message(self, name: str) -> MessageLayout:
        message = self.dbc.messages[name]
        if not message.cycle_time:
            self._problem(
                "timing",
                f"message {name} of {self.dbc.path} has no cycle time: add GenMsgCycleTime",
            )
        if message.length > LARGEST_FRAME_BYTES:
            self._problem(
                "timing",
                f"message {name} has {message.length} bytes, a frame holds {LARGEST_FRAME_BYTES}",
            )
        return MessageLayout(
            message,
            (message.cycle_time or math.nan) / 1000,
            tuple(self.positions[name]),
            tuple(self.pressures[name]),
            tuple(self.commands[name]),
            tuple(self.states[name]),
            tuple(self.echoes[name]),
            self.enable.get(name),
            self.constants[name],
            self.protection.get(name, UNPROTECTED),
            pgn_from_frame_id(message.frame_id) if self.dbc.any_source(message) else None,
        )

    def _problem(self, key: str, text: str) -> None:
        self.problems.append(f"{self.path}: key '{key}': {text}")
