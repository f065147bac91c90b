"""The page over HTTP, and its line to the panel over a WebSocket, for browsers that may have them.

A page of another site must not reach the crane through the operator's browser. So the host that a
browser asks for is localhost, an address in digits, or a name that was given: what DNS rebinding
needs is a name of its own. What asks for something is heard from this page alone (Origin): through
its WebSocket or, stop alone, by a POST, for which a page needs no live line. It may be framed by
none.
"""

import asyncio
import ipaddress
import json
from collections.abc import Awaitable, Callable, Collection
from importlib.resources import files
from pathlib import Path
from typing import Any, Protocol
from urllib.parse import urlsplit

from tornado.httpserver import HTTPServer
from tornado.netutil import bind_sockets
from tornado.web import Application, HTTPError, RequestHandler
from tornado.websocket import WebSocketClosedError, WebSocketHandler
from typing_extensions import override

from crane_model.errors import ConfigurationError

FILES = {
    "": ("index.html", "text/html"),
    "panel.css": ("panel.css", "text/css"),
    "panel.js": ("panel.js", "text/javascript"),
}
LONGEST_MESSAGE = 1000  # bytes from a page; they have fifty
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


class PageListener(Protocol):
    """What is heard from one page; called in the thread of the event loop."""

    def said(self, content: object) -> None:
        """One message of the page; None for what is not JSON."""

    def ended(self, why: str) -> None:
        """The page is gone."""


Opened = Callable[["Socket", str], PageListener | None]
"""Makes the line of a page that has opened a socket from an address; None if it was refused."""

Stopped = Callable[[str], Awaitable[dict[str, Any]]]
"""Stops the crane for a page at an address; what it is answered."""


def host_allowed(host: str, names: Collection[str]) -> bool:
    """Whether a browser may ask for `host`, as its Host header has it, with or without port."""
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
        """Whether a browser says by `origin` that this panel's own page asks."""
        return origin == f"{self.request.protocol}://{self.request.host}"


class _Stop(_Guarded):
    """Stop for a page that has no line."""

    @override
    def initialize(self, stopped: Stopped) -> None:
        self._stopped = stopped

    async def post(self) -> None:
        """Stop; nothing that is sent with it is heeded."""
        if not self.of_this_page(self.request.headers.get("Origin", "")):
            raise HTTPError(403, log_message="a stop that no page of this panel asks for")
        self.write(await self._stopped(self.request.remote_ip or "unknown"))


class _File(_Guarded):
    """The files of the page, which come with the package."""

    def get(self, name: str) -> None:
        """One of `FILES`."""
        file, kind = FILES[name]
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
            (rf"/({'|'.join(FILES)})", _File),
        ],
        names=names,  # allowed beside localhost and addresses
        websocket_max_message_size=LONGEST_MESSAGE,
        log_function=lambda handler: None,
    )
    try:
        sockets = bind_sockets(port, address)
    except OSError as error:
        raise ConfigurationError(
            f"parameters 'address' and 'port': cannot listen on {address}:{port}: "
            f"{error.strerror}; does another panel run? Give another port"
        ) from None
    server = HTTPServer(application, max_body_size=LONGEST_MESSAGE)
    server.add_sockets(sockets)
    return server, int(sockets[0].getsockname()[1])
