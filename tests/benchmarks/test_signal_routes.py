"""Three routes to velocity and acceleration, against the true motion of the simulated crane."""

from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

from crane_identification import Log, Options, Signal, fit, read_bag
from crane_identification.preparation.prepare import prepare
from crane_identification.signals.kalman import KalmanSmoother
from crane_identification.signals.motion import MotionEstimator
from crane_identification.signals.routes import ButterworthDifferentiator, FourierFit
from crane_model import Model, load_machine, load_model
from crane_model.machine_files import machine_file
from crane_sim import Plant, Sensors, load_simulated_crane, record
from crane_sim.make_bag import write_bag
from crane_sim.true_values import true_parameters
from crane_trajectory import load_clearance, load_trajectory, plan
from crane_trajectory.control.controller import load_gains

PERIODS = 5
USUAL = 2.5  # Hz, ten times the highest frequency of the reference
CUTOFFS = (6.0, 8.0, 10.0, 12.0, 15.0, 18.0, 22.0, 26.0, 30.0)


class Experiment(NamedTuple):
    """A recording, and what really moved: (n, 3) at its times."""

    log: Log
    velocity: np.ndarray
    acceleration: np.ndarray
    theta: np.ndarray


class Score(NamedTuple):
    """Errors relative to the truth, root mean square over joints; of Θ over parameters."""

    velocity: float
    acceleration: float
    parameters: float


@pytest.fixture(
    scope="module", params=["simulated_crane.yaml", "simulated_crane_dynamic_friction.yaml"]
)
def experiment(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory
) -> Experiment:
    machine, parameters = load_machine(), load_simulated_crane(machine_file(request.param))
    trajectory = load_trajectory(machine_file("excitation_20s.yaml"))
    motion = plan(
        machine,
        trajectory,
        parameters.start,
        PERIODS,
        load_clearance(machine_file("clearance.yaml")),
    )
    plant = Plant(parameters, machine, motion.start)
    made = record(
        motion,
        plant,
        Sensors(parameters.sensors, machine, 1),
        load_gains(machine_file("controller.yaml"), machine),
    )
    path = tmp_path_factory.mktemp("bags") / Path(request.param).stem
    write_bag(path, machine, made)
    velocity = made.truth.velocity[:, 1:]
    acceleration = np.gradient(velocity, made.time, axis=0)
    theta = np.array([one.value for one in true_parameters(parameters, machine)])
    return Experiment(read_bag(path, model().joints), velocity, acceleration, theta)


def model() -> Model:
    return load_model(machine_file("model.yaml"))


def averaged_alike(log: Log, values: np.ndarray, options: Options) -> np.ndarray:
    """What preparation makes of a measured force, made of the truth."""
    force = Signal(log.position.time, values, "truth")
    truth = replace(log, force=force, pressure_a=None, pressure_b=None)
    (preparation,) = prepare(model(), truth, options)
    assert preparation.record.force is not None
    return preparation.record.force


def score(experiment: Experiment, motion: MotionEstimator, average: bool) -> Score:
    options = Options(motion=motion, average=average, trim=(500, 500))
    (preparation,) = prepare(model(), experiment.log, options)

    def error(estimate: np.ndarray, truth: np.ndarray) -> float:
        known = averaged_alike(experiment.log, truth, options)
        share = ((estimate - known) ** 2).mean(axis=0) / (known**2).mean(axis=0)
        return float(np.sqrt(share.mean()))

    found = fit(model(), [experiment.log], options).estimate.values / experiment.theta - 1.0
    return Score(
        error(preparation.record.velocity, experiment.velocity),
        error(preparation.record.acceleration, experiment.acceleration),
        float(np.sqrt((found**2).mean())),
    )


@pytest.mark.parametrize("average", [True, False], ids=["averaged", "not averaged"])
def test_the_default_is_never_worse_than_butterworth(
    experiment: Experiment, average: bool, measured
) -> None:
    """Of Butterworth, also the cut-off that the truth itself would choose."""
    butterworth = {fc: score(experiment, ButterworthDifferentiator(fc), average) for fc in CUTOFFS}
    best = min(CUTOFFS, key=lambda fc: butterworth[fc].acceleration)
    routes = {
        "Kalman + RTS": score(experiment, KalmanSmoother(), average),
        f"Butterworth, {best:g} Hz (best in hindsight)": butterworth[best],
        f"Butterworth, {USUAL:g} Hz (usual)": score(
            experiment, ButterworthDifferentiator(USUAL), average
        ),
    }
    if average:
        routes["Fourier fit"] = score(experiment, FourierFit(), average)
    print(f"\n{experiment.log.source}, {'averaged' if average else 'not averaged'}")
    print(f"  {'relative rms error of':40s} velocity  acceleration  parameters")
    for name, one in routes.items():
        print(f"  {name:40s} {one.velocity:8.2%}  {one.acceleration:12.1%}  {one.parameters:10.2%}")
    chosen = routes["Fourier fit" if average else "Kalman + RTS"]
    usual = routes[f"Butterworth, {USUAL:g} Hz (usual)"]
    errors = {"chosen": chosen, "best": butterworth[best], "usual": usual}
    measured(
        f"error of velocity, of acceleration, {Path(experiment.log.source).name}, "
        f"{'averaged' if average else 'not averaged'}: by the default; by Butterworth at the best "
        "cut-off in hindsight; at the usual one",
        "never worse than Butterworth",
        "; ".join(f"{{{name}_velocity:.2%}}, {{{name}_acceleration:.0%}}" for name in errors),
        **{f"{name}_velocity": one.velocity for name, one in errors.items()},
        **{f"{name}_acceleration": one.acceleration for name, one in errors.items()},
    )
    assert chosen.velocity < 1.05 * butterworth[best].velocity
    assert chosen.acceleration < 1.05 * butterworth[best].acceleration
    assert chosen.acceleration < routes[f"Butterworth, {USUAL:g} Hz (usual)"].acceleration
