"""Options that the commands of the simulated crane share."""

import argparse
from pathlib import Path

from crane_model.machine import Machine, load_machine
from crane_model.machine_files import machine_file
from crane_sim.parts.parameters import JOINTS_FILE, SimulatedCrane, load_simulated_crane


def add_plant(parser: argparse.ArgumentParser) -> None:
    """`--plant`, the file of the simulated crane."""
    parser.add_argument(
        "--plant", type=Path, help="file of the simulated crane (default: that of the machine)"
    )


def add_faults(parser: argparse.ArgumentParser) -> None:
    """`--fault`, once for each."""
    parser.add_argument(
        "--fault",
        action="append",
        default=[],
        metavar="TARGET.PART.KIND[=SIZE][@SECONDS]",
        help="a sensor or valve that fails, as JOINT.encoder.stuck@12.5, seconds after the "
        "beginning; may be repeated. Of a joint: encoder, pressure_a, pressure_b, pressures, "
        "valve; of the supply: supply.pressure. A wrong one is answered with what there is",
    )


def load_both(machine: str | None, plant: Path | None) -> tuple[Machine, SimulatedCrane]:
    """What `--machine` and `--plant` name; `ConfigurationError` if either is wrong."""
    known = load_machine(machine)
    joints = machine_file("machine.yaml", machine).with_name(JOINTS_FILE)
    return known, load_simulated_crane(
        machine_file("simulated_crane.yaml", machine, plant), known, joints
    )
