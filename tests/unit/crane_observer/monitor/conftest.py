"""Machines, days and tolerances of the tests of the monitor; made once for all of them."""

from dataclasses import replace

import pytest
from unit.crane_observer.monitor.at_work import Heard, as_built

from crane_model import Model, load_machine, load_model
from crane_model.machine_files import machine_file
from crane_observer import SensorWatch, learn
from crane_observer.monitor.tolerance import (
    TOLERANCE_FIELDS,
    JointTolerance,
    Tolerance,
    of_block,
    summed,
)
from crane_sim import Plant, Sensors, load_simulated_crane, record
from crane_trajectory import load_clearance, load_trajectory, plan
from crane_trajectory.control.controller import load_gains


@pytest.fixture(scope="module")
def model() -> Model:
    simulated, machine = load_simulated_crane(), load_machine()
    bare = load_model(machine_file("model.yaml"))
    known = as_built(simulated)
    joints = {joint: known.joints[joint] for joint in bare.joints}
    assert bare.machine is not None and bare.machine.name == machine.name
    return replace(bare, hydraulics=known.model_copy(update={"joints": joints}))


@pytest.fixture(scope="module")
def days(model: Model) -> tuple[Heard, Heard]:
    """Half a minute of work, as the same sensors show it on two days: noise alone differs."""
    machine, simulated = load_machine(), load_simulated_crane()
    motion = plan(
        machine,
        load_trajectory(machine_file("excitation_20s.yaml")),
        simulated.start,
        1,
        load_clearance(machine_file("clearance.yaml")),
    )
    gains = load_gains(machine_file("controller.yaml"), machine)
    sensors = Sensors(simulated.sensors, machine, 3)
    seen = record(motion, Plant(simulated, machine, motion.start), sensors, gains)
    columns, true = [machine.index(joint) for joint in model.joints], seen.truth
    tank = machine.hydraulics.tank_pressure
    supply = seen.pressures.supply
    again = Sensors(simulated.sensors, machine, 4).pressures(
        true.pressure_a, true.pressure_b, supply, tank
    )
    first, second = (
        Heard(seen.time, seen.position[:, columns], shown.chamber_a, shown.chamber_b, supply,
              seen.command[:, columns])
        for shown in (seen.pressures, again)
    )  # fmt: skip
    return first, second


@pytest.fixture(scope="module")
def healthy(days: tuple[Heard, Heard]) -> Heard:
    return days[1]


@pytest.fixture(scope="module")
def tolerance(model: Model, days: tuple[Heard, Heard]) -> Tolerance:
    watched = SensorWatch(model)
    taken = [watched.monitor.take_block() for _ in days[0].into(watched)]
    blocks = [block for block in taken if block is not None]
    sums = summed([block.time for block in blocks], [of_block(block) for block in blocks])
    return learn(model.joints, [sums] * 2, "the day before")


@pytest.fixture(scope="module")
def untrimmed(tolerance: Tolerance) -> Tolerance:
    """Nothing is taken off: half a minute tells nothing of leaks, and the model is as built."""
    joints = {
        joint: JointTolerance(**{name: getattr(joint_tolerance, name) for name in TOLERANCE_FIELDS})
        for joint, joint_tolerance in tolerance.joints.items()
    }
    return tolerance.model_copy(update={"joints": joints})
