"""Rerun's server as a process of its own: it serves the page, and the data to it."""

import os
import socket
import subprocess
import tempfile
import time
from pathlib import Path
from types import TracebackType
from typing import Self
from urllib.parse import quote

from crane_model.errors import ConfigurationError

LOOPBACK = "127.0.0.1"
START_TIMEOUT_S = 20.0
END_TIMEOUT_S = 5.0
MEMORY = "1GiB"  # kept for pages that are opened later; beyond it the oldest is dropped


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
        """Where data are sent to, and where Rerun's own window finds them."""
        return f"rerun+http://{self._reached}:{self._port}/proxy"

    @property
    def process(self) -> int:
        """Its id, within the block."""
        return self._process.pid

    @property
    def page(self) -> str:
        """What to open in a browser."""
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
                    *("--server-memory-limit", MEMORY),
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

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._process.terminate()
        try:
            self._process.wait(END_TIMEOUT_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        self._home.cleanup()

    def _require_free_ports(self) -> None:
        """What listens there already would answer in the place of the server."""
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
