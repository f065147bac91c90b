"""`simulated_crane`: the stand-in machine in real time on a CAN bus, in the place of the real one.

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
from pathlib import Path
from types import FrameType

from crane_driver.can.binding import load_layout
from crane_driver.can.bus import BusError
from crane_driver.can.link import Link
from crane_driver.can.options import bus_settings
from crane_model import cli
from crane_model.arguments import whole
from crane_model.machine_files import machine_file
from crane_model.model_file import load_model
from crane_sim.bus.machine_on_bus import MachineOnBus
from crane_sim.bus.operator_at_machine import Operator
from crane_sim.bus.pace import PlantPace
from crane_sim.faulty.faults import Faults
from crane_sim.options import add_faults, add_plant, load_both
from crane_sim.parts.pose import parse_pose
from crane_sim.plant.machine_in_motion import MachineInMotion
from crane_sim.plant.plant import Plant
from crane_sim.plant.sampled import Sensors
from crane_sim.plant.twin_plant import TwinPlant

SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


def main(argv: Sequence[str] | None = None) -> int:
    """Simulate the crane on a CAN bus in real time until Ctrl-C."""
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
    with Link(settings) as link:
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
        start = time.monotonic()
        crane = MachineOnBus(layout, plant, sensors, start, operator)
        pace = PlantPace(crane.period, start)
        crane.run(pace.due)
        print(f"ready: simulated crane on {settings}, every {crane.period * 1e3:g} ms", flush=True)
        shown = crane.valves.state
        while not stop.wait(pace.pause(time.monotonic())):
            for frame in crane.exchange(link.take()):
                with suppress(BusError):  # the link reports a lost bus, and reopens it
                    link.send(frame)
            for fault in link.take_faults():
                print(fault, file=sys.stderr, flush=True)
            if crane.valves.state is not shown:
                shown = crane.valves.state
                print(f"valves: {shown}", flush=True)
            if report := pace.next(time.monotonic()):
                print(report, file=sys.stderr, flush=True)
            crane.run(pace.due)  # until the next readings, while nobody waits for them
        print(pace.summary(crane.lost), flush=True)


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
    add_faults(parser)
    parser.add_argument("--seed", type=whole(0), default=0, help="of the sensors' noise")
    return parser
