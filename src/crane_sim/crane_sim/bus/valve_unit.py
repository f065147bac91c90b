"""The electronics of the valves: what they do with the frames that command them."""

from collections.abc import Sequence

from crane_driver.can.codec import MachineCodec
from crane_driver.can.frame import Frame
from crane_driver.can.health import Monitor
from crane_driver.faults import UNUSABLE

TIMEOUT = 0.1  # s without a valid command, as the DBC file says of the valve unit
NEUTRAL, ENABLED, COMMAND_TIMEOUT = "Neutral", "Enabled", "CommandTimeout"


class ValveUnit:
    """Takes frames and gives spool commands; neutral until told otherwise.

    A frame of the wrong size, with a wrong checksum or a repeated counter is not accepted. Enabled
    valves that get no valid command for `TIMEOUT` go to neutral, and stay there until a command
    that does not enable them.
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
        # Where a machine has no enable signal, its valves follow every command.
        if readings.enabled is False:
            self.state = NEUTRAL
        elif self.state is not COMMAND_TIMEOUT or readings.enabled is None:
            self.state = ENABLED

    def commands(self, now: float) -> list[float]:
        """(j,) spool commands -1 to 1 at `now` [s, steady], in the order of the joints."""
        self._expire(now)
        if self.state is not ENABLED:
            return [0.0] * len(self._commands)
        return list(self._commands.values())

    def _expire(self, now: float) -> None:
        if self.state is ENABLED and now - self._last > TIMEOUT:
            self.state = COMMAND_TIMEOUT
