"""The stock machine at work, recorded once, and the model that knows its values."""

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
from unit.crane_identification.hydraulics.valve_experiments import FITTED, MACHINE, truth

from crane_benchmark.observing.machines import stock
from crane_model import Model, load_model
from crane_model.hydraulics import (
    ChamberValues,
    HydraulicValues,
    JointHydraulics,
    Measured,
    ValveValues,
)
from crane_model.machine_files import machine_file
from crane_observer import HeardRecording
from crane_sim import SimulatedRecording, load_simulated_crane
from crane_sim.true_values import true_parameters

JOINTS = FITTED
SECONDS = 24.0


@cache
def known() -> Model:
    simulated = load_simulated_crane()
    model = load_model(machine_file("model.yaml"))
    theta = np.array([parameter.value for parameter in true_parameters(simulated, MACHINE)])
    joints = {}
    for joint in JOINTS:
        true = {"damping_ratio": simulated.valves[joint].damping_ratio} | truth(simulated, joint)

        def measured(kind: type, true: dict[str, float] = true) -> dict[str, Measured]:
            return {
                name: Measured(value=true[name], std_dev=0.0, unit=unit)
                for name, unit in kind.units.items()
            }

        joints[joint] = JointHydraulics(
            valve=ValveValues(**measured(ValveValues)),
            chambers=ChamberValues(**measured(ChamberValues)),
            unexplained=0.0,
        )
    model = model.with_estimate(theta, 1e-4 * np.abs(theta), "the file of the simulated crane")
    return replace(model, hydraulics=HydraulicValues(provenance="that file", joints=joints))


@cache
def at_work() -> tuple[SimulatedRecording, np.ndarray]:
    return stock().at_work(SECONDS, seed=3)


@cache
def recording() -> HeardRecording:
    made, _ = at_work()
    time = made.time - made.time[0]
    columns = [MACHINE.index(joint) for joint in JOINTS]
    pressures = made.pressures
    return HeardRecording(
        Path("made"), 0, time, made.position[:, columns], time, pressures.chamber_a,
        pressures.chamber_b, pressures.supply, time, made.command[:, columns],
    )  # fmt: skip
