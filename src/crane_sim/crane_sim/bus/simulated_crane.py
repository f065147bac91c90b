"""`simulated_crane`: the stand-in machine on a CAN bus, in the place of the real one.

It has a plain command line and no ROS: it stands for a machine, which has none either; all that it
shares with the driver is the bus.
"""

import argparse
import signal
import sys
import threading
import time
from collections.abc import Sequence
from pathlib import Path
from types import FrameType

from crane_bags.clocks import NANOSECONDS
from crane_driver.can.binding import load_layout
from crane_driver.can.bus import bus_settings
from crane_driver.can.link import Link
from crane_driver.can.simulated_time import START_NS, STEP, check_private, time_frame
from crane_model import cli
from crane_model.cli import whole
from crane_model.machine_files import machine_file
from crane_model.model_file import load_model
from crane_nodes.scheduling import RealTime, RealTimeSettings
from crane_sim.bus.machine_on_bus import MachineOnBus, Operator
from crane_sim.bus.pace import LockStep, PlantPace, send
from crane_sim.make_bag import add_faults, add_plant, load_both
from crane_sim.parts.pose import parse_pose
from crane_sim.plant.closed_loop import TwinPlant
from crane_sim.plant.plant import Plant
from crane_sim.plant.sampled import MachineInMotion, Sensors
from crane_sim.sensor_faults import Faults

SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


def main(argv: Sequence[str] | None = None) -> int:
    """Simulate the crane on a CAN bus until Ctrl-C, in real time or on simulated time."""
    options = _parser().parse_args(argv)
    stop = threading.Event()

    def request(_number: int, _frame: FrameType | None) -> None:
        stop.set()

    previous = {number: signal.signal(number, request) for number in SIGNALS}
    try:
        return cli.run(lambda: _run(options, stop))
    finally:
        for number, handler in previous.items():
            signal.signal(number, handler)


def _run(options: argparse.Namespace, stop: threading.Event) -> None:
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
        plant = twin = TwinPlant(load_model(options.model), machine, pose)
        print(f"the twin of {options.model}" + _standing(twin), flush=True)
    else:
        plant = Plant(parameters, machine, pose)
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


def _standing(twin: TwinPlant) -> str:
    if not twin.standing:
        return ""
    return f"; its model lacks {', '.join(twin.standing)}, which will not move"


def _parser() -> argparse.ArgumentParser:
    parser = cli.command_line(description=main.__doc__)
    parser.add_argument(
        "--interface", default="udp_multicast", help="of python-can (default: %(default)s)"
    )
    parser.add_argument("--channel", default="", help="of the interface, for example can0")
    parser.add_argument("--bitrate", type=int, default=0, help="bit/s (default: as it is set)")
    parser.add_argument(
        "--bus-option",
        action="append",
        default=[],
        metavar="KEY=VALUE",
        help="further option of the interface, for example port=43113; may be repeated",
    )
    parser.add_argument("--mapping", type=Path, help="mapping YAML (default: the packaged one)")
    parser.add_argument("--dbc", type=Path, help="DBC file (default: the packaged one)")
    cli.add_machine(parser)
    add_plant(parser)
    parser.add_argument(
        "--model",
        type=Path,
        metavar="FILE",
        help="model file with identified hydraulics: the twin of that crane moves, in place of the "
        "stand-in's plant; sensors and rest pose stay those of the stand-in",
    )
    parser.add_argument(
        "--pose",
        nargs="+",
        default=[],
        metavar="JOINT=VALUE",
        help="where joints stand at the start [rad, m] (default: the rest pose of the stand-in)",
    )
    parser.add_argument(
        "--operator",
        action="store_true",
        help="take from standard input what an operator does at the machine: JOINT=OPENING moves "
        "a lever (positive moves the joint up, 0 lets go), engine=off and engine=on, "
        "fault=TARGET.PART.KIND as of --fault, from now on, and mended=TARGET.PART",
    )
    parser.add_argument(
        "--lock-step",
        action="store_true",
        help="run on simulated time: each cycle waits for a driver with use_sim_time, so that "
        "nothing is late on a busy computer",
    )
    parser.add_argument(
        "--priority",
        type=whole(0),
        default=0,
        help="real-time priority (SCHED_FIFO) while it runs in real time, 0 for none (default: 0)",
    )
    add_faults(parser)
    parser.add_argument("--seed", type=whole(0), default=0, help="of the sensors' noise")
    return parser
