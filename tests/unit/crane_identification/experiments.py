"""Experiments on a crane that obeys the model exactly, read by the sensor chain of the suite.

Inverse dynamics instead of a plant: cheap enough for a thousand of them, and everything from the
encoders and transducers on is what happens to a recording of the machine.
"""

import numpy as np
from unit.crane_identification.synthetic import AREAS, crane_model

from crane_identification import Log, Signal
from crane_model import Model, Record
from crane_model.configuration import load
from crane_model.cylinders import cylinder_forces_from_generalized
from crane_model.machine_files import machine_file
from crane_model.sensors import SensorChain, in_counts
from crane_trajectory import load_trajectory

LOWEST_PRESSURE = 1e6  # Pa, in the chamber that pushes less


def sensors() -> SensorChain:
    return load(machine_file("sensors.yaml"), SensorChain)


def experiment(
    seed: int,
    periods: int = 3,
    trajectory: str = "excitation_20s.yaml",
    model: Model | None = None,
    noise: float = 1.0,
) -> Log:
    """A log of whole periods of a packaged trajectory; `noise` multiplies that of the pressures."""
    model, chain = model or crane_model(), sensors()
    chain = chain.model_copy(update={"pressure_noise": noise * chain.pressure_noise})
    assert model.machine is not None
    rng = np.random.default_rng(seed)
    reference = load_trajectory(machine_file(trajectory))
    count = round(periods * reference.period / chain.period) + 1
    # A seed begins anywhere in the period, so that no two experiments round alike.
    time = chain.sample_times(rng, 0.0, count)
    moved = reference.evaluate(time + rng.uniform(0.0, reference.period))
    columns = [reference.joint_names.index(joint) for joint in model.joints]
    q, v, a = (values[:, columns] for values in moved)
    force = cylinder_forces_from_generalized(
        model.machine, q, model.predict(Record(model.joints, time, q, v, a)), model.joints
    )
    cylinders = [model.machine.cylinders[joint] for joint in model.joints]
    area_a, area_b = (np.array([getattr(c, name) for c in cylinders]) for name in AREAS)
    pressure_a = LOWEST_PRESSURE + np.maximum(force, 0.0) / area_a
    pressure_b = LOWEST_PRESSURE * area_a / area_b + np.maximum(-force, 0.0) / area_b
    position = in_counts(q, chain.counts(model.joints))
    return Log(
        source=f"experiment {seed}",
        joints=model.joints,
        start=0,
        position=Signal(time, position, "/joint_states"),
        pressure_a=Signal(time, chain.measure_pressure(rng, pressure_a), "/cylinder_pressures"),
        pressure_b=Signal(time, chain.measure_pressure(rng, pressure_b), "/cylinder_pressures"),
        reference_position=Signal(time, q, "/joint_reference"),
        reference_velocity=Signal(time, v, "/joint_reference"),
        reference_acceleration=Signal(time, a, "/joint_reference"),
    )
