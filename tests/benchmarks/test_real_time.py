"""The driver with and without real time, beside other work on all cores.

Machine, controller and listener have real time in every row, so that what differs is the driver's.
The controller resets faults once a second: 60 a minute are as many as there can be.
"""

import os
import re
import signal
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from integration.processes import free_port
from integration.recording_graph import Process, program

from crane_driver import BusSettings, Link, load_layout
from crane_model import load_machine
from crane_model.machine_files import machine_file
from crane_nodes.this_computer import RealTime, RealTimeSettings

MEASURED = float(os.environ.get("CRANE_REALTIME_SECONDS", "20"))  # s, each row
SETTLING = 3.0  # s
PATIENCE = 300.0  # s, to start on a busy machine
PRIORITY = 60  # the driver's is 50
ABOVE = ("chrt", "--fifo", str(PRIORITY))
VALVES = (
    load_layout(load_machine(), machine_file("can.yaml"), machine_file("can.dbc"))
    .commands[0]
    .message.frame_id
)
CONTROLLER = [sys.executable, str(Path(__file__).parent / "live_controller.py")]
LOADS = {
    "no other load": [],
    "a busy loop on each core, another terminal": [sys.executable, "-c", "while True: pass"],
    "the same in the idle class": ["chrt", "--idle", "0", sys.executable, "-c", "while True: pass"],
}
DRIVERS = {
    "no": ["-p", "realtime.priority:=0", "-p", "realtime.lock_memory:=false"],
    "yes": [],
}


@contextmanager
def running(command: list[str], **options: object) -> Iterator[subprocess.Popen[bytes]]:
    process = subprocess.Popen(command, start_new_session=True, **options)  # type: ignore[call-overload]
    try:
        yield process
    finally:
        process.terminate()
        process.wait(PATIENCE)


def until(condition: Callable[[], bool]) -> None:
    deadline = time.monotonic() + PATIENCE
    while not condition():
        assert time.monotonic() < deadline, "waited in vain"
        time.sleep(0.05)


class Seen(NamedTuple):
    """Of one driver beside one load: time between valve frames [ms], faults a minute, causes."""

    p50: float
    p99: float
    longest: float
    faults: float
    causes: str

    def __str__(self) -> str:
        times = f"{self.p50:5.1f} {self.p99:6.1f} {self.longest:7.1f}"
        return f"{times} {self.faults:8.1f}  {self.causes}"


def row(folder: Path, load: list[str], parameters: list[str]) -> Seen:
    """What is seen of one driver beside one load."""
    folder.mkdir()
    port = free_port()
    with ExitStack() as stack:
        link = stack.enter_context(Link(BusSettings(extra={"port": port}), capacity=100_000))
        crane = [str(program("crane_sim", "simulated_crane")), "--bus-option", f"port={port}"]
        stack.enter_context(running([*ABOVE, *crane], stdout=subprocess.DEVNULL))
        driver = Process(
            folder, "crane_driver", "driver",
            "--ros-args", "-p", f"bus.options:=port={port}", *parameters,
        )  # fmt: skip
        stack.callback(driver.end, signal.SIGTERM)
        stack.enter_context(running([*ABOVE, *CONTROLLER], stdout=subprocess.DEVNULL))
        until(lambda: "is open" in driver.output)
        if load:
            for _ in range(os.cpu_count() or 1):
                stack.enter_context(running(load))
        time.sleep(SETTLING)
        listening = RealTime(RealTimeSettings(PRIORITY, lock_memory=False)).begin()
        stack.callback(listening.end)
        before = len(driver.output)
        link.take()
        time.sleep(MEASURED)
        stamps = np.array([one.stamp for one in link.take() if one.id == VALVES])
        said = driver.output[before:]
    gaps = np.diff(stamps) * 1e-6
    p50, p99 = np.percentile(gaps, [50, 99])
    faults = len(re.findall("-> fault", said)) * 60.0 / MEASURED
    causes = Counter(re.findall(r"\[driver\]: ([^:>]+): ", said))
    named = ", ".join(f"{count} {name}" for name, count in causes.most_common(3))
    return Seen(p50, p99, gaps.max(), faults, named)


def test_the_driver_beside_other_work(
    ros_domain: int, tmp_path: Path, measured: Callable[..., None]
) -> None:
    if subprocess.run([*ABOVE, "true"], capture_output=True).returncode:
        pytest.skip("no real time here: see share/crane_driver/realtime")
    print(f"\n{MEASURED:.0f} s a row             valve frame to frame [ms]  faults")
    print(f"{'load':37s} real time   p50    p99     max  a minute  what was said first")
    for place, (load, command) in enumerate(LOADS.items()):
        for realtime, parameters in DRIVERS.items():
            seen = row(tmp_path / f"{place}_{realtime}", command, parameters)
            print(f"{load:37s} {realtime:9s} {seen}", flush=True)
            measured(
                f"{load}, {'with' if realtime == 'yes' else 'without'} real time: valve "
                "frame to frame, p99, max; faults a minute",
                "",
                "{p99:.0f}, {longest:.0f} ms; {faults:.0f}",
                p99=seen.p99,
                longest=seen.longest,
                faults=seen.faults,
            )
