"""`simulated_crane`: a crane on a CAN bus, in real time or in lock-step with its driver.

It has a plain command line and no ROS: it stands for a machine, which has none either; all that it
shares with the driver is the bus.
"""

import argparse
import signal
import sys
import threading
import time
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from types import FrameType

from crane_bags.clocks import NANOSECONDS
from crane_driver.can.binding import load_layout
from crane_driver.can.bus import BusError, bus_settings, check_private
from crane_driver.can.frame import START_NS, STEP, Frame, time_frame, told_time
from crane_driver.can.link import Link
from crane_model import cli
from crane_model.cli import whole
from crane_model.machine import parse_pose
from crane_model.machine_files import machine_file
from crane_model.model_file import load_model
from crane_nodes.this_computer import PATIENCE_S, RealTime, RealTimeSettings
from crane_sim.machine_on_bus import MachineOnBus, Operator
from crane_sim.parts.parameters import add_plant, add_running, load_both
from crane_sim.plant.closed_loop import IdentifiedPlant
from crane_sim.plant.plant import Plant
from crane_sim.plant.sampled import MachineInMotion, Sensors
from crane_sim.sensor_faults import Faults, add_faults

REPORT_S = 1.0  # at least between two reports
MAX_BACKLOG_CYCLES = 10  # that are run one upon the other after a delay


class PlantPace:
    """Cycles of `period` [s] from `start` [s, steady] on.

    After a delay up to `MAX_BACKLOG_CYCLES` cycles are made up for, each at once; after a longer
    one all that fell into it are left out: late frames are of no use, and a burst of them looks
    like a fault.
    """

    def __init__(self, period: float, start: float):
        self._period = period
        self.due = start + period  # s, steady, when the next cycle is
        self._reported = start
        self.cycles = self.left_out = 0
        self.longest = 0.0  # s, delay
        self._new = 0  # left out since the last report
        self._new_longest = 0.0

    def pause(self, now: float) -> float:
        """Time until the next cycle [s]; 0 where it is overdue."""
        return max(0.0, self.due - now)

    def next(self, now: float) -> str | None:
        """End a cycle at `now`; what is to be reported, if anything."""
        self.cycles += 1
        self.due += self._period
        delay = now - self.due
        self.longest = max(self.longest, delay)
        if delay > MAX_BACKLOG_CYCLES * self._period:
            missed = int(delay / self._period) + 1
            self.due += missed * self._period
            self.left_out += missed
            self._new += missed
            self._new_longest = max(self._new_longest, delay)
        if not self._new or now - self._reported < REPORT_S:
            return None
        report = (
            f"not in real time: {self._new} cycles of {self._period * 1e3:g} ms left out, longest "
            f"delay {self._new_longest * 1e3:.0f} ms; the machine is too slow or too busy"
        )
        self._reported, self._new, self._new_longest = now, 0, 0.0
        return report

    def summary(self, lost: float) -> str:
        """How it went; `lost` [s] is time in which the plant stood still."""
        total = self.cycles + self.left_out
        return (
            f"{self.cycles} cycles, {self.left_out} of {total} left out, longest delay "
            f"{self.longest * 1e3:.0f} ms, {lost:.2f} s lost"
        )


REPEAT_S = 0.1  # of real time, after which the frames of a cycle are sent again
REMARK_S = 5.0  # of real time, for which the driver is waited for without a word


def send(link: Link, frames: Sequence[Frame]) -> None:
    """Send what can be sent: the link reports a lost bus, and reopens it."""
    for frame in frames:
        with suppress(BusError):
            link.send(frame)


class LockStep:
    """Cycles of `period` [s] on simulated time, each begun when the driver has answered the last.

    A driver that has answered before and does not for `PATIENCE_S` is taken to be dead: time goes
    on as in reality, and the valves close as they do when commands stop.
    """

    def __init__(self, link: Link, woken: threading.Event, period: float):
        """`link` sets `woken` at each answer of the driver."""
        self._link, self._woken, self._period = link, woken, round(period * NANOSECONDS)
        self._begun = time.monotonic()
        self._driven = False  # whether there is a driver, as far as it is known
        self._dead = False
        self.time = START_NS  # of the cycle [ns]
        self.answer: list[Frame] = []  # frames that came for it

    @property
    def after(self) -> float:
        """Time of the next cycle [s]."""
        return (self.time + self._period) / NANOSECONDS

    def wait(self, stop: threading.Event, sent: Sequence[Frame]) -> None:
        """Wait until the driver has answered the cycle, and begin the next one.

        Meanwhile the frames that were `sent` are repeated for a driver that has just begun.
        """
        begun, remarked = time.monotonic(), False
        frames: list[Frame] = []
        while not stop.is_set():
            self._woken.wait(self._period / NANOSECONDS if self._dead else REPEAT_S)
            self._woken.clear()
            new = self._link.take()
            frames += new
            if answers := {told_time(frame, STEP) for frame in new} - {None}:
                self._driven, self._dead, begun = True, False, time.monotonic()  # it is there
            if self.time in answers:
                break
            waited = time.monotonic() - begun
            if self._dead or (self._driven and waited > PATIENCE_S):
                self._dead = True
                break
            if waited > REMARK_S and not (remarked or self._driven):
                remarked = True
                print("waiting for a driver with use_sim_time:=true", file=sys.stderr, flush=True)
            send(self._link, sent)
        now = self.time / NANOSECONDS
        self.answer = [frame._replace(stamp=self.time, steady=now) for frame in frames]
        self.time += self._period

    @property
    def summary(self) -> str:
        simulated = (self.time - START_NS) / NANOSECONDS
        real = time.monotonic() - self._begun
        return f"{simulated:.1f} s of simulated time in {real:.1f} s"


@dataclass(frozen=True)
class _Request:
    interface: str
    channel: str
    bitrate: int  # bit/s
    bus_option: Sequence[str]
    mapping: Path | None
    dbc: Path | None
    machine: str | None
    plant: Path | None
    running: float  # s
    model: Path | None
    pose: Sequence[str]
    operator: bool
    lock_step: bool
    priority: int
    fault: Sequence[str]
    seed: int


SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


def main(argv: Sequence[str] | None = None) -> int:
    """Simulate the crane on a CAN bus until Ctrl-C, in real time or on simulated time."""
    options = _Request(**vars(_parser().parse_args(argv)))
    stop = threading.Event()

    def request(_number: int, _frame: FrameType | None) -> None:
        stop.set()

    previous = {number: signal.signal(number, request) for number in SIGNALS}
    try:
        return cli.run(lambda: _run(options, stop))
    finally:
        for number, handler in previous.items():
            signal.signal(number, handler)


def _run(options: _Request, stop: threading.Event) -> None:
    settings = bus_settings(options.interface, options.channel, options.bitrate, options.bus_option)
    machine, parameters = load_both(options.machine, options.plant)
    layout = load_layout(
        machine,
        machine_file("can.yaml", options.machine, options.mapping),
        machine_file("can.dbc", options.machine, options.dbc),
    )
    pose = parse_pose(options.pose, machine, parameters.start)
    plant: MachineInMotion
    if options.model:
        plant = identified = IdentifiedPlant(load_model(options.model), machine, pose)
        print(f"the identified simulation of {options.model}" + _standing(identified), flush=True)
    else:
        plant = Plant(parameters, machine, pose, running=options.running)
    timed = Faults(machine, options.fault, options.seed, leaks=not options.model)
    sensors = Sensors(parameters.sensors, machine, options.seed, timed=timed)
    if options.lock_step:
        check_private(settings)
    woken = threading.Event()
    with Link(settings, woken.set, cycle=frozenset({STEP})) as link:
        # Compiled here, not while the clock runs: the first steps may take seconds.
        warm = MachineOnBus(layout, plant, Sensors(parameters.sensors, machine, 0), 0.0)
        warm.run(parameters.step)
        warm.exchange([])
        link.take()
        operator = Operator(machine.joint_names, timed)
        if options.operator:
            threading.Thread(
                target=operator.follow, args=(sys.stdin, sys.stderr), daemon=True
            ).start()
        start = START_NS / NANOSECONDS if options.lock_step else time.monotonic()
        crane = MachineOnBus(layout, plant, sensors, start, operator)
        every = f"every {crane.period * 1e3:g} ms"
        if options.lock_step:
            print(f"ready: simulated crane on {settings}, {every} of simulated time", flush=True)
            _in_lock_step(crane, link, LockStep(link, woken, crane.period), stop)
        else:
            realtime = RealTime(RealTimeSettings(options.priority, lock_memory=False)).begin()
            for refused in realtime.refused:
                print(f"real time: no {refused}", file=sys.stderr, flush=True)
            print(f"ready: simulated crane on {settings}, {every}", flush=True)
            _in_real_time(crane, link, PlantPace(crane.period, start), stop)


def _in_real_time(crane: MachineOnBus, link: Link, pace: PlantPace, stop: threading.Event) -> None:
    crane.run(pace.due)
    shown = crane.valves.state
    while not stop.wait(pace.pause(time.monotonic())):
        send(link, crane.exchange(link.take()))
        shown = _tell(crane, link, shown)
        if report := pace.next(time.monotonic()):
            print(report, file=sys.stderr, flush=True)
        crane.run(pace.due)  # until the next readings, while nobody waits for them
    print(pace.summary(crane.lost), flush=True)


def _in_lock_step(crane: MachineOnBus, link: Link, pace: LockStep, stop: threading.Event) -> None:
    """The same, but every cycle begins when the driver has answered the one before."""
    shown = crane.valves.state
    while not stop.is_set():
        frames = [*crane.exchange(pace.answer), time_frame(pace.time)]
        send(link, frames)
        shown = _tell(crane, link, shown)
        crane.run(pace.after)  # until the next readings, while the driver works
        pace.wait(stop, frames)
    print(pace.summary, flush=True)


def _tell(crane: MachineOnBus, link: Link, shown: str) -> str:
    """Print what is new; return the state of the valves."""
    for fault in link.take_faults():
        print(fault, file=sys.stderr, flush=True)
    if crane.valves.state is not shown:
        print(f"valves: {crane.valves.state}", flush=True)
    return crane.valves.state


def _standing(plant: IdentifiedPlant) -> str:
    if not plant.standing:
        return ""
    return f"; its model lacks {', '.join(plant.standing)}, which will not move"


def _parser() -> argparse.ArgumentParser:
    parser = cli.command_line(description=main.__doc__)
    parser.add_argument(
        "--interface",
        default="udp_multicast",
        help="interface of python-can (default: %(default)s)",
    )
    parser.add_argument("--channel", default="", help="channel of the interface, for example can0")
    parser.add_argument(
        "--bitrate", type=int, default=0, help="bit rate [bit/s] (default: that of the interface)"
    )
    parser.add_argument(
        "--bus-option",
        action="append",
        default=[],
        metavar="KEY=VALUE",
        help="further option of the interface, for example port=43113; may be repeated",
    )
    parser.add_argument(
        "--mapping", type=Path, help="mapping (YAML; default: can.yaml of the machine)"
    )
    parser.add_argument("--dbc", type=Path, help="DBC file (default: can.dbc of the machine)")
    cli.add_machine(parser)
    add_plant(parser)
    add_running(parser)
    parser.add_argument(
        "--model",
        type=Path,
        metavar="FILE",
        help="model file with identified hydraulics, to simulate in place of the plant"
        " file; sensors and rest pose remain those of the plant file",
    )
    parser.add_argument(
        "--pose",
        nargs="+",
        default=[],
        metavar="JOINT=VALUE",
        help="initial positions [rad, m] (default: the rest pose)",
    )
    parser.add_argument(
        "--operator",
        action="store_true",
        help="read actions of an operator from standard input: JOINT=OPENING moves a "
        "lever (-1 to 1, positive moves the joint up), engine=off, engine=on, "
        "fault=TARGET.PART.KIND, repaired=TARGET.PART",
    )
    parser.add_argument(
        "--lock-step",
        action="store_true",
        help="run in simulated time: each cycle waits for a driver with use_sim_time",
    )
    parser.add_argument(
        "--priority",
        type=whole(0),
        default=0,
        help="real-time priority (SCHED_FIFO), 0 for none (default: 0)",
    )
    add_faults(parser)
    parser.add_argument(
        "--seed", type=whole(0), default=0, help="seed of sensor noise (default: 0)"
    )
    return parser
