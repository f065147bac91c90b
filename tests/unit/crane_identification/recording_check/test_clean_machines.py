"""Machines as they should be, with other parameters, friction, motions and noise: no suspicion.

Forty of them, with hidden effects of the whole catalogue, are in tests/benchmarks.
"""

import numpy as np
import pytest
from unit.crane_identification.recording_check.recorded import packaged_motion, recorded

from crane_identification import Log, Signal
from crane_identification.recording_check.check import check
from crane_identification.recording_check.forces import crane
from crane_model import Machine, load_machine
from crane_model.machine_files import machine_file
from crane_sim import InjectedEffect, SimulatedCrane, Spec, calibrate, load_simulated_crane
from crane_sim.parts.parameters import vary
from crane_trajectory.control.controller import load_gains

DYNAMIC = machine_file("simulated_crane_dynamic_friction.yaml")


@pytest.mark.parametrize(
    ("simulated", "trajectory"),
    [
        (vary(load_simulated_crane(), 1), "excitation_20s.yaml"),
        (vary(load_simulated_crane(), 2), "validation_20s.yaml"),
        (load_simulated_crane(DYNAMIC), "validation_20s.yaml"),
        (vary(load_simulated_crane(DYNAMIC), 3), "excitation_20s.yaml"),
    ],
)
def test_clean_machines_are_not_suspected(simulated: SimulatedCrane, trajectory: str) -> None:
    machine = load_machine()
    course = packaged_motion(machine, simulated.start, trajectory)
    seed = int(np.round(1e3 * simulated.friction["telescope"].f_c))
    found = check(machine, recorded(simulated, course, seed))
    assert not found.suspicions and not found.unchecked


def test_a_machine_of_another_kind_is_not_judged_as_a_crane_of_the_report() -> None:
    """Though its joints have the same names: it has a section of the telescope more."""
    found = check(load_machine("double_telescope_crane"), recorded())
    assert found.unchecked[-1].startswith("forces: no model of this machine is given")


def test_positions_and_pressures_of_any_machine_are_looked_at() -> None:
    """Degrees for radians, and bar for pascal, of joints that no other machine has."""
    excavator = load_machine("excavator")
    time = np.arange(0.0, 20.0, 0.005)
    swings = 0.4 * np.sin(time[:, np.newaxis] + np.arange(4.0))
    position = np.degrees(swings + (0.0, 0.3, -1.5, -0.9))
    pressure = Signal(time, 90.0 + 10.0 * swings, "made")
    joints = excavator.joint_names
    log = Log(
        *("made", joints, 0, Signal(time, position, "made")),
        pressure_a=pressure,
        pressure_b=pressure,
    )
    told = [str(suspicion) for suspicion in check(excavator, log).decisive]
    assert any("stick" in warning and "positions look like degrees" in warning for warning in told)
    assert any(
        "pressures of the bucket" in warning and "look like bar" in warning for warning in told
    )


def test_a_crane_of_the_report_may_name_its_joints_otherwise() -> None:
    names = ("column", "main", "jib", "extension")
    content = load_machine().model_dump(mode="json", exclude_none=True)
    for joint, name in zip(content["joints"], names, strict=True):
        joint["name"] = name
    model = crane(Machine.model_validate(content))
    assert model.joints == names[1:]
    assert [parameter.name for parameter in model.parameters][-4:] == [
        f"{what}.extension" for what in ("f_c", "df_c", "f_v", "df_v")
    ]


def with_effect(effect: str, joint: str | None, magnitude: dict[str, float]) -> Log:
    """A recording of a machine that hides it."""
    machine, simulated = load_machine(), load_simulated_crane()
    course = packaged_motion(machine, simulated.start)
    hidden = InjectedEffect(effect=effect, joint=joint, parameters=magnitude)
    effects = calibrate(
        Spec(effects=(hidden,)),
        machine,
        simulated,
        course,
        load_gains(machine_file("controller.yaml"), machine),
    )
    return recorded(simulated, course, 4, effects)


@pytest.mark.parametrize(
    ("effect", "joint", "magnitude"),
    [("load_friction", "outer_boom", {"mu": 0.04}), ("base_tilt", None, {"angle": 0.04})],
)
def test_an_effect_that_the_model_lacks_is_no_wrong_wiring(
    effect: str, joint: str | None, magnitude: dict[str, float]
) -> None:
    assert not check(load_machine(), with_effect(effect, joint, magnitude)).suspicions


def test_a_heavy_load_is_a_load_and_no_wrong_unit() -> None:
    (found,) = check(load_machine(), with_effect("payload", None, {"mass": 130.0})).suspicions
    assert not found.decisive and found.cause.startswith("a load")
