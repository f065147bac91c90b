"""`ros2 run crane_viewer viewer`: the crane in a browser, live from its topics or from a bag."""

import argparse
import os
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from contextlib import nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Self
from urllib.parse import quote

from rosbags.serde import SerdeError

from crane_bags.reader import namespace_of
from crane_bags.storage import announced, blocks, open_bag
from crane_bags.types import JOINT_STATES
from crane_model.cli import add_machine, command_line, run
from crane_model.errors import ConfigurationError, CraneError, DataError
from crane_model.machine import Machine, load_machine

if TYPE_CHECKING:
    from crane_viewer.view import View

LOOPBACK = "127.0.0.1"
START_TIMEOUT_S = 20.0
END_TIMEOUT_S = 5.0
SERVER_MEMORY = "1GiB"  # kept for pages that are opened later; beyond it the oldest is dropped


class Server:
    """The server within a `with` block, by default for this computer alone.

    It runs beside the process that looks, so that what it does for browsers takes no time there.
    Rerun reports its use to its makers; here that is switched off.
    """

    def __init__(self, listen: str, web_port: int, port: int):
        """listen: address of this computer; ports: of the page and of the data, 0: any."""
        self._listen, self._web_port, self._port = listen, web_port or _free(), port or _free()
        self._reached = LOOPBACK if listen == "0.0.0.0" else listen

    @property
    def data(self) -> str:
        return f"rerun+http://{self._reached}:{self._port}/proxy"

    @property
    def process(self) -> int:
        return self._process.pid

    @property
    def page(self) -> str:
        return f"http://{self._reached}:{self._web_port}/?url={quote(self.data, safe='')}"

    def __enter__(self) -> Self:
        from rerun_cli import __file__ as cli

        self._require_free_ports()
        self._home = tempfile.TemporaryDirectory()
        program = str(Path(cli).with_name("rerun"))  # not its Python front: that would outlive it
        places = dict.fromkeys(("XDG_CONFIG_HOME", "XDG_DATA_HOME"), self._home.name)
        environment = os.environ | places | {"RUST_LOG": "warn"}
        quiet = subprocess.run(
            [program, "analytics", "disable"], env=environment, capture_output=True, text=True
        )
        if quiet.returncode:
            raise ConfigurationError(f"{program} does not run: {quiet.stderr.strip()[-300:]}")
        self._log = Path(self._home.name, "server.log")
        with self._log.open("wb") as log:
            self._process = subprocess.Popen(
                [
                    *(program, "--serve-web", "--bind", self._listen),
                    *("--port", str(self._port), "--web-viewer-port", str(self._web_port)),
                    *("--server-memory-limit", SERVER_MEMORY),
                ],
                env=environment,
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=log,
                # Ctrl-C is for the viewer, which then ends it. Not a session of its own: Linux
                # would share the cores among sessions, whatever the priorities within them.
                process_group=0,
            )
        self._wait_until_it_serves()
        return self

    def __exit__(self, *_: object) -> None:
        self._process.terminate()
        try:
            self._process.wait(END_TIMEOUT_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        self._home.cleanup()

    def _require_free_ports(self) -> None:
        """Raise an error if a port is taken: another process would answer for the server."""
        for port in (self._port, self._web_port):
            with socket.socket() as probe:
                probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
                try:
                    probe.bind((self._listen, port))
                except OSError as error:
                    raise self._refused(f"{error.strerror}, {port}") from None

    def _refused(self, told: str) -> ConfigurationError:
        return ConfigurationError(
            f"Rerun's server does not listen on {self._listen}, ports {self._web_port} and "
            f"{self._port}: {told}; name others by --web-port and --data-port"
        )

    def _wait_until_it_serves(self) -> None:
        until = time.monotonic() + START_TIMEOUT_S
        left = [self._port, self._web_port]
        while left:
            if self._process.poll() is not None or time.monotonic() > until:
                told = self._log.read_text(errors="replace").strip()
                self.__exit__(None, None, None)
                raise self._refused(told[-300:] or "it says nothing")
            try:
                socket.create_connection((self._reached, left[0]), timeout=1.0).close()
                left.pop(0)
            except OSError:
                time.sleep(0.05)


def _free() -> int:
    with socket.socket() as probe:
        probe.bind((LOOPBACK, 0))
        return int(probe.getsockname()[1])


def show_bag(view: "View", machine: Machine, bag: Path) -> None:
    """All that a bag holds of one crane; `DataError` if there is nothing of it to show."""
    from crane_viewer.view import SHOWN

    namespace = namespace_of(bag)
    within = {
        topic.within(namespace).name: topic for topic in SHOWN if topic.name != "/diagnostics"
    }
    within |= {topic.name: topic for topic in SHOWN if topic.name == "/diagnostics"}
    with open_bag(bag) as reader:
        types = {connection.topic: connection.msgtype for connection in reader.connections}
        topics = {
            name: topic
            for name, topic in within.items()
            if types.get(name) == topic.msgtype and announced(reader, name)[0]
        }
        if not topics:
            raise DataError(
                f"{bag}: holds none of {', '.join(within)}; it holds {', '.join(sorted(types))}"
            )
        for block in blocks(bag, reader, topics):
            try:
                view.take(topics[block.topic], block.log_times, block.messages)
            except (SerdeError, ValueError) as error:
                raise DataError(
                    f"{bag}: topic {block.topic}: {error}; the bag is damaged"
                ) from error
    if JOINT_STATES.within(namespace).name in topics and not view.posed:
        raise DataError(
            f"{bag}: no joint states of {', '.join(machine.joint_names)}, the joints of "
            f"{machine.name}; name the machine of the bag by --machine"
        )


@dataclass(frozen=True, kw_only=True)
class ViewRequest:
    """Request of the command line."""

    bag: Path | None  # None: the topics
    machine: str | None
    save: Path | None  # also into this file
    listen: str  # address of this computer
    web_port: int
    data_port: int
    no_page: bool


def main(argv: Sequence[str] | None = None) -> int:
    """Show until SIGINT or SIGTERM; a bag that is only saved ends by itself."""
    argv = sys.argv[1:] if argv is None else argv
    parser = _parser()
    ros = list(argv).index("--ros-args") if "--ros-args" in argv else len(argv)
    options = parser.parse_args(list(argv)[:ros])
    if options.no_page and not options.save:
        parser.error("--no-page: without a page there must be a file: --save FILE.rrd")
    request = ViewRequest(**vars(options))
    return run(lambda: _show(request, list(argv)[ros:]))


def _show(request: ViewRequest, ros_arguments: list[str]) -> None:
    from crane_viewer.view import View  # needs Rerun, which --help does not

    if request.save:
        _check_place(request.save)
    machine = load_machine(request.machine)
    page = (
        nullcontext()
        if request.no_page
        else Server(request.listen, request.web_port, request.data_port)
    )
    with page as server:
        address = server.data if server else None
        view = View(machine, live=request.bag is None, server=address, file=request.save)
        if server:
            print(f"open in a browser: {server.page}", flush=True)
        try:
            if request.bag:
                _show_bag(view, machine, request.bag, request.save)
                if server:
                    _wait()
            else:
                from crane_viewer.viewer_node import show_topics

                show_topics(view, ros_arguments, beside=[server.process] if server else [])
        finally:
            view.finish()


def _check_place(file: Path) -> None:
    if file.exists():
        raise ConfigurationError(f"{file}: exists; name another place")
    if not file.parent.is_dir():
        raise ConfigurationError(f"{file}: there is no folder {file.parent}; make it")


def _show_bag(view: "View", machine: Machine, bag: Path, file: Path | None) -> None:
    """Show a bag; if it cannot be read, delete the `file` that was to hold it."""
    try:
        show_bag(view, machine, bag)
    except CraneError:
        if file:
            file.unlink()
        raise
    print(f"shown: {bag}", flush=True)


def _wait() -> None:
    stop = {signal.SIGINT, signal.SIGTERM, signal.SIGHUP}
    signal.pthread_sigmask(signal.SIG_BLOCK, stop)
    signal.sigwait(stop)


def _parser() -> argparse.ArgumentParser:
    parser = command_line(
        prog="viewer",
        description="Show the crane in a browser, live or from a bag. The viewer publishes "
        "nothing, calls no service, and cannot move the crane.",
        epilog="Live, ROS arguments follow --ros-args: -r __ns:=/left for a crane in a namespace.",
    )
    parser.add_argument(
        "--bag", type=Path, metavar="BAG", help="bag to show instead of the live topics"
    )
    add_machine(parser)
    parser.add_argument(
        "--save", type=Path, metavar="FILE", help="new Rerun file (.rrd) to write, too"
    )
    parser.add_argument(
        "--listen",
        default=LOOPBACK,
        metavar="ADDRESS",
        help="address to serve, for example 0.0.0.0 for other computers, without a password "
        f"(default: {LOOPBACK}, this computer)",
    )
    for name, port, what in (
        ("--web-port", 9090, "page"),
        ("--data-port", 9876, "data; Rerun's own window connects to it, too"),
    ):
        parser.add_argument(
            name,
            type=int,
            default=port,
            metavar="N",
            help=f"port of the {what} (default: {port}; 0: any)",
        )
    parser.add_argument(
        "--no-page", action="store_true", help="do not serve a page; requires --save"
    )
    return parser
