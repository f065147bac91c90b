"""Valve frames on the bus that this driver did not send."""

import math
from collections import deque
from collections.abc import Mapping
from typing import NamedTuple

from crane_driver.can.decoder import Decoder
from crane_driver.can.frame import Frame
from crane_driver.can.layout import Layout, MessageLayout
from crane_driver.faults import UNUSABLE, Fault, FaultKind

REMEMBERED = 64  # own frames: a third of a second of them

ANOTHER = "another node commands the valves ({said})"
OWN = (
    "a valve frame of this driver came back ({said}): a gateway or a recording repeats it, or the "
    "interface returns what it sends (receive_own_messages); only one may command the valves"
)


class ForeignCommands:
    """Watches the identifiers of the valve commands. The link leaves out its own echoes, so that
    whatever still comes under one of them was sent by somebody else, or sent again.
    """

    def __init__(self, layout: Layout):
        self._decoder = Decoder(layout.commands)
        self._own: deque[Frame] = deque(maxlen=REMEMBERED)

    def sent(self, frame: Frame) -> None:
        """A valve frame was sent by this driver."""
        self._own.append(frame)

    def observe(self, frame: Frame) -> Fault | None:
        """The fault that a received frame is; None if it is no valve command."""
        layout = self._decoder.layout_of(frame)
        if layout is None:
            return None
        again = any((one.id, one.data) == (frame.id, frame.data) for one in self._own)
        said = (OWN if again else ANOTHER).format(said=self._said(frame))
        return layout.fault(FaultKind.FOREIGN, said)

    def _said(self, frame: Frame) -> str:
        readings = self._decoder.decode(frame)
        if readings is None or not readings.commands:
            return f"data {frame.data.hex(' ')}"
        spools = ", ".join(f"{joint} {value:.3g}" for joint, value in readings.commands.items())
        if readings.enabled is None:
            return spools
        return f"{spools}; {'enabled' if readings.enabled else 'not enabled'}"


class HeardCommand(NamedTuple):
    """What all valves are commanded, as far as it is known, once a frame has come."""

    stamp: int  # ns, of reception
    commands: dict[str, float]  # joint: -1 to 1; NaN where it is not known


class HeardCommands:
    """What others command the valves, put together from their frames.

    A valve keeps to its last command; after a silence of its message (`timing.missing`) its command
    is not known. Valves that are not enabled are neutral, whatever the frame says.
    """

    def __init__(self, layout: Layout):
        self._decoder = Decoder(layout.commands)
        self._layouts = {one.name: one for one in layout.commands}
        self._missing = layout.timing.missing  # cycles
        self._heard: dict[str, float] = {}  # s, steady, by message
        self._commands = dict.fromkeys(layout.valves, math.nan)

    @property
    def unknown(self) -> Mapping[tuple[int, bool], int]:
        """Frames that are no valve command, by identifier (and whether it is extended)."""
        return self._decoder.unknown

    @property
    def conflicts(self) -> Mapping[str, tuple[str, str]]:
        """Valve commands that two devices send, and their identifiers."""
        return self._decoder.conflicts

    def observe(self, frame: Frame) -> tuple[HeardCommand | None, list[Fault]]:
        """The commands after a frame, None if it says nothing of them; and its faults."""
        readings = self._decoder.decode(frame)
        if readings is None:
            return None, []
        if not any(fault.kind in UNUSABLE for fault in readings.faults):
            self._heard[readings.message] = frame.steady
            for name in _valves(self._layouts[readings.message]):
                value = readings.commands.get(name, math.nan)
                self._commands[name] = 0.0 if readings.enabled is False else value
            for message, since in self._heard.items():
                layout = self._layouts[message]
                if frame.steady - since > self._missing * layout.cycle:
                    self._commands |= dict.fromkeys(_valves(layout), math.nan)
            return HeardCommand(frame.stamp, dict(self._commands)), readings.faults
        return None, readings.faults


def _valves(layout: MessageLayout) -> set[str]:
    return {channel.name for channel in layout.commands}
