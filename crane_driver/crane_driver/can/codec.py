"""The two ends of the bus: the driver, and the machine that a simulation stands in for."""

from collections.abc import Collection, Mapping

from crane_driver.can.decoder import Decoder, Readings
from crane_driver.can.encoder import Encoder, raw_values
from crane_driver.can.frame import Frame
from crane_driver.can.layout import Layout
from crane_model.errors import RangeError


class DriverCodec:
    """Readings in, valve commands out."""

    def __init__(self, layout: Layout):
        self.layout = layout
        self._decoder = Decoder(layout.readings)
        self._encoder = Encoder(layout.commands)
        self._valves = frozenset(layout.valves)
        self._neutral = dict.fromkeys(layout.valves, 0.0)
        self._constants = {one.name: _whole(one.constants) for one in layout.commands}

    @property
    def unknown(self) -> dict[tuple[int, bool], int]:
        """Frames so far per identifier (and whether it is extended) that is not of the layout."""
        return self._decoder.unknown

    @property
    def conflicts(self) -> dict[str, tuple[str, str]]:
        """Ids of two devices that both send a message, by message (see `Decoder`)."""
        return self._decoder.conflicts

    def decode(self, frame: Frame) -> Readings | None:
        """Readings of a frame; None, and counted, where the identifier is unknown."""
        return self._decoder.decode(frame)

    def command_frames(self, commands: Mapping[str, float], enabled: bool) -> list[Frame]:
        """Frames for spool commands -1 to 1 by joint; a joint that is not named is neutral.

        `RangeError` if a joint has no valve or a command is not a number from -1 to 1; then no
        counter moves on.
        """
        if unknown := commands.keys() - self._valves:
            raise RangeError(
                f"valve command for {', '.join(sorted(unknown))}, but there are valves for "
                f"{', '.join(self.layout.valves)}; the whole command is refused"
            )
        for joint, command in commands.items():
            if not -1.0 <= command <= 1.0:  # refuses what is not a number, too
                raise RangeError(
                    f"valve command for {joint} is {command}, limits -1 and 1; the whole command "
                    "is refused"
                )
        values = {**self._neutral, **commands}
        frames = []
        for layout in self.layout.commands:
            raw = dict(self._constants[layout.name])
            for channel in layout.commands:
                raw |= channel.counts(values[channel.name])
            if layout.enable:
                raw[layout.enable] = int(enabled)
            frames.append(self._encoder.encode(layout, raw))
        return frames

    def neutral_frames(self) -> list[Frame]:
        """Frames with every spool neutral and the valves not enabled."""
        return self.command_frames({}, enabled=False)


class MachineCodec:
    """Valve commands in, readings out: the other end of the same bus."""

    def __init__(self, layout: Layout):
        self.layout = layout
        self._decoder = Decoder(layout.commands)
        self._encoder = Encoder(layout.readings)
        self._layouts = {one.name: one for one in layout.readings}
        self._states = {one.name: one for message in layout.readings for one in message.states}

    def decode(self, frame: Frame) -> Readings | None:
        """Commands of a frame; None where it is no command."""
        return self._decoder.decode(frame)

    @property
    def cycles(self) -> dict[str, float]:
        """Cycle time of each message to be sent [s]."""
        return {name: layout.cycle for name, layout in self._layouts.items()}

    def reading_frame(
        self,
        message: str,
        positions: Mapping[str, float],
        pressures: Mapping[str, float],
        states: Mapping[str, str],
        faulty: Collection[str] = (),
        accepted: Mapping[str, int] = {},
    ) -> Frame:
        """Frame of one message; it picks what it carries out of positions [rad, m], pressures [Pa],
        states and the counters of the last `accepted` frame by command message. Readings that are
        `faulty` are marked so; signals that nobody maps are 0.

        `RangeError` where the frame cannot carry a value.
        """
        layout = self._layouts[message]
        raw: dict[str, float] = {signal.name: 0 for signal in layout.message.signals}
        raw |= raw_values("position", layout.positions, positions)
        raw |= raw_values("pressure", layout.pressures, pressures)
        for channel in (*layout.positions, *layout.pressures):
            if channel.fault and channel.name in faulty:
                raw[channel.fault] = 1
        for state in layout.states:
            raw[state.signal] = state.number(states[state.name])
        for echo in layout.echoes:
            raw[echo.signal] = accepted.get(echo.command, echo.nothing)
        return self._encoder.encode(layout, raw)


def _whole(raw: Mapping[str, float]) -> dict[str, float]:
    """Raw values as a mapping file gives them, whole numbers as `int`."""
    return {name: int(value) if value.is_integer() else value for name, value in raw.items()}
