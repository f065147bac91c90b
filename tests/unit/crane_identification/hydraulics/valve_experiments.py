"""Recordings of the simulated crane whose valves and oil are known, as logs."""

from collections.abc import Sequence

import numpy as np

from crane_identification import Log, Signal
from crane_model import load_machine
from crane_model.machine_files import machine_file
from crane_sim import (
    Plant,
    Sensors,
    SimulatedCrane,
    SimulatedRecording,
    load_simulated_crane,
    record,
)
from crane_sim.calibration import SLEW, Slewing
from crane_sim.effects.form import InjectedForm
from crane_sim.effects.kernel import FORMS
from crane_sim.plant.closed_loop import LatePlant
from crane_sim.true_values import hydraulics_of
from crane_trajectory import load_clearance, load_trajectory, plan
from crane_trajectory.control.controller import load_gains
from crane_trajectory.motion.periodic import Probe

MACHINE = load_machine()
FITTED = tuple(j for j in MACHINE.joint_names if MACHINE.cylinders[j].pressure_sensors)
COLUMNS = [MACHINE.index(joint) for joint in FITTED]
PERIOD = 20.0  # s of the packaged trajectories
SLEW_SPEED, SLEW_FREQUENCY = 0.15, 0.6  # rad/s
SILENT = 1.8  # s at the start of a live recording before the first command is logged


def recorded(
    simulated: SimulatedCrane | None = None,
    seed: int = 0,
    periods: int = 3,
    trajectory: str = "excitation_20s.yaml",
    effects: Sequence[InjectedForm] = (),
    live: bool = False,
    slewed: bool = False,
    probe: Probe | None = None,
) -> Log:
    """Periods of a packaged trajectory under the controller (36), the slew at rest or swinging."""
    simulated = simulated or load_simulated_crane()
    motion = plan(
        MACHINE,
        load_trajectory(machine_file(trajectory)).model_copy(update={"probe": probe}),
        simulated.start,
        periods,
        load_clearance(machine_file("clearance.yaml")),
    )
    course = Slewing(motion, SLEW_SPEED, SLEW_FREQUENCY) if slewed else motion
    plant = (
        LatePlant(simulated, MACHINE, motion.start, effects, seed=seed)
        if live
        else Plant(simulated, MACHINE, motion.start, effects)
    )
    sensors = Sensors(simulated.sensors, MACHINE, seed)
    gains = load_gains(machine_file("controller.yaml"), MACHINE)
    return log_of(record(course, plant, sensors, gains), live)


def log_of(recording: SimulatedRecording, live: bool = False) -> Log:
    """As a bag's reader gives it."""
    time = recording.time - recording.time[0]

    def signal(values: np.ndarray, origin: str, rows: slice = slice(None)) -> Signal:
        return Signal(time[rows], values[rows], origin)

    pressures, reference = recording.pressures, recording.reference
    logged = slice(int(np.searchsorted(time, SILENT)), None) if live else slice(None)
    return Log(
        source="made",
        joints=FITTED,
        start=0,
        position=signal(recording.position[:, COLUMNS], "/joint_states"),
        pressure_a=signal(pressures.chamber_a, "/cylinder_pressures"),
        pressure_b=signal(pressures.chamber_b, "/cylinder_pressures"),
        supply_pressure=signal(pressures.supply, "/cylinder_pressures"),
        tank_pressure=signal(pressures.tank, "/cylinder_pressures"),
        command=signal(recording.command[:, COLUMNS], "/valve_command", logged),
        slew_position=signal(recording.position[:, SLEW], "/joint_states"),
        slew_command=signal(recording.command[:, SLEW], "/valve_command", logged),
        reference_position=signal(reference.position[:, COLUMNS], "/joint_reference"),
    )


def play(joint: str, width: float) -> InjectedForm:
    """Hysteresis of a valve: its edges trail the spool."""
    form = next(form for form in FORMS["valve_hysteresis"] if form.name == "trailing_edges")
    return InjectedForm(form, joint, (width,))


def truth(simulated: SimulatedCrane, joint: str, width: float = 0.0) -> dict[str, float]:
    """By name what is to be identified of a joint, whose valve has a play of a width."""
    return hydraulics_of(simulated, MACHINE, joint) | {"hysteresis": width}
