"""ROS within a `with` block, ended by signals that never cut off what is being closed."""

import signal
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from types import FrameType

import rclpy
from rclpy.signals import SignalHandlerOptions

SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


class Stop:
    """Whether a signal has asked the process to stop."""

    requested = False

    def request(self, _number: int, _frame: FrameType | None) -> None:
        """The handler of the signals."""
        self.requested = True


@contextmanager
def ros(argv: Sequence[str]) -> Iterator[Stop]:
    """ROS within the `with` block, where SIGINT, SIGTERM and SIGHUP only set what it gives.

    So whatever is being closed is closed to its end, however often Ctrl-C is pressed.
    """
    stop = Stop()
    previous = {number: signal.signal(number, stop.request) for number in SIGNALS}
    rclpy.init(args=list(argv), signal_handler_options=SignalHandlerOptions.NO)
    try:
        yield stop
    finally:
        rclpy.try_shutdown()
        for number, handler in previous.items():
            signal.signal(number, handler)
