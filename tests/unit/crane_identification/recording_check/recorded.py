"""A recording of the simulated crane as a log, without a bag."""

from collections.abc import Sequence

import numpy as np
from laboratory_crane import JOINTS, PLANAR_JOINTS

from crane_identification import Log, Signal
from crane_model import Machine, load_machine
from crane_model.machine_files import machine_file
from crane_sim import (
    Plant,
    Sensors,
    SimulatedCrane,
    SimulatedRecording,
    load_simulated_crane,
    record,
)
from crane_sim.calibration import slewing
from crane_sim.effects.form import InjectedForm
from crane_sim.effects.sensing import faults
from crane_sim.plant.closed_loop import Course
from crane_trajectory import load_clearance, load_trajectory, plan
from crane_trajectory.control.controller import load_gains


def packaged_motion(
    machine: Machine, start: np.ndarray, name: str = "excitation_20s.yaml"
) -> Course:
    """One period of 20 s, its approach and its end."""
    trajectory = load_trajectory(machine_file(name))
    return plan(machine, trajectory, start, 1, load_clearance(machine_file("clearance.yaml")))


def seen(
    simulated: SimulatedCrane, course: Course, seed: int = 0, effects: Sequence[InjectedForm] = ()
) -> SimulatedRecording:
    """What the sensors of a machine show on a motion."""
    machine = load_machine()
    plant = Plant(simulated, machine, course.start, effects)
    sensors = Sensors(simulated.sensors, machine, seed, faults(effects, machine))
    return record(
        slewing(course, effects),
        plant,
        sensors,
        load_gains(machine_file("controller.yaml"), machine),
    )


def recorded(
    simulated: SimulatedCrane | None = None,
    course: Course | None = None,
    seed: int = 0,
    effects: Sequence[InjectedForm] = (),
) -> Log:
    """The same as a log; by default of the packaged machine and motion."""
    simulated = simulated or load_simulated_crane()
    course = course or packaged_motion(load_machine(), simulated.start)
    found = seen(simulated, course, seed, effects)
    of_joint = [JOINTS.index(joint) for joint in PLANAR_JOINTS]
    of_cylinder = [found.cylinders.index(joint) for joint in PLANAR_JOINTS]

    def signal(value: np.ndarray, origin: str) -> Signal:
        return Signal(found.time, value, origin, received=found.time)

    pressures = "/cylinder_pressures"
    return Log(
        source=f"recording {seed}",
        joints=PLANAR_JOINTS,
        start=0,
        position=signal(found.position[:, of_joint], "/joint_states"),
        pressure_a=signal(found.pressures.chamber_a[:, of_cylinder], pressures),
        pressure_b=signal(found.pressures.chamber_b[:, of_cylinder], pressures),
        supply_pressure=signal(found.pressures.supply, pressures),
        tank_pressure=signal(found.pressures.tank, pressures),
        command=signal(found.command[:, of_joint], "/valve_command"),
    )
