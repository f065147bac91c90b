"""`ros2 run crane_driver bringup STEP`: guided measurement of what is not known of a new crane."""

import argparse
import sys
from collections.abc import Callable, Sequence
from pathlib import Path

from crane_driver.can.bus import bus_settings, may_leave_computer
from crane_driver.can.mapping import Mapping
from crane_driver.driver_parameters import (
    BITRATE,
    CHANNEL,
    DBC,
    INTERFACE,
    MAPPING,
    OPTIONS,
    driver_parameters,
)
from crane_driver.operator.bringup.bench import (
    Bench,
    BringupRequest,
    BringupTerminal,
    Parameters,
    driver_command,
    next_command,
)
from crane_driver.operator.bringup.crane_client import CraneClient
from crane_driver.operator.bringup.rehearsed import ask_for_rehearsal
from crane_driver.operator.bringup.results import (
    CONTROLLER_FILE,
    MAPPING_FILE,
    RESULT_FILE,
    STEPS,
    Series,
)
from crane_model.cli import between, command_line, run
from crane_model.configuration import load
from crane_model.errors import ConfigurationError
from crane_model.machine import load_machine
from crane_model.machine_files import machine_file
from crane_nodes.joint_notes import load_joint_notes
from crane_nodes.managed import own_arguments, ros, ros_arguments
from crane_nodes.parameters import MACHINE, NodeParameter, Switch

USE_SIM_TIME = Switch("use_sim_time", False, "run on simulated time")  # of every node
ORDER_OF_STEPS = """\
The steps, in this order, each with the driver running:
  status     what has been done
  encoders   zero and sign of each encoder, while you move the joints by hand
  pressures  offset of each pressure transducer, engine off and chambers vented
  valves     polarity of each valve
  dead_band  dead band of each valve in both directions
  gains      first gains of the PD controller
The last three move the crane, and give up only when a joint has moved by --travel: 0.2 rad are 1 m
at the tip of a crane that reaches 5 m. Begin with --travel 0.05 --speed 0.02, the arm retracted.
Each asks before anything moves, and writes a picture and YAML files into a new folder of --out.
Questions are answered on the terminal; in a rehearsal on the simulated crane, but never on a real
one, they may be answered by a file: bringup STEP --out FOLDER < answers.
"""


def main(argv: Sequence[str] | None = None) -> int:
    """Run one step of the bring-up."""
    argv = sys.argv[1:] if argv is None else argv
    request = BringupRequest(**vars(command_parser().parse_args(own_arguments(argv))))
    if request.step == "status":
        return run(lambda: _status(Series(request.out)))
    return run(lambda: _measure(argv, request))


def _measure(argv: Sequence[str], request: BringupRequest) -> None:
    # Imported here: they take a second, and --help needs none of them.
    from crane_driver.can.binding import load_layout
    from crane_driver.operator.bringup.steps import dead_band, encoders, gains, pressures, valves

    with ros(argv) as stop:
        crane = CraneClient(stop)
        crane.connect()
        series = Series(request.out)
        name = crane.parameters([MACHINE.name])[MACHINE.name]
        machine = load_machine(name)
        driver = _parameters(crane, (*driver_parameters(machine, name), USE_SIM_TIME))
        mapping = _mapping(request.mapping or series.newest(MAPPING_FILE), driver)
        terminal = BringupTerminal(stop, crane.spin)
        bus = bus_settings(
            str(driver[INTERFACE]),
            str(driver[CHANNEL]),
            int(driver[BITRATE]),
            str(driver[OPTIONS]).split(),
        )
        if may_leave_computer(bus):
            ask_for_rehearsal(terminal, request.rehearsal, name)
        bench = Bench(
            crane=crane,
            terminal=terminal,
            series=series,
            mapping=mapping,
            driver=driver,
            positions=load(mapping, Mapping).positions,
            layout=load_layout(machine, mapping, machine_file("can.dbc", name, str(driver[DBC]))),
            units=machine.units,
            notes=load_joint_notes(machine_file("joints.yaml", name), machine.units),
            joints=_joints(request.joints, crane.joints),
            protocol=request,
        )
        steps: dict[str, Callable[[Bench], None]] = {
            "encoders": encoders,
            "pressures": pressures,
            "valves": valves,
            "dead_band": dead_band,
            "gains": lambda bench: gains(
                bench, machine_file(CONTROLLER_FILE, name, request.controller)
            ),
        }
        steps[request.step](bench)
        if command := next_command(command_parser(), request, ros_arguments(argv)):
            bench.terminal.say(f"the next step, in the order of the manual:\n  {command}")


def _parameters(crane: CraneClient, parameters: Sequence[NodeParameter]) -> Parameters:
    values = crane.parameters([parameter.name for parameter in parameters])
    return {parameter: values[parameter.name] for parameter in parameters}


def _mapping(expected: Path | None, driver: Parameters) -> Path:
    """The mapping of the driver; what is measured corrects that one and no other."""
    used = machine_file("can.yaml", str(driver[MACHINE]), str(driver[MAPPING]))
    if expected and expected.resolve() != used.resolve():
        raise ConfigurationError(
            f"the driver runs with the mapping {used}, but the one to go on from is {expected}; "
            f"name its own with --mapping, or restart the driver:\n"
            f"  {driver_command(driver, expected)}"
        )
    return used


def _joints(asked: Sequence[str], there: Sequence[str]) -> tuple[str, ...]:
    if absent := [joint for joint in asked if joint not in there]:
        raise ConfigurationError(
            f"--joints {' '.join(absent)}: the driver has the joints {', '.join(there)}"
        )
    return tuple(joint for joint in there if joint in asked or not asked)


def _status(series: Series) -> None:
    for path in series.runs:
        print(f"{path}: {', '.join(sorted(file.name for file in path.iterdir()))}")
    done = [step for step in STEPS if series.newest(RESULT_FILE, step)]
    missing = [step for step in STEPS if step not in done]
    print(f"done: {', '.join(done) or 'nothing'}; to be done: {', '.join(missing) or 'nothing'}")
    if mapping := series.newest(MAPPING_FILE):
        print(f"newest mapping, for the driver: {mapping}")


def command_parser() -> argparse.ArgumentParser:
    """The options of all steps."""
    parser = command_line(
        prog="bringup",
        description="Guided measurement on a new crane, step by step.",
        epilog=ORDER_OF_STEPS,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("step", choices=("status", *STEPS))
    parser.add_argument(
        "--out", type=Path, required=True, metavar="FOLDER", help="folder of this bring-up"
    )
    parser.add_argument(
        "--mapping",
        type=Path,
        help="mapping with which the driver runs (default: the newest in FOLDER, at "
        "first that of the driver)",
    )
    parser.add_argument(
        "--rehearsal",
        type=Path,
        default=Path("runs/rehearsal"),
        metavar="FOLDER",
        help="folder of a rehearsal with the same files, required on a real bus "
        "(default: runs/rehearsal)",
    )
    parser.add_argument(
        "--joints",
        nargs="+",
        default=[],
        metavar="JOINT",
        help="joints to measure (default: all of the driver)",
    )
    parser.add_argument(
        "--controller",
        type=Path,
        help="gains: controller file with the initial gains (default: that of the "
        "driver's machine)",
    )
    for name, default, low, high, text in (
        ("seconds", 2.0, 0.2, 60.0, "duration of a measurement at rest [s]"),
        ("rate", 0.05, 0.001, 0.5, "rate of the command in valves and dead_band [1/s]"),
        ("speed", 0.04, 0.001, 0.5, "speed of the joint in dead_band and gains [rad/s, m/s]"),
        ("limit", 0.25, 0.01, 1.0, "largest command [-]"),
        ("travel", 0.2, 0.001, 2.0, "largest displacement of a joint [rad, m]"),
        ("time-constant", 0.2, 0.01, 10.0, "gains: smallest time constant of the closed loop [s]"),
    ):
        parser.add_argument(
            f"--{name}",
            type=between(low, high),
            default=default,
            help=f"{text} (default: {default:g})",
        )
    parser.add_argument(
        "--repeats", type=int, choices=range(1, 21), default=3, metavar="N",
        help="dead_band: number of ramps in each direction (default: 3)",
    )  # fmt: skip
    return parser
