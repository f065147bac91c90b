"""What pages may ask of the driver, over their live line or without one, and what it answers."""

import asyncio
from collections.abc import Callable
from typing import NamedTuple

from rclpy.task import Future

from crane_nodes.driver_client import DriverClient, NoDriverError

STOP = "stop"  # needs no token and no live line: it only takes motion away
ANSWER_TIMEOUT_S = 5.0  # for a page without a live line; by itself it warns after one second


class DriverAnswer(NamedTuple):
    """Of the driver, or for it where it cannot be asked."""

    answer: str  # to which request
    success: bool
    message: str


class Asking:
    """The requests that pages have buttons for, in the thread of the event loop."""

    def __init__(self, driver: DriverClient):
        self._requests: dict[str, Callable[[], list[Future]]] = {
            STOP: driver.stop,
            "enable": lambda: [driver.enable()],
            "disable": lambda: [driver.disable()],
            "reset": lambda: [driver.reset_fault()],
        }

    def knows(self, request: str) -> bool:
        """Whether there is a button for it."""
        return request in self._requests

    def ask(self, request: str, answered: Callable[[DriverAnswer], None]) -> int:
        """`answered` is called with each of the answers, of which this is the number: a stop asks
        every driver that was ever heard.
        """
        try:
            futures = self._requests[request]()
        except NoDriverError as error:
            answered(DriverAnswer(request, False, str(error)))
            return 1
        for future in futures:
            future.add_done_callback(lambda one: answered(_answer(request, one)))
        return len(futures)

    async def stop(self) -> DriverAnswer:
        """Ask every driver to stop; one answer for all."""
        answers: asyncio.Queue[DriverAnswer] = asyncio.Queue()
        count = self.ask(STOP, answers.put_nowait)
        try:
            async with asyncio.timeout(ANSWER_TIMEOUT_S):
                each = [await answers.get() for _ in range(count)]
        except TimeoutError:
            return DriverAnswer(
                STOP,
                False,
                f"the driver did not answer within {ANSWER_TIMEOUT_S:g} s; use the machine's "
                "emergency stop",
            )
        success = all(one.success for one in each)
        return DriverAnswer(STOP, success, "; ".join(one.message for one in each))


def _answer(request: str, future: Future) -> DriverAnswer:
    if error := future.exception():  # the driver may have ended meanwhile
        return DriverAnswer(request, False, str(error))
    result = future.result()
    if result is None:
        return DriverAnswer(request, False, "the request was dropped; the driver may have ended")
    return DriverAnswer(request, result.success, result.message)
