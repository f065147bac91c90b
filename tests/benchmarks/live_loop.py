"""The live loop as processes, and what can be told of it by its bus and its bag alone."""

import signal
import struct
import subprocess
import sys
import time
from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager, ExitStack, nullcontext
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple, Self

import numpy as np
import psutil
from integration.processes import CONTROLLER_PRIORITY, MACHINE_PRIORITY, free_port, prefer
from integration.recording_graph import Process, graph
from mcap.reader import make_reader
from rclpy.serialization import deserialize_message
from scipy.ndimage import minimum_filter1d

from crane_driver import BusSettings, Link, MachineCodec, load_layout
from crane_driver.can.frame import Frame
from crane_interfaces.msg import DriverState, ValveCommand
from crane_model import load_machine
from crane_model.machine_files import machine_file
from crane_nodes import DriverClient

HERE = Path(__file__).parent
FLOOR = 10.0  # s
MARGIN = 0.5  # s, at both ends of what is compared
MILLISECOND = 1_000_000  # ns
CYCLE = 5 * MILLISECOND
PROMPT = 401  # cycles, among which one is received without delay
SETTLING = 3.0  # s, until all subscriptions are known to all publishers
PATIENCE = 60.0  # s
ANSWER = 0x7F0  # id, of the floor
ANSWERED = 250 * MILLISECOND  # in which a command is answered; half a round of live_controller.py
LAYOUT = load_layout(load_machine(), machine_file("can.yaml"), machine_file("can.dbc"))
ENCODERS = tuple(one.message.frame_id for one in LAYOUT.readings if one.positions)
PRESSURES = tuple(one.message.frame_id for one in LAYOUT.readings if one.pressures)
VALVES = LAYOUT.commands[0].message.frame_id
TOPICS = ("/joint_states", "/cylinder_pressures", "/valve_command")


class Recorded(NamedTuple):
    """What the bag holds of one topic; times in ns."""

    stamp: np.ndarray  # of the header
    published: np.ndarray  # by the middleware of the publisher
    received: np.ndarray  # by that of the recorder
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
    columns: dict[str, list[tuple[int, int, int, int, bytes]]] = defaultdict(list)
    for path in bag.glob("*.mcap"):
        with path.open("rb") as file:
            for _, channel, message in make_reader(file).iter_messages():
                seconds, nanoseconds = struct.unpack_from("<iI", message.data, 4)
                stamp = seconds * 10**9 + nanoseconds
                row = stamp, message.publish_time, message.log_time, message.sequence
                columns[channel.topic].append((*row, message.data))
    recorded = {}
    for topic, rows in columns.items():
        stamp, published, received, sequence, data = zip(*rows, strict=True)
        times = np.array(stamp), np.array(published), np.array(received)
        recorded[topic] = Recorded(*times, np.array(sequence), list(data))
    return recorded


class Cycles(NamedTuple):
    """Times [ns] of each cycle, from the machine's first one on."""

    received: np.ndarray  # its first frame, by the listener
    whole: np.ndarray  # its last frame
    sampled: np.ndarray  # by the machine's even clock: where the promptest frames around it lie


def cycles(bus: Bus, identifiers: tuple[int, ...]) -> Cycles:
    by_message = [bus.of(identifier) for identifier in identifiers]
    count = min(map(len, by_message))
    counters = np.array([[one.data[1] & 0xF for one in frames[:count]] for frames in by_message])
    assert (np.diff(counters) % 15 == 1).all(), "the listener itself has lost frames"
    assert (counters == counters[0]).all(), "frames of different cycles side by side"
    stamps = np.array([[one.stamp for one in frames[:count]] for frames in by_message])
    received, whole = stamps.min(axis=0), stamps.max(axis=0)
    due = CYCLE * np.arange(count)
    return Cycles(received, whole, due + minimum_filter1d(received - due, PROMPT))


def edge(after: int, cycles: np.ndarray, stamps: np.ndarray) -> int:
    """An instant [ns] between two cycles that nobody can take for one within either."""
    for earlier, later in pairwise(cycles[cycles >= after]):
        middle = (earlier + later) // 2
        if later - earlier > 4 * MILLISECOND and np.abs(stamps - middle).min() > MILLISECOND:
            return int(middle)
    raise AssertionError("no gap between the cycles")


class Way(NamedTuple):
    """Instants [ns] on the way of one cycle round the loop."""

    frame: int  # the first encoder frame, received by the listener on the bus
    whole: int  # the last frame that the driver waits for, received likewise
    state: int  # the joint state, published
    command: int  # the answer to it, published
    valves: int  # the first valve frame with that answer, received by the listener


def ways(bus: Bus, bag: dict[str, Recorded], window: tuple[int, int]) -> np.ndarray:
    """(n, 5) ways of cycles [ns], columns as in `Way`.

    A valve frame answers a command if it is the first to carry the command's values.
    """
    codec = MachineCodec(LAYOUT)
    sent: dict[tuple[float, ...], list[int]] = defaultdict(list)
    previous: tuple[float, ...] = ()
    for frame in bus.of(VALVES):
        readings = codec.decode(frame)
        assert readings
        values = spools(readings.commands)
        if values != previous and readings.enabled:
            sent[values].append(frame.stamp)
        previous = values
    encoders, both = cycles(bus, ENCODERS), cycles(bus, ENCODERS + PRESSURES)
    states, commands = bag["/joint_states"], bag["/valve_command"]
    published = dict(zip(states.stamp.tolist(), states.published.tolist(), strict=True))
    found = []
    for stamp, answer in answers(bag):
        if not (window[0] <= stamp < window[1] and stamp in published):
            continue
        message = deserialize_message(commands.data[answer], ValveCommand)
        values = spools(dict(zip(message.name, message.command, strict=True)))
        frames = np.array(sent[values])
        asked = encoders.received[np.abs(encoders.sampled - stamp).argmin()]
        whole = both.whole[np.abs(both.received - asked).argmin()]
        later = frames[(frames > asked) & (frames < asked + ANSWERED)]
        if later.size:  # else a newer command took its place before it was sent
            command = int(commands.published[answer])
            found.append(Way(int(asked), int(whole), published[stamp], command, int(later[0])))
    return np.array(found)


def answers(bag: dict[str, Recorded]) -> list[tuple[int, int]]:
    """Stamp [ns] of each joint state that was answered, and the number of the valve command.

    The trajectory node publishes a reference with the stamp of the state right after the command;
    the command of `live_controller.py` itself has the stamp of the state.
    """
    commands = bag["/valve_command"]
    if (references := bag.get("/joint_reference")) is None:
        return list(zip(commands.stamp.tolist(), range(len(commands.stamp)), strict=True))
    answer = np.searchsorted(commands.published, references.published, side="right") - 1
    return list(zip(references.stamp.tolist(), answer.tolist(), strict=True))


def spools(commands: Mapping[str, float]) -> tuple[float, ...]:
    """Raw values of valve commands, in the order of the valve frame; joints not named rest."""
    return tuple(one.raw(commands.get(one.name, 0.0)) for one in LAYOUT.commands[0].commands)


def percentiles(times: np.ndarray) -> str:
    p50, p99, p999 = np.percentile(times, [50, 99, 99.9])
    return f"p50 {p50:6.2f}  p99 {p99:6.2f}  p99.9 {p999:6.2f}  max {times.max():6.2f} ms"


def floor(bus: Bus, port: int, realtime: bool) -> np.ndarray:
    """The way round [ms] of python-can alone, beside the same processes."""
    program = [sys.executable, str(HERE / "live_floor.py"), *map(str, (port, ENCODERS[-1], ANSWER))]
    process = subprocess.Popen(program)
    if realtime:
        prefer(process.pid, CONTROLLER_PRIORITY)
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


class Cores(NamedTuple):
    """How many of them were busy on average, or their time [s] so far."""

    loop: float  # with this process, which listens
    others: float

    @classmethod
    def so_far(cls) -> Self:
        here = psutil.Process()
        own = [here, *here.children(recursive=True)]
        loop = sum(sum(one.cpu_times()[:2]) for one in own)
        whole = psutil.cpu_times()
        return cls(loop, sum(whole) - whole.idle - whole.iowait - loop)


class Loop(NamedTuple):
    """What was heard of a loop at work."""

    bus: Bus
    bag: dict[str, Recorded]
    window: tuple[int, int]  # ns, that is measured
    least: np.ndarray  # ms, the way round of python-can alone; (0,) where it was not asked for
    busy: Cores
    realtime: bool  # of machine and controller
    told: str


def reset(domain: int, folder: Path) -> None:
    """Reset the faults that nodes cause which start at once on a busy computer."""
    with graph(domain, folder) as watcher:
        driver = DriverClient(watcher.node)

        def disabled() -> bool:
            state = driver.state.state
            if state == DriverState.STATE_FAULT and driver.ready:
                watcher.wait(driver.reset_fault().done)
            return state == DriverState.STATE_DISABLED

        watcher.wait(disabled)


def measured_loop(
    folder: Path,
    seconds: float,
    beside: Sequence[tuple[object, ...]] = (),
    floored: bool = True,
    realtime: bool = False,
    seen: Callable[[str], AbstractContextManager[object]] = nullcontext,
) -> Loop:
    """A loop at work for so long, `beside` it further executables: package, name, arguments.

    `seen` is entered meanwhile, with what these have printed. `realtime`: machine and controller
    have it too, as docs/how_to/real_time.md says, where that is permitted.
    """
    port = free_port()
    bus = Bus(port)
    option = f"bus.options:=port={port}"
    bag = folder / "bag"
    started: list[Process] = []

    def start(package: str, name: str, *arguments: object) -> Process:
        started.append(Process(folder, package, name, *arguments))
        return started[-1]

    controller, preferred = None, False
    looking = ExitStack()
    try:
        crane = start("crane_sim", "simulated_crane", "--bus-option", f"port={port}")
        if realtime:
            prefer(crane.process.pid, MACHINE_PRIORITY)
        start("crane_driver", "driver", "--ros-args", "-p", option)
        recorder = start("crane_nodes", "recorder", "--out", bag)
        for package, name, *arguments in beside:
            further = start(str(package), str(name), *arguments)
            bus.until(lambda further=further: "ready: listens to" in further.output)
        looking.enter_context(seen("".join(one.output for one in started)))
        controller = subprocess.Popen(
            [sys.executable, str(HERE / "live_controller.py")], stdout=subprocess.PIPE, text=True
        )
        if realtime:
            preferred = prefer(controller.pid, CONTROLLER_PRIORITY)
        bus.until(lambda: all(f"recording {topic} " in recorder.output for topic in TOPICS))
        bus.until(lambda: any(sum(one.data[2:]) for one in bus.of(VALVES)))  # the loop is closed
        bus.listen(SETTLING)
        begin = time.time_ns() + int(MARGIN * 1e9)
        before, listened = Cores.so_far(), seconds + 2 * MARGIN
        bus.listen(listened)
        used = zip(Cores.so_far(), before, strict=True)
        busy = Cores(*((now - then) / listened for now, then in used))
        window = (begin, begin + int(seconds * 1e9))
        least = floor(bus, port, realtime) if floored else np.empty(0)
        controller.terminate()
        told = controller.communicate(timeout=PATIENCE)[0].strip()
    finally:
        looking.close()
        if controller and controller.poll() is None:
            controller.kill()
        for one in reversed(started):
            if one.running:
                one.end(signal.SIGTERM)
        bus.close()
    told = f"driver {told}; {crane.output.splitlines()[-1]}"
    return Loop(bus, read(bag), window, least, busy, preferred, told)
