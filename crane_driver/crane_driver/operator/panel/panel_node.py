"""`ros2 run crane_driver panel`: one page for the operator, in a browser.

It shows the crane, and enables, disables and stops it; it never moves it: hold-to-run is for
keyboard and joystick (jog), which notice a released key. Software is not a safety stop: keep the
emergency stop of the machine within reach.
"""

import asyncio
import sys
import time
from collections.abc import Sequence

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.node import Node

from crane_driver import constants
from crane_driver.operator.panel.crane_watch import Content, CraneWatch, plain, wall_clock
from crane_driver.operator.panel.pages import (
    STOP_REQUEST,
    Arming,
    Asking,
    DriverAnswer,
    Page,
    Pages,
    Socket,
    listen,
    new_token,
)
from crane_model.cli import run
from crane_nodes.executor import KeptExecutor
from crane_nodes.managed import Stop, check_arguments, full_name, ros, say_ready
from crane_nodes.parameters import MACHINE, Number, Text, declare, declare_machine

ADDRESS = Text(
    "address",
    "127.0.0.1",
    "Address to listen on; 127.0.0.1: only this computer, 0.0.0.0: every network it is in, "
    "without encryption. At the start",
)
PORT = Number(
    "port", 8060, "-", 0, 65535, "Port to listen on; 0: any that is free. At the start", whole=True
)
NAMES = Text(
    "names",
    "",
    "Host names by which browsers may request the page, in addition to localhost and IP addresses, "
    "separated by blanks. At the start",
)
PARAMETERS = (ADDRESS, PORT, NAMES)


GOING_AWAY, TRY_AGAIN_LATER = 1001, 1013  # of RFC 6455, and of IANA

ABOUT_PANEL = """A page for the operator, in a browser: state, joints, pressures, faults, progress,
and the buttons stop, enable, disable and reset. All but stop need the token that is printed here.
It moves nothing. Software is not a safety stop."""


class OperatorPanel(Node):
    """The crane of its namespace, for pages; all in the thread of the event loop."""

    def __init__(self) -> None:
        super().__init__("panel")
        machine = declare_machine(self)
        declare(self, PARAMETERS, read_only=PARAMETERS)
        self.token = new_token()
        self.pages = Pages()
        self._watch = CraneWatch(self, machine)
        self._diagnostics = self.create_publisher(DiagnosticArray, "/diagnostics", 10)
        self._lines: list[_PageLine] = []
        self._worker = KeptExecutor()
        self._worker.add_node(self)
        self._picture_due = self._report_due = 0.0
        self.asking = Asking(self._watch.driver)

    def opened(self, socket: Socket, address: str) -> "_PageLine | None":
        """A page has opened a socket; None if there are too many."""
        if refusal := self.pages.refusal:
            socket.close(TRY_AGAIN_LATER, refusal)
            self.get_logger().warning(
                f"a page from {address} was refused: {refusal}",
                throttle_duration_sec=constants.REFUSALS_PERIOD_S,
            )
            return None
        line = _PageLine(self, socket, self.pages.opened(address, time.monotonic()))
        self._lines.append(line)
        self.get_logger().info(f"a page was opened from {address}; {self.pages.count} open")
        return line

    def closed(self, line: "_PageLine", why: str) -> None:
        if lost := self.pages.closed(line.page, wall_clock(), why):
            self._lines.remove(line)
            self.get_logger().warning(f"{lost}; {self.pages.count} open")
            self._report_due = 0.0

    async def stopped(self, address: str) -> Content:
        """A page without a line, as one that was refused, has pressed stop: the answer."""
        self.get_logger().info(f"{STOP_REQUEST}: requested by an unconnected page at {address}")
        answer: Content = plain((await self.asking.stop())._asdict())
        return answer

    def work(self) -> None:
        for _ in range(constants.PANEL_CALLBACKS):
            self._worker.spin_once(timeout_sec=0.0)
        now = time.monotonic()
        if now >= self._picture_due:
            self._picture_due = now + constants.PICTURE_PERIOD_S
            self._show(now)
        if now >= self._report_due:
            self._report_due = now + constants.PAGES_REPORT_PERIOD_S
            self._report()

    async def end(self) -> None:
        """Tell the pages, and wait for what they answer: a connection that is closed while there is
        something to read is reset, and its page may never learn why.
        """
        lines = list(self._lines)
        for line in lines:
            line.hang_up("the panel was ended", GOING_AWAY)
        if lines:
            answers = [asyncio.ensure_future(line.gone()) for line in lines]
            await asyncio.wait(answers, timeout=constants.GOODBYE_S)

    def _show(self, now: float) -> None:
        silent = self.pages.silent(now)
        for line in [line for line in self._lines if line.page in silent]:
            line.hang_up("it no longer shows new data")
        if self._lines:
            picture = self._watch.picture() | {"lost_page": str(self.pages.lost or "")}
            for line in self._lines:
                line.show(picture)

    def _report(self) -> None:
        status = DiagnosticStatus(name=f"{full_name(self)}: pages", level=DiagnosticStatus.OK)
        pages = self.pages
        status.message = f"{pages.count} open, {pages.armed} armed"
        if pages.lost and not pages.count:
            status.level, status.message = DiagnosticStatus.WARN, str(pages.lost)
        values = {"open": pages.count, "armed": pages.armed, "last lost": pages.lost or "none"}
        status.values = [KeyValue(key=key, value=str(value)) for key, value in values.items()]
        message = DiagnosticArray(status=[status])
        message.header.stamp = self.get_clock().now().to_msg()
        self._diagnostics.publish(message)


class _PageLine:
    """Connection to one page."""

    def __init__(self, panel: OperatorPanel, socket: Socket, page: Page):
        self.page = page
        self._panel, self._socket = panel, socket
        self._arming = Arming(panel.token)

    def said(self, content: object) -> None:
        """One message of the page: it has shown a picture, gives a token, or asks for something.

        What still comes of a page that was lost is not heeded: its hand may be gone.
        """
        if not self._panel.pages.is_open(self.page):
            return
        match content:
            case {"seen": _}:
                self.page.seen = time.monotonic()
            case {"token": str(token)}:
                self._arm(token)
            case {"disarm": True}:
                self.page.armed = False
                self._tell_armed("")
            case {"request": str(name)} if self._panel.asking.knows(name):
                self._request(name)
            case _:
                self.hang_up("it sent an unknown message")

    def ended(self, why: str) -> None:
        self._panel.closed(self, why)

    def hang_up(self, why: str, code: int = 1008) -> None:
        self._socket.close(code, why)
        self.ended(why)

    async def gone(self) -> None:
        await self._socket.gone.wait()

    def show(self, picture: Content) -> None:
        self._socket.tell({"picture": picture, "armed": self.page.armed})

    def _arm(self, token: str) -> None:
        refusal = self._arming.refusal(token, time.monotonic())
        self.page.armed = self.page.armed or not refusal
        log = self._panel.get_logger()
        if refusal:
            log.warning(f"a page ({self.page.address}) was not armed: {refusal}")
        else:
            log.info(f"a page ({self.page.address}) was armed")
        self._tell_armed(refusal)

    def _tell_armed(self, refusal: str) -> None:
        self._socket.tell({"armed": self.page.armed, "refusal": refusal})

    def _request(self, name: str) -> None:
        if name != STOP_REQUEST and not self.page.armed:
            refusal = "this page is not armed; give it the token first"
            self._answered(DriverAnswer(name, False, refusal))
            return
        self._panel.get_logger().info(f"{name}: requested by the page at {self.page.address}")
        self._panel.asking.ask(name, self._answered)

    def _answered(self, answer: DriverAnswer) -> None:
        self._socket.tell(plain(answer._asdict()))


def main(argv: Sequence[str] | None = None) -> int:
    """Serve the page until a signal ends it."""
    argv = sys.argv[1:] if argv is None else argv
    check_arguments("panel", ABOUT_PANEL, (MACHINE, *PARAMETERS), argv)
    return run(lambda: _run(argv))


def _run(argv: Sequence[str]) -> None:
    with ros(argv) as stop:
        panel = OperatorPanel()
        try:
            asyncio.run(_serve(panel, stop))
        finally:
            panel.destroy_node()


async def _serve(panel: OperatorPanel, stop: Stop) -> None:
    address, names = ADDRESS.read(panel), NAMES.read(panel).lower().split()
    server, port = listen(address, int(PORT.read(panel)), names, panel.opened, panel.stopped)
    say_ready(panel)
    # Not to the log, which others of the ROS domain read.
    print(f"page:  http://{_shown(address)}:{port}", flush=True)
    print(f"token: {panel.token}   arms its buttons", flush=True)
    try:
        while not stop.requested:
            panel.work()
            await asyncio.sleep(constants.WORK_PERIOD_S)
    finally:
        server.stop()
        await panel.end()
        await server.close_all_connections()


def _shown(address: str) -> str:
    if address in ("0.0.0.0", "::", ""):
        return "ADDRESS-OF-THIS-COMPUTER"
    return f"[{address}]" if ":" in address else address
