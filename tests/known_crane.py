"""The model file that would be identified of a simulated crane if nothing were uncertain."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from crane_model import Machine, Model, load_machine, load_model, save_model
from crane_model.hydraulics import (
    ChamberValues,
    HydraulicValues,
    JointHydraulics,
    Measured,
    SupplyValues,
    ValveValues,
)
from crane_model.machine_files import machine_file
from crane_sim import SimulatedCrane, load_simulated_crane
from crane_sim.true_values import hydraulics_of, true_parameters

TOLD_LATE = 0.002  # s, from the stamp of a command until the spool is told


def known_model(name: str = "laboratory_crane") -> Model:
    """Mechanics and hydraulics, as the files of the simulated crane say."""
    machine = load_machine(name)
    simulated = load_simulated_crane(machine_file("simulated_crane.yaml", name), machine)
    model = load_model(machine_file("model.yaml", name)).of_machine()
    theta = np.array([one.value for one in true_parameters(simulated, machine)])
    model = model.with_estimate(theta, np.zeros(len(theta)), "the file of the simulated crane")
    joints = {joint: _joint(machine, simulated, joint) for joint in model.joints}
    pressure, droop = machine.hydraulics.supply_pressure, 0.0
    supply = SupplyValues(
        pressure=Measured(value=pressure, unit="Pa"), droop=Measured(value=droop, unit="Pa s/m3")
    )
    values = HydraulicValues(provenance="the same", joints=joints, supply=supply)
    return replace(model, hydraulics=values)


def write_known_model(path: Path, name: str = "laboratory_crane") -> Path:
    """The same as a file."""
    save_model(path, known_model(name))
    return path


def _joint(machine: Machine, simulated: SimulatedCrane, joint: str) -> JointHydraulics:
    values = hydraulics_of(simulated, machine, joint)
    values["lag"] += TOLD_LATE
    sensed = machine.cylinders[joint].pressure_sensors
    return JointHydraulics(
        valve=ValveValues(**_measured(ValveValues.units, values)),
        chambers=ChamberValues(**_measured(ChamberValues.units, values)) if sensed else None,
        unexplained=0.0,
    )


def _measured(units: dict[str, str], values: dict[str, float]) -> dict[str, Measured]:
    return {name: Measured(value=values[name], unit=unit) for name, unit in units.items()}
