"""Whether the machine takes the commands that it is sent, by the counters that it echoes."""

import math
from dataclasses import dataclass

from crane_driver.can.decoder import Readings
from crane_driver.can.frame import Frame
from crane_driver.can.layout import Layout, MessageLayout
from crane_driver.faults import Fault, FaultKind


@dataclass(slots=True)
class _Sent:
    """What is known of the frames of one command message."""

    layout: MessageLayout
    since: float = math.inf  # s, steady: when the first frame was sent that nothing answers yet
    frames: int = 0  # sent since the last echo
    echo: int | None = None


class Acceptance:
    """Compares command frames that were sent with the counters of those that were accepted.

    Every echo must have moved on since the last one if frames were sent meanwhile. When it has
    not done so for `timeout` [s], frames do not get through: the machine does not hear them, or
    finds them wrong.
    """

    def __init__(self, layout: Layout, timeout: float):
        self._timeout = timeout
        self._echoing = {one.name: one for one in layout.readings if one.echoes}
        self._sent = {
            (one.message.frame_id, one.message.is_extended_frame): _Sent(one)
            for one in layout.commands
        }
        self._by_name = {one.layout.name: one for one in self._sent.values()}

    def sent(self, frame: Frame, now: float) -> None:
        """A command frame was sent."""
        one = self._sent[frame.id, frame.extended]
        one.frames += 1
        one.since = min(one.since, now)

    def observe(self, readings: Readings) -> list[Fault]:
        """Faults that a frame with echoes shows; again after each `timeout` in which they last."""
        if not readings.accepted:
            return []
        layout = self._echoing[readings.message]
        faults = []
        for command, echo in readings.accepted.items():
            one = self._by_name[command]
            rounds, rest = divmod(one.frames, one.layout.protection.counter_count)
            moved = echo != one.echo or (rounds > 0 and rest == 0)  # whole rounds cannot be seen
            waited = readings.steady - one.since
            if moved:
                one.since = math.inf
            elif waited > self._timeout:
                one.since = readings.steady
                faults.append(
                    layout.fault(
                        FaultKind.NOT_ACCEPTED,
                        f"{command} has been sent for {waited * 1e3:.0f} ms and none was accepted "
                        f"(counter {echo}), limit {self._timeout * 1e3:.0f} ms",
                    )
                )
            one.echo, one.frames = echo, 0
        return faults
