"""jog in a terminal of its own, as a hand at its keys has it."""

import fcntl
import os
import pty
import re
import struct
import subprocess
import termios
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress

from integration.driver_stage import Stage
from integration.processes import RUN, end, environment, line

JOG = RUN.format(module="crane_driver.operator.jog.jog_node")
# A jog whose terminal does not end before the file FREE exists.
SLOW_TO_END = """
import pathlib, time
from crane_driver.operator.jog import jog_node
end = jog_node.Screen.__exit__
def slowly(*given):
    while not pathlib.Path({free!r}).exists():
        time.sleep(0.01)
    return end(*given)
jog_node.Screen.__exit__ = slowly
"""
REPEAT = 1 / 30  # s, of a key
CONTROL = re.compile(r"\x1b\[[0-9;?]*[a-zA-Z]")


class Terminal:
    """A pseudo terminal with jog in it."""

    def __init__(self, *arguments: str, program: str = JOG):
        self._master, self.slave = pty.openpty()
        fcntl.ioctl(self.slave, termios.TIOCSWINSZ, struct.pack("HHHH", 24, 100, 0, 0))
        self.before = self.settings
        self.process = subprocess.Popen(
            line(program, *arguments),
            stdin=self.slave,
            stdout=self.slave,
            stderr=self.slave,
            env=environment() | {"TERM": "xterm"},
        )
        self._shown = ""
        self._reader = threading.Thread(target=self._read)
        self._reader.start()

    @property
    def text(self) -> str:
        """All that was shown, without colours and movements of the cursor."""
        return CONTROL.sub("", self._shown)

    @property
    def settings(self) -> list[object]:
        return termios.tcgetattr(self.slave)

    def type(self, keys: str) -> None:
        os.write(self._master, keys.encode())

    def close(self) -> None:
        end(self.process)
        os.close(self.slave)
        self._reader.join()
        os.close(self._master)

    def _read(self) -> None:
        with suppress(OSError):  # nobody holds the other side any more
            while data := os.read(self._master, 4096):
                self._shown += data.decode(errors="replace")


@contextmanager
def jogging(stage: Stage, *arguments: str, program: str = JOG) -> Iterator[Terminal]:
    """jog, with the crane enabled by it."""
    stage.until_there(lambda: stage.node.count_publishers("/valve_command") == 0)
    terminal = Terminal(*arguments, *stage.ros(), program=program)
    try:
        stage.until_there(lambda: "emergency stop" in terminal.text)  # the help is there
        stage.until_there(lambda: stage.node.count_publishers("/valve_command") == 1)
        enable(stage, terminal)
        yield terminal
    finally:
        stage.end(terminal.process)
        terminal.close()


def enable(stage: Stage, terminal: Terminal) -> None:
    stage.disabled()
    terminal.type("e")
    stage.until(lambda: stage.valves[-1].enabled)


def hold(stage: Stage, terminal: Terminal, key: str, seconds: float) -> float:
    """Repeat a key as a terminal does; when the last character was typed, by the crane's time."""
    first = last = stage.now
    while last < first + seconds:
        last = stage.now
        terminal.type(key)
        stage.within(lambda: False, REPEAT)
    return last
