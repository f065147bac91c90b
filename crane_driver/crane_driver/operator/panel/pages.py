"""The pages of the panel: served over HTTP, heard over WebSockets, and what they may ask.

A page of another site must not reach the crane through the operator's browser. So the host that a
browser asks for is localhost, an address in digits, or a name that was given: DNS rebinding needs a
name of its own. Requests are heard from this page alone (Origin): through its WebSocket or, stop
alone, by a POST, for which a page needs no live line. No other page may frame it. Whoever can read
the terminal of the panel may press the buttons, by the token that is printed there.
"""

import asyncio
import hmac
import ipaddress
import json
import secrets
from collections.abc import Awaitable, Callable, Collection
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from typing import Any, NamedTuple, Protocol
from urllib.parse import urlsplit

from rclpy.task import Future
from tornado.httpserver import HTTPServer
from tornado.netutil import bind_sockets
from tornado.web import Application, HTTPError, RequestHandler
from tornado.websocket import WebSocketClosedError, WebSocketHandler
from typing_extensions import override

from crane_driver import constants
from crane_model.errors import ConfigurationError
from crane_nodes.driver_client import DriverClient, NoDriverError

PAGE_FILES = {
    "": ("index.html", "text/html"),
    "panel.css": ("panel.css", "text/css"),
    "panel.js": ("panel.js", "text/javascript"),
}
POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; connect-src 'self'; img-src data:; "
    "base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
HEADERS = {
    "Content-Security-Policy": POLICY,
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cache-Control": "no-store",
    "Server": "panel",
}

ALPHABET = "abcdefghjkmnpqrstuvwxyz23456789"  # nothing that looks like something else
GROUPS, GROUP_LENGTH = 2, 4


STOP_REQUEST = "stop"  # needs no token and no live line: it only takes motion away


class PageListener(Protocol):
    """Listener for one page; called in the thread of the event loop."""

    def said(self, content: object) -> None:
        """One message of the page; None for what is not JSON."""

    def ended(self, why: str) -> None:
        """The page is gone."""


Opened = Callable[["Socket", str], PageListener | None]
"""Makes the line of a page that has opened a socket from an address; None if it was refused."""

Stopped = Callable[[str], Awaitable[dict[str, Any]]]
"""Stops the crane for a page at an address; what it is answered."""


def host_allowed(host: str, names: Collection[str]) -> bool:
    """Return whether a browser may ask for `host`, as its Host header has it, port or not."""
    try:
        name = urlsplit(f"//{host}").hostname or ""
    except ValueError:
        return False
    if name == "localhost" or name in names:
        return True
    try:
        ipaddress.ip_address(name)
    except ValueError:
        return False
    return True


class _Guarded(RequestHandler):
    """Answers none but the hosts that are allowed."""

    @override
    def prepare(self) -> None:
        if not host_allowed(self.request.host, self.settings["names"]):
            raise HTTPError(403, log_message="a host that is not this computer's")

    @override
    def set_default_headers(self) -> None:
        for name, value in HEADERS.items():
            self.set_header(name, value)

    def of_this_page(self, origin: str) -> bool:
        """Return whether a browser says by `origin` that this panel's own page asks."""
        return origin == f"{self.request.protocol}://{self.request.host}"


class _Stop(_Guarded):
    """Stop for a page that has no line."""

    @override
    def initialize(self, stopped: Stopped) -> None:
        self._stopped = stopped

    async def post(self) -> None:
        if not self.of_this_page(self.request.headers.get("Origin", "")):
            raise HTTPError(403, log_message="a stop that no page of this panel asks for")
        self.write(await self._stopped(self.request.remote_ip or "unknown"))


class _File(_Guarded):
    """The files of the page, which come with the package."""

    def get(self, name: str) -> None:
        file, kind = PAGE_FILES[name]
        self.set_header("Content-Type", f"{kind}; charset=utf-8")
        self.write(Path(str(files(__package__)), "page", file).read_bytes())


class Socket(WebSocketHandler, _Guarded):
    """The WebSocket of one page."""

    @override
    def initialize(self, opened: Opened) -> None:
        self._opened = opened
        self._line: PageListener | None = None
        self.gone = asyncio.Event()  # once the page has answered that it is closed

    @override
    def check_origin(self, origin: str) -> bool:
        return self.of_this_page(origin)

    @override
    async def get(self, *args: Any, **kwargs: Any) -> None:
        if "Origin" not in self.request.headers:  # no browser; tornado would let it pass
            raise HTTPError(403, log_message="a WebSocket without an Origin")
        await super().get(*args, **kwargs)

    @override
    def open(self, *args: str, **kwargs: str) -> None:
        self.set_nodelay(True)
        self._line = self._opened(self, self.request.remote_ip or "unknown")

    @override
    def on_message(self, message: str | bytes) -> None:
        try:
            content = json.loads(message)
        except (ValueError, RecursionError):
            content = None
        if self._line:
            self._line.said(content)

    @override
    def on_close(self) -> None:
        self.gone.set()
        if self._line:
            said = f'; it said "{self.close_reason}"' if self.close_reason else ""
            self._line.ended(f"it was closed, or its connection was lost{said}")

    def tell(self, content: dict[str, Any]) -> None:
        """Send; nothing where the page is gone, which `ended` tells."""
        try:
            sending = self.write_message(json.dumps(content, allow_nan=False))
        except WebSocketClosedError:
            return
        sending.add_done_callback(lambda done: done.exception())  # gone meanwhile: the same


def listen(
    address: str, port: int, names: Collection[str], opened: Opened, stopped: Stopped
) -> tuple[HTTPServer, int]:
    """Serve on an address and port, 0 for any; the server and its port. `ConfigurationError`."""
    application = Application(
        [
            (r"/live", Socket, {"opened": opened}),
            (r"/stop", _Stop, {"stopped": stopped}),
            (rf"/({'|'.join(PAGE_FILES)})", _File),
        ],
        names=names,  # allowed beside localhost and addresses
        websocket_max_message_size=constants.LARGEST_MESSAGE_BYTES,
        log_function=lambda handler: None,
    )
    try:
        sockets = bind_sockets(port, address)
    except OSError as error:
        raise ConfigurationError(
            f"parameters 'address' and 'port': cannot listen on {address}:{port}: "
            f"{error.strerror}; does another panel run? Give another port"
        ) from None
    server = HTTPServer(application, max_body_size=constants.LARGEST_MESSAGE_BYTES)
    server.add_sockets(sockets)
    return server, int(sockets[0].getsockname()[1])


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
        self._wait_until = now + constants.WRONG_TOKEN_WAIT_S
        return "this is not the token that the panel's terminal shows"


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
    """A reason as one bounded line of plain characters, none of which hides its neighbours."""
    plain = "".join(character if " " <= character <= "~" else "?" for character in reason)
    return (
        plain
        if len(plain) <= constants.LONGEST_REASON_CHARACTERS
        else f"{plain[: constants.LONGEST_REASON_CHARACTERS - 3]}..."
    )


class Pages:
    """Those that are open; `lost` is the last one that is not, until another one opens."""

    def __init__(self) -> None:
        self._open: list[Page] = []
        self._looked: float | None = None  # when, for pages that are silent [s]
        self.lost: Lost | None = None

    @property
    def refusal(self) -> str:
        """Why no other page may open; empty if one may."""
        if self.count < constants.MOST_PAGES:
            return ""
        return f"{self.count} pages are open, limit {constants.MOST_PAGES}; close another one"

    def opened(self, address: str, now: float) -> Page:
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
        """Pages that were silent for too long, except while the panel itself was held up."""
        pause = 0.0 if self._looked is None else now - self._looked
        self._looked = now
        if pause > constants.LOOK_PAUSE_S:
            for page in self._open:
                page.seen = min(page.seen + pause, now)
        return [page for page in self._open if now - page.seen > constants.PAGE_SILENCE_S]

    def is_open(self, page: Page) -> bool:
        return page in self._open

    @property
    def count(self) -> int:
        return len(self._open)

    @property
    def armed(self) -> int:
        return sum(page.armed for page in self._open)


class DriverAnswer(NamedTuple):
    """Answer of the driver, or an answer in its place if the driver cannot be asked."""

    answer: str  # to which request
    success: bool
    message: str


class Asking:
    """The requests that pages have buttons for, in the thread of the event loop."""

    def __init__(self, driver: DriverClient):
        self._requests: dict[str, Callable[[], list[Future]]] = {
            STOP_REQUEST: driver.stop,
            "enable": lambda: [driver.enable()],
            "disable": lambda: [driver.disable()],
            "reset": lambda: [driver.reset_fault()],
        }

    def knows(self, request: str) -> bool:
        return request in self._requests

    def ask(self, request: str, answered: Callable[[DriverAnswer], None]) -> int:
        """Call `answered` with each of the answers, whose number is returned."""
        try:
            futures = self._requests[request]()
        except NoDriverError as error:
            answered(DriverAnswer(request, False, str(error)))
            return 1
        for future in futures:
            future.add_done_callback(lambda done: answered(_answer(request, done)))
        return len(futures)

    async def stop(self) -> DriverAnswer:
        """Ask every driver to stop; one answer for all."""
        answers: asyncio.Queue[DriverAnswer] = asyncio.Queue()
        count = self.ask(STOP_REQUEST, answers.put_nowait)
        try:
            async with asyncio.timeout(constants.ANSWER_TIMEOUT_S):
                received = [await answers.get() for _ in range(count)]
        except TimeoutError:
            return DriverAnswer(
                STOP_REQUEST,
                False,
                f"the driver did not answer within {constants.ANSWER_TIMEOUT_S:g} s; use the "
                "machine's emergency stop",
            )
        success = all(answer.success for answer in received)
        return DriverAnswer(STOP_REQUEST, success, "; ".join(answer.message for answer in received))


def _answer(request: str, future: Future) -> DriverAnswer:
    if error := future.exception():  # the driver may have ended meanwhile
        return DriverAnswer(request, False, str(error))
    result = future.result()
    if result is None:
        return DriverAnswer(request, False, "the request was dropped; the driver may have ended")
    return DriverAnswer(request, result.success, result.message)
