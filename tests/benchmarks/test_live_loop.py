"""The live loop for a minute at 200 Hz: nothing may be lost, and how long the way round takes.

Simulated crane, driver, controller and recorder are processes. This one listens to their bus: it
knows what was there to be published.
"""

import os
import signal
import struct
import subprocess
import sys
import time
from collections import defaultdict
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import numpy as np
from integration.processes import free_port
from integration.recording_graph import Process
from mcap.reader import make_reader
from scipy.ndimage import minimum_filter1d

from crane_driver.can.binding import load_layout
from crane_driver.can.bus import BusSettings
from crane_driver.can.codec import MachineCodec
from crane_driver.can.frame import Frame
from crane_driver.can.link import Link
from crane_model.machine import load_machine
from crane_model.machine_files import machine_file

HERE = Path(__file__).parent
MEASURED = float(os.environ.get("CRANE_LIVE_SECONDS", "60"))  # s
FLOOR = 10.0  # s
MARGIN = 0.5  # s, at both ends of what is compared
MILLISECOND = 1_000_000  # ns
CYCLE = 5 * MILLISECOND
PROMPT = 401  # cycles, among which one is received without delay
SETTLING = 3.0  # s, until all subscriptions are known to all publishers
PATIENCE = 60.0  # s
ANSWER = 0x7F0  # id, of the floor
STEP, VALUES = 0.0005, 99  # as in live_controller.py
LAYOUT = load_layout(load_machine(), machine_file("can.yaml"), machine_file("can.dbc"))
ENCODERS = tuple(one.message.frame_id for one in LAYOUT.readings if one.positions)
PRESSURES = tuple(one.message.frame_id for one in LAYOUT.readings if one.pressures)
VALVES = LAYOUT.commands[0].message.frame_id
TOPICS = ("/joint_states", "/cylinder_pressures", "/valve_command")


class Recorded(NamedTuple):
    """What the bag holds of one topic; times in ns."""

    stamp: np.ndarray  # of the header
    log_time: np.ndarray
    sequence: np.ndarray  # the publisher's own count
    data: list[bytes]


class Bus:
    """All frames of the bus, as an independent listener receives them."""

    def __init__(self, port: int):
        self._link = Link(BusSettings(extra={"port": port}), capacity=100_000).open()
        self.frames: list[Frame] = []

    def listen(self, seconds: float) -> None:
        until = time.monotonic() + seconds
        while time.monotonic() < until:
            time.sleep(0.05)
            self.frames += self._link.take()

    def until(self, condition: Callable[[], object]) -> None:
        deadline = time.monotonic() + PATIENCE
        while not condition():
            assert time.monotonic() < deadline, "waited in vain"
            self.listen(0.1)

    def of(self, identifier: int) -> list[Frame]:
        return [one for one in self.frames if one.id == identifier]

    def close(self) -> None:
        self._link.close()


def read(bag: Path) -> dict[str, Recorded]:
    columns: dict[str, list[tuple[int, int, int, bytes]]] = defaultdict(list)
    for path in bag.glob("*.mcap"):
        with path.open("rb") as file:
            for _, channel, message in make_reader(file).iter_messages():
                seconds, nanoseconds = struct.unpack_from("<iI", message.data, 4)
                stamp = seconds * 10**9 + nanoseconds
                columns[channel.topic].append(
                    (stamp, message.log_time, message.sequence, message.data)
                )
    recorded = {}
    for topic, rows in columns.items():
        stamp, log_time, sequence, data = zip(*rows, strict=True)
        recorded[topic] = Recorded(
            np.array(stamp), np.array(log_time), np.array(sequence), list(data)
        )
    return recorded


class Cycles(NamedTuple):
    """Times [ns] of each cycle, from the machine's first one on."""

    received: np.ndarray  # its first frame, by the listener
    sampled: np.ndarray  # by the machine's even clock: where the promptest frames around it lie


def cycles(bus: Bus, identifiers: tuple[int, ...]) -> Cycles:
    by_message = [bus.of(identifier) for identifier in identifiers]
    count = min(map(len, by_message))
    counters = np.array([[one.data[1] & 0xF for one in frames[:count]] for frames in by_message])
    assert (np.diff(counters) % 15 == 1).all(), "the listener itself has lost frames"
    assert (counters == counters[0]).all(), "frames of different cycles side by side"
    stamps = np.array([[one.stamp for one in frames[:count]] for frames in by_message])
    received = stamps.min(axis=0)
    due = CYCLE * np.arange(count)
    return Cycles(received, due + minimum_filter1d(received - due, PROMPT))


def edge(after: int, cycles: np.ndarray, stamps: np.ndarray) -> int:
    """An instant [ns] between two cycles that nobody can take for one within either."""
    for earlier, later in pairwise(cycles[cycles >= after]):
        middle = (earlier + later) // 2
        if later - earlier > 4 * MILLISECOND and np.abs(stamps - middle).min() > MILLISECOND:
            return int(middle)
    raise AssertionError("no gap between the cycles")


def ways(bus: Bus, commands: Recorded, cycles: Cycles, window: tuple[int, int]) -> np.ndarray:
    """Time [ms] from each encoder frame to the first valve frame with the answer to it."""
    codec = MachineCodec(LAYOUT)
    sent: dict[int, list[int]] = defaultdict(list)
    previous = 0
    for frame in bus.of(VALVES):
        readings = codec.decode(frame)
        assert readings
        value = round(readings.commands["slew"] / STEP)
        if value != previous and readings.enabled:
            sent[value].append(frame.stamp)
        previous = value
    times = []
    for stamp, data in zip(commands.stamp, commands.data, strict=True):
        if not window[0] <= stamp < window[1]:
            continue
        (command,) = struct.unpack_from("<d", data, len(data) - 8)
        frames = np.array(sent[round(command / STEP)])
        asked = cycles.received[np.abs(cycles.sampled - stamp).argmin()]
        later = frames[(frames > asked) & (frames < asked + VALUES * CYCLE // 2)]
        if later.size:  # else a newer command took its place before it was sent
            times.append((later[0] - asked) * 1e-6)
    return np.array(times)


def percentiles(times: np.ndarray) -> str:
    p50, p99, p999 = np.percentile(times, [50, 99, 99.9])
    return f"p50 {p50:6.2f}  p99 {p99:6.2f}  p99.9 {p999:6.2f}  max {times.max():6.2f} ms"


def floor(bus: Bus, port: int) -> np.ndarray:
    """The way round [ms] of python-can alone, beside the same processes."""
    program = [sys.executable, str(HERE / "live_floor.py"), *map(str, (port, ENCODERS[-1], ANSWER))]
    process = subprocess.Popen(program)
    try:
        bus.until(lambda: bus.of(ANSWER))
        begin = len(bus.of(ANSWER))
        bus.listen(FLOOR)
    finally:
        process.terminate()
        process.wait()
    asked = bus.of(ENCODERS[-1])
    times = []
    place = len(asked) - 1
    for answer in reversed(bus.of(ANSWER)[begin:]):
        while asked[place].stamp > answer.stamp or asked[place].data != answer.data:
            place -= 1
        times.append((answer.stamp - asked[place].stamp) * 1e-6)
    return np.array(times)


def test_no_message_is_lost_in_a_minute_at_200_hz(
    ros_domain: int, tmp_path: Path, measured: Callable[..., None]
) -> None:
    port = free_port()
    bus = Bus(port)
    option = f"bus.options:=port={port}"
    bag = tmp_path / "bag"
    started: list[Process] = []

    def start(package: str, name: str, *arguments: object) -> Process:
        started.append(Process(tmp_path, package, name, *arguments))
        return started[-1]

    controller = None
    try:
        crane = start("crane_sim", "simulated_crane", "--bus-option", f"port={port}")
        start("crane_driver", "driver", "--ros-args", "-p", option)
        recorder = start("crane_nodes", "recorder", "--out", bag)
        controller = subprocess.Popen(
            [sys.executable, str(HERE / "live_controller.py")], stdout=subprocess.PIPE, text=True
        )
        bus.until(lambda: all(f"recording {topic} " in recorder.output for topic in TOPICS))
        bus.until(lambda: any(sum(one.data[2:]) for one in bus.of(VALVES)))  # the loop is closed
        bus.listen(SETTLING)
        begin = time.time_ns() + int(MARGIN * 1e9)
        bus.listen(MEASURED + 2 * MARGIN)
        window = (begin, begin + int(MEASURED * 1e9))
        least = floor(bus, port)
        controller.terminate()
        told = controller.communicate(timeout=PATIENCE)[0].strip()
    finally:
        if controller and controller.poll() is None:
            controller.kill()
        for one in reversed(started):
            if one.running:
                one.end(signal.SIGTERM)
        bus.close()
    told = f"driver {told}; {crane.output.splitlines()[-1]}"
    report(bus, read(bag), window, least, told, measured)


def latencies(measured: Callable[..., None], what: str, times: np.ndarray) -> None:
    """A row with percentiles of times [ms]."""
    p50, p99 = np.percentile(times, [50, 99])
    text = "{p50:.2f}, {p99:.1f}, {longest:.1f} ms"
    measured(f"{what}: p50, p99, max", "", text, p50=p50, p99=p99, longest=times.max())


def report(
    bus: Bus,
    bag: dict[str, Recorded],
    window: tuple[int, int],
    least: np.ndarray,
    told: str,
    measured: Callable[..., None],
) -> None:
    sent = {"/joint_states": cycles(bus, ENCODERS), "/cylinder_pressures": cycles(bus, PRESSURES)}
    encoders = sent["/joint_states"]
    kept = (encoders.received >= window[0]) & (encoders.received < window[1])
    late = (encoders.received - encoders.sampled)[kept] * 1e-6
    rate = np.count_nonzero(kept) / MEASURED
    print(f"\n{MEASURED:.0f} s, {rate:.1f} cycles/s on the bus; {told}")
    print("topic                  on the bus   published   in the bag   lost")
    lost = {}
    shift = np.empty(0)
    for topic in TOPICS:
        one = bag[topic]
        due = sent.get(topic, sent["/joint_states"]).sampled  # the controller answers these
        begin, end = (edge(instant, due, one.stamp) for instant in window)
        kept = (one.stamp >= begin) & (one.stamp < end)
        expected = due[(due >= begin) & (due < end)]
        published = int(np.ptp(one.sequence[kept])) + 1
        # What the controller was too busy to answer is not lost, it was never published.
        due_here = len(expected) if topic in sent else published
        lost[topic] = max(published, due_here) - int(kept.sum())
        print(f"{topic:22s} {len(expected):11d} {published:11d} {kept.sum():12d} {lost[topic]:6d}")
        if topic == "/joint_states" and not lost[topic]:
            shift = np.abs(one.stamp[kept] - expected) * 1e-6
    states = bag["/joint_states"]
    delay = (states.log_time - states.stamp) * 1e-6
    loop = ways(bus, bag["/valve_command"], encoders, window)
    print(f"encoder frame: received after it was sampled             {percentiles(late)}")
    if shift.size:
        print(f"joint state: stamp beside the instant of sampling        {percentiles(shift)}")
    print(f"joint state: received in the recorder after its stamp    {percentiles(delay)}")
    print(f"encoder frame -> valve frame, {len(loop):5d} loops             {percentiles(loop)}")
    print(
        "    (commands that come within half a cycle of the last valve frame go with the next one)"
    )
    print(f"encoder frame -> frame, python-can alone, {len(least):4d} loops  {percentiles(least)}")
    measured(
        f"{MEASURED:.0f} s at 200 Hz, machine, driver, controller and recorder as processes: "
        "cycles on the bus; lost of states, pressures, commands",
        "0, 0, 0",
        "{cycles:,.0f}; {states:.0f}, {pressures:.0f}, {commands:.0f}",
        cycles=rate * MEASURED,
        states=lost[TOPICS[0]],
        pressures=lost[TOPICS[1]],
        commands=lost[TOPICS[2]],
    )
    latencies(measured, "encoder frame received after it was sampled", late)
    if shift.size:
        latencies(measured, "stamp of the joint state beside the instant of sampling", shift)
    latencies(measured, "encoder frame to valve frame", loop)
    latencies(measured, "the same by python-can alone, without ROS, in the same run", least)
    assert not any(lost.values()), lost
    assert (np.diff(states.stamp) > 0).all()
    assert len(loop) > rate * MEASURED / 2
