"""The hydraulics of a motor, whose chambers stay as large as they are: the excavator's swing."""

import numpy as np
import pytest

from crane_identification import Log, Signal
from crane_identification.hydraulics.joint_estimate import ASSUMED_MODULUS, identify_hydraulics
from crane_model import Model
from crane_model.hydraulics import JointHydraulics
from crane_model.machine_files import machine_file
from crane_model.terms.term import Setting
from crane_sim import Plant, Sensors, SimulatedRecording, record
from crane_sim.parts.parameters import load_both
from crane_trajectory import load_clearance, load_trajectory, plan
from crane_trajectory.control.controller import load_gains

NAME, SWING, BOOM = "excavator", "swing", "boom"
MACHINE, STAND_IN = load_both(NAME, None)


@pytest.fixture(scope="module")
def seen() -> SimulatedRecording:
    """A period of the packaged excitation."""
    motion = plan(
        MACHINE,
        load_trajectory(machine_file("excitation_20s.yaml", NAME)),
        STAND_IN.start,
        1,
        load_clearance(machine_file("clearance.yaml", NAME)),
    )
    gains = load_gains(machine_file("controller.yaml", NAME), MACHINE)
    sensors = Sensors(STAND_IN.sensors, MACHINE, 3)
    return record(motion, Plant(STAND_IN, MACHINE, motion.start), sensors, gains)


def found(seen: SimulatedRecording, *joints: str) -> dict[str, JointHydraulics]:
    """Of a model with these joints alone."""
    columns, time = [MACHINE.index(joint) for joint in joints], seen.time - seen.time[0]

    def signal(values: np.ndarray) -> Signal:
        return Signal(time, values[:, columns] if values.ndim > 1 else values, "made")

    pressures = seen.pressures
    log = Log(
        source="made",
        joints=joints,
        start=0,
        position=signal(seen.position),
        pressure_a=signal(pressures.chamber_a),
        pressure_b=signal(pressures.chamber_b),
        supply_pressure=signal(pressures.supply),
        tank_pressure=signal(pressures.tank),
        command=signal(seen.command),
    )
    units = {joint: MACHINE.units[joint] for joint in joints}
    values = identify_hydraulics(Model("made", Setting(units, MACHINE), ()), [log])
    assert values is not None and not set(joints) & set(values.unknown)
    return dict(values.joints)


def test_it_has_the_oil_of_the_cylinders(seen: SimulatedRecording) -> None:
    joints = found(seen, SWING, BOOM)
    assert list(joints) == [SWING, BOOM]
    swing, boom = joints[SWING].chambers, joints[BOOM].chambers
    assert swing is not None and boom is not None
    assert boom.bulk_modulus.value == pytest.approx(STAND_IN.oil.bulk_modulus, rel=0.02)
    assert swing.bulk_modulus.value == boom.bulk_modulus.value
    assert swing.bulk_modulus.std_dev is None  # taken over, not measured
    inside = STAND_IN.cylinders[SWING]
    assert swing.dead_volume_a.value == pytest.approx(inside.dead_volume_a, rel=0.1)
    assert swing.leakage.value == pytest.approx(inside.leakage, rel=0.02)
    assert joints[SWING].unexplained < 0.01


def test_alone_it_tells_no_more_than_volume_over_modulus(seen: SimulatedRecording) -> None:
    swing = found(seen, SWING)[SWING].chambers
    assert swing is not None
    assert swing.bulk_modulus.value == ASSUMED_MODULUS
    true = STAND_IN.cylinders[SWING].dead_volume_a / STAND_IN.oil.bulk_modulus
    assert swing.dead_volume_a.value / ASSUMED_MODULUS == pytest.approx(true, rel=0.1)
