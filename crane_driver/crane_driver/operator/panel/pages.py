"""The pages that are open, which may ask, and what they ask of the driver."""

import asyncio
import hmac
import secrets
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

from rclpy.task import Future

from crane_nodes.driver_client import DriverClient, NoDriverError

# Who may press the buttons of the page: whoever can read the terminal that the panel runs in.

ALPHABET = "abcdefghjkmnpqrstuvwxyz23456789"  # nothing that looks like something else
GROUPS, GROUP_LENGTH = 2, 4
WAIT_S = 1.0  # after a wrong token, for the page that gave it: another page is not held up


def new_token() -> str:
    """Such as `k7mq-2xhd`, at random."""
    groups = ("".join(secrets.choice(ALPHABET) for _ in range(GROUP_LENGTH)) for _ in range(GROUPS))
    return "-".join(groups)


class Arming:
    """Judges what one page gives for the `token`. Times are of the steady clock [s]."""

    def __init__(self, token: str):
        self._token = token.encode()
        self._wait_until = 0.0

    def refusal(self, given: str, now: float) -> str:
        """Why `given` does not arm; empty if it does."""
        if now < self._wait_until:
            return "a wrong token was given a moment ago; wait a second, then try again"
        if hmac.compare_digest(given.strip().lower().encode(errors="replace"), self._token):
            return ""
        self._wait_until = now + WAIT_S
        return "this is not the token that the panel's terminal shows"


# Which pages are open, whether they still show what they are sent, and which are armed.

PAGE_SILENCE_S = 1.5  # a page tells of every picture that it has shown; ten of them come a second
LOOK_PAUSE_S = 0.5  # between two looks, beyond which the panel itself was held up; ten a second
MOST_PAGES = 16  # open at once: each costs a picture ten times a second
LONGEST_REASON = 150  # characters


@dataclass(eq=False)
class Page:
    """One page, from its opening to its end. Times are of the steady clock [s]."""

    address: str
    seen: float  # when it last told that it shows what it was sent; later, if that was not heard
    armed: bool = False


class Lost(NamedTuple):
    """A page that is gone, when by the clock on the wall, and why."""

    address: str
    armed: bool
    at: str
    why: str

    def __str__(self) -> str:
        armed = "an armed page" if self.armed else "a page"
        return f"{armed} ({self.address}) was lost at {self.at}: {self.why}"


def legible(reason: str) -> str:
    """A reason as it is shown to others than who gave it: one bounded line of plain characters,
    of which none turns, hides or overlays what stands beside it.
    """
    plain = "".join(one if " " <= one <= "~" else "?" for one in reason)
    return plain if len(plain) <= LONGEST_REASON else f"{plain[: LONGEST_REASON - 3]}..."


class Pages:
    """Those that are open; `lost` is the last one that is not, until another one opens."""

    def __init__(self) -> None:
        self._open: list[Page] = []
        self._looked: float | None = None  # when, for pages that are silent [s]
        self.lost: Lost | None = None

    @property
    def refusal(self) -> str:
        """Why no other page may open; empty if one may."""
        if self.count < MOST_PAGES:
            return ""
        return f"{self.count} pages are open, limit {MOST_PAGES}; close another one"

    def opened(self, address: str, now: float) -> Page:
        """A page, not armed."""
        page = Page(address, now)
        self._open.append(page)
        self.lost = None
        return page

    def closed(self, page: Page, at: str, why: str) -> Lost | None:
        """`page` has ended and is armed no more; None if that was known."""
        if not self.is_open(page):
            return None
        self._open.remove(page)
        self.lost = Lost(page.address, page.armed, at, legible(why))
        page.armed = False
        return self.lost

    def silent(self, now: float) -> list[Page]:
        """Those that have told nothing for too long, but for a time in which the panel, held up
        itself, could hear none of them.
        """
        pause = 0.0 if self._looked is None else now - self._looked
        self._looked = now
        if pause > LOOK_PAUSE_S:
            for one in self._open:
                one.seen = min(one.seen + pause, now)
        return [one for one in self._open if now - one.seen > PAGE_SILENCE_S]

    def is_open(self, page: Page) -> bool:
        """Whether `page` may still be heard."""
        return page in self._open

    @property
    def count(self) -> int:
        """Pages that are open."""
        return len(self._open)

    @property
    def armed(self) -> int:
        """Those of them that are armed."""
        return sum(page.armed for page in self._open)


# What pages may ask of the driver, over their live line or without one, and what it answers.

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
