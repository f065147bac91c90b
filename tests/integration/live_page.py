"""A page in Chromium without a window, by its DevTools protocol: what it shows and what it says."""

import base64
import json
import shutil
import subprocess
import tempfile
import time
from contextlib import ExitStack, suppress
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from integration.processes import PATIENCE
from websockets.sync.client import ClientConnection, connect

FLAGS = (
    "--headless",
    "--no-sandbox",
    "--use-angle=swiftshader",  # WebGL without a graphics card
    "--enable-unsafe-swiftshader",
    "--ignore-gpu-blocklist",
    "--hide-scrollbars",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--host-resolver-rules=MAP * ~NOTFOUND, EXCLUDE 127.0.0.1, EXCLUDE localhost",
    "--remote-debugging-port=0",
)


class Page:
    """A page that is open within a `with` block. `console` holds what it has said so far."""

    def __init__(self, program: str, url: str, width: int, height: int):
        """width, height: of the page [pixels]."""
        self.console: list[str] = []
        self._program, self._url, self._size = program, url, (width, height)
        self._number = 0
        self._closing = ExitStack()

    def __enter__(self) -> Self:
        self._profile = Path(tempfile.mkdtemp(prefix="page_"))
        size = "--window-size={},{}".format(*self._size)
        self._process = subprocess.Popen(
            [self._program, *FLAGS, size, f"--user-data-dir={self._profile}", "about:blank"],
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        try:
            self._socket = self._connected()
            width, height = self._size
            self._ask("Runtime.enable")
            self._ask(
                "Emulation.setDeviceMetricsOverride",
                width=width,
                height=height,
                deviceScaleFactor=1,
                mobile=False,
            )
            self._ask("Page.navigate", url=self._url)
        except BaseException:
            self._end()
            raise
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._end()

    def picture(self) -> bytes:
        """What is seen now, as PNG."""
        return base64.b64decode(self._ask("Page.captureScreenshot", format="png")["data"])

    def evaluate(self, expression: str) -> Any:
        """The value of a JavaScript expression in the page."""
        answer = self._ask("Runtime.evaluate", expression=expression, returnByValue=True)
        return answer["result"].get("value")

    def press(self, element: str) -> bool:
        """Press the mouse in the middle of an element, by its id, and do not let it go; whether the
        page has it yet.
        """
        where = self.evaluate(
            f"(box => box && [box.left + box.width / 2, box.top + box.height / 2])"
            f"(document.getElementById({json.dumps(element)})?.getBoundingClientRect())"
        )
        if where is None:
            return False
        x, y = where
        self._ask(
            "Input.dispatchMouseEvent", type="mousePressed", x=x, y=y, button="left", clickCount=1
        )
        return True

    def listen(self, seconds: float) -> None:
        """Let the page go on, and take in what it says."""
        until = time.monotonic() + seconds
        while (left := until - time.monotonic()) > 0.0:
            with suppress(TimeoutError):
                self._hear(json.loads(self._socket.recv(left)))

    def _connected(self) -> ClientConnection:
        port_file = self._profile / "DevToolsActivePort"
        until = time.monotonic() + PATIENCE
        while not (port_file.exists() and len(port_file.read_text().split()) > 1):
            if time.monotonic() > until or self._process.poll() is not None:
                raise TimeoutError(f"{self._program} did not start within {PATIENCE:g} s")
            time.sleep(0.05)
        port, path = port_file.read_text().split()[:2]
        # Without a graphics card a browser may be too busy for minutes to answer a ping.
        patient: dict[str, Any] = {"max_size": None, "proxy": None, "ping_interval": None}
        patient["open_timeout"] = PATIENCE
        whole = connect(f"ws://127.0.0.1:{port}{path}", **patient)
        page = None
        with whole:
            while page is None:  # the browser listens before it has opened one
                assert time.monotonic() < until, "no page is opened"
                whole.send(json.dumps({"id": 0, "method": "Target.getTargets"}))
                targets = json.loads(whole.recv(PATIENCE))["result"]["targetInfos"]
                pages = (one["targetId"] for one in targets if one["type"] == "page")
                page = next(pages, None)
        page_socket = connect(f"ws://127.0.0.1:{port}/devtools/page/{page}", **patient)
        return self._closing.enter_context(page_socket)

    def _ask(self, method: str, **parameters: object) -> dict[str, Any]:
        self._number += 1
        request = {"id": self._number, "method": method, "params": parameters}
        self._socket.send(json.dumps(request))
        while True:
            answer = json.loads(self._socket.recv(PATIENCE))
            self._hear(answer)
            if answer.get("id") == self._number:
                if "error" in answer:
                    raise RuntimeError(f"{method}: {answer['error']['message']}")
                result: dict[str, Any] = answer["result"]
                return result

    def _hear(self, answer: dict[str, Any]) -> None:
        if answer.get("method") == "Runtime.consoleAPICalled":
            said = answer["params"]["args"]
            self.console.append(" ".join(str(one.get("value", "")) for one in said))

    def _end(self) -> None:
        self._closing.close()
        self._process.terminate()
        try:
            self._process.wait(10.0)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        shutil.rmtree(self._profile, ignore_errors=True)
