"""Valve frames on the bus that this driver did not send."""

from collections import deque

from crane_driver.can.decoder import Decoder
from crane_driver.can.frame import Frame
from crane_driver.can.layout import Layout
from crane_driver.faults import Fault, FaultKind

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
