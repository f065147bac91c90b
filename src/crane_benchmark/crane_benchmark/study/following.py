"""From a bag that (36) recorded behind a bus to a crane that follows: the study's second half.

(36) leads the simulated crane through a trajectory, its commands late as those of the live suite.
`identify` finds mechanics and hydraulics from that bag alone. Then each controller leads the same
machine behind the same bus, through that trajectory and through one that nothing was fitted to.
"""

import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from crane_benchmark.study.recordings import made_once, run
from crane_model.machine import load_machine
from crane_model.machine_files import machine_file
from crane_model.model_file import Model, load_model
from crane_sim.make_bag import write_bag
from crane_sim.parts.parameters import load_simulated_crane
from crane_sim.plant.closed_loop import REST_S, LatePlant, SimulatedRecording, mean_delay, record
from crane_sim.plant.sampled import Sensors
from crane_trajectory.control.choice import OF_THE_MODEL, PD_DEAD_BAND, controller
from crane_trajectory.control.controller import load_gains
from crane_trajectory.motion.check import load_clearance
from crane_trajectory.motion.motion import Motion, plan
from crane_trajectory.motion.periodic import load_trajectory

AHEAD = {1.0: 0.002, 5.0: 0.001}
"""Error of motion from commands, by how far ahead [s], of the way."""
TRAINED, UNSEEN = "excitation_20s", "validation_20s"
SEED = 201
DRIVEN = 2  # periods by each controller
LAWS = (PD_DEAD_BAND, *OF_THE_MODEL)
FOLLOWING_STEPS = 3 + 2 * len(LAWS)
"""How often `follow` calls `advance`."""


class Aim(NamedTuple):
    """Largest error of a made bag, and of one recorded behind a bus; in `unit`, or relative."""

    names: tuple[str, ...]
    made: float
    live: float
    unit: str = ""

    def told(self, value: float) -> str:
        return f"{value:.2g} {self.unit}" if self.unit else f"{100.0 * value:.2g} %"


HYDRAULIC_AIMS = {
    "dead bands": Aim(("dead_band_a", "dead_band_b"), 0.001, 0.002),
    "flow gains": Aim(("supply_a", "a_tank", "supply_b", "b_tank"), 0.001, 0.001),
    "1/beta": Aim(("bulk_modulus",), 0.01, 0.02),
    "dead volumes": Aim(("dead_volume_a", "dead_volume_b"), 0.05, 0.08),
    "leakage": Aim(("leakage",), 0.15, 0.15),
    "lag": Aim(("lag",), 5e-4, 5e-4, "s"),
    "hysteresis": Aim(("hysteresis",), 3e-4, 3e-4, "of the stroke"),
}


class Miss(NamedTuple):
    """An error, and the standard deviation that was told of the value [in the aim's unit]."""

    error: float
    std_dev: float


def worst(
    aim: Aim, found: Mapping[str, tuple[float, float]], true_values: Mapping[str, float]
) -> Miss:
    """The largest error of the values that the aim names, of all joints.

    `found` are values and standard deviations as NAME.JOINT, `true_values` the true ones.
    """
    misses = []
    for name, (value, std_dev) in found.items():
        if name.split(".", 1)[0] in aim.names:
            unit = 1.0 if aim.unit else abs(true_values[name])
            misses.append(Miss(abs(value - true_values[name]) / unit, std_dev / unit))
    return max(misses)


Errors = dict[str, dict[str, dict[str, float]]]


class Followed(NamedTuple):
    """The summary of what was identified, the true values and what the bus added, and the rms of
    the true error by trajectory, controller and joint [rad, m].
    """

    summary: Mapping[str, Any]
    true_values: Mapping[str, float]
    rms: Errors

    @property
    def joints(self) -> list[str]:
        return list(self.summary["heldout_relative_error"])

    def farthest_off(self, aim: Aim) -> Miss:
        """Largest error of the hydraulics that the aim names."""
        rows = self.summary["hydraulics"]
        found = {row["name"]: (row["value"], row["std_dev"]) for row in rows}
        known = {name: found[name] for name in found.keys() & self.true_values.keys()}
        return worst(aim, known, self.true_values)


def follow(
    out: Path, true_values: Mapping[str, float], periods: int, advance: Callable[[], object]
) -> Followed:
    """Bags of so many periods, the model and what follows from it, in the folder `out`; bags that
    are there already are not made again. `StudyError` if `identify` fails.
    """
    late = _behind_the_bus(true_values)
    for number, name in enumerate((TRAINED, UNSEEN)):
        with made_once(out / name) as bag:
            if bag is not None:
                write_bag(bag, load_machine(), _led(name, periods, SEED + number).recording)
        advance()
    (out / "true_values.json").write_text(json.dumps(late, indent=2), encoding="utf-8")
    run(
        *("crane_identification", "identify", "--replace", "--out", out / "identified"),
        *("--model", machine_file("model.yaml")),
        *("--train", out / TRAINED, "--validate", out / UNSEEN),
        *("--reference-values", out / "true_values.json"),
    )
    advance()
    model, rms = load_model(out / "identified" / "model.yaml"), Errors()
    for name in (TRAINED, UNSEEN):
        rms[name] = {}
        for law in LAWS:
            rms[name][law] = _led(name, DRIVEN, SEED + 2, law, model).rms
            advance()
    summary = json.loads((out / "identified" / "summary.json").read_text(encoding="utf-8"))
    return Followed(summary, late, rms)


class _Led(NamedTuple):
    motion: Motion
    recording: SimulatedRecording

    @property
    def rms(self) -> dict[str, float]:
        """RMS of the true error over whole periods, by joint [rad, m]."""
        time = self.recording.time - REST_S
        inside = (time >= self.motion.excitation_start) & (time < self.motion.excitation_end)
        truth, wanted = self.recording.truth.position, self.recording.reference.position
        errors = np.sqrt(np.mean((truth - wanted)[inside] ** 2, axis=0))
        return dict(zip(load_machine().joint_names, errors.tolist(), strict=True))


def _led(
    name: str, periods: int, seed: int, law: str = PD_DEAD_BAND, model: Model | None = None
) -> _Led:
    """The simulated crane behind a bus, led through a trajectory from where it rests."""
    machine, simulated = load_machine(), load_simulated_crane()
    clearance = load_clearance(machine_file("clearance.yaml"))
    trajectory = load_trajectory(machine_file(f"{name}.yaml"))
    motion = plan(machine, trajectory, simulated.start, periods, clearance)
    gains = load_gains(machine_file("controller.yaml"), machine)
    plant = LatePlant(simulated, machine, motion.start, seed=seed)
    sensors = Sensors(simulated.sensors, machine, seed)
    made = controller(law, machine, gains.arrays, model)
    return _Led(motion, record(motion, plant, sensors, gains, controller=made))


def _behind_the_bus(true_values: Mapping[str, float]) -> dict[str, float]:
    """The bus adds its mean delay to the lag of each valve."""
    delay = mean_delay(load_simulated_crane().sensors.period)
    return {name: value + delay * name.startswith("lag.") for name, value in true_values.items()}
