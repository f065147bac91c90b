"""From a bag that (36) recorded behind a bus to a crane that follows: the study's second half.

(36) leads the stand-in machine through a trajectory, its commands late as those of the live suite.
`identify` finds mechanics and hydraulics from that bag alone. Then each controller leads the same
machine behind the same bus, through that trajectory and through one that nothing was fitted to.
"""

import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from crane_benchmark.study.hydraulic_aims import Aim, Miss, worst
from crane_benchmark.study.recordings import made_once, run
from crane_model.machine import load_machine
from crane_model.machine_files import machine_file
from crane_model.model_file import Model, load_model
from crane_sim.make_bag import write_bag
from crane_sim.parts.parameters import load_stand_in
from crane_sim.plant.closed_loop import REST, LatePlant, SimulatedRecording, mean_delay, record
from crane_sim.plant.sampled import Sensors
from crane_trajectory.control.choice import NAMES, PD_DEAD_ZONE, controller
from crane_trajectory.control.pd_dead_zone import load_gains
from crane_trajectory.motion.check import load_clearance
from crane_trajectory.motion.motion import Motion, plan
from crane_trajectory.motion.periodic import load_trajectory

TRAINED, UNSEEN = "excitation_20s", "validation_20s"
SEED = 201
DRIVEN = 2  # periods by each controller
STEPS = 3 + 2 * len(NAMES)
"""How often `follow` calls `advance`."""

Errors = dict[str, dict[str, dict[str, float]]]


class Followed(NamedTuple):
    """The summary of what was identified, what was planted and what the bus added, and the rms of
    the true error by trajectory, controller and joint [rad, m].
    """

    summary: Mapping[str, Any]
    planted: Mapping[str, float]
    rms: Errors

    @property
    def joints(self) -> list[str]:
        """Of the model."""
        return list(self.summary["heldout_relative_error"])

    def farthest_off(self, aim: Aim) -> Miss:
        """Of the hydraulics that the aim names."""
        rows = self.summary["hydraulics"]
        found = {one["name"]: (one["value"], one["std_dev"]) for one in rows}
        known = {name: found[name] for name in found.keys() & self.planted.keys()}
        return worst(aim, known, self.planted)


def follow(
    out: Path, planted: Mapping[str, float], periods: int, advance: Callable[[], object]
) -> Followed:
    """Bags of so many periods, the model and what follows from it, in the folder `out`; bags that
    are there already are not made again. `StudyError` if `identify` fails.
    """
    late = _behind_the_bus(planted)
    for number, name in enumerate((TRAINED, UNSEEN)):
        with made_once(out / name) as bag:
            if bag is not None:
                write_bag(bag, load_machine(), _led(name, periods, SEED + number).recording)
        advance()
    (out / "planted.json").write_text(json.dumps(late, indent=2), encoding="utf-8")
    run(
        *("crane_identification", "identify", "--replace", "--out", out / "identified"),
        *("--model", machine_file("model.yaml")),
        *("--train", out / TRAINED, "--validate", out / UNSEEN),
        *("--reference-values", out / "planted.json"),
    )
    advance()
    model, rms = load_model(out / "identified" / "model.yaml"), Errors()
    for name in (TRAINED, UNSEEN):
        rms[name] = {}
        for law in NAMES:
            rms[name][law] = _led(name, DRIVEN, SEED + 2, law, model).rms
            advance()
    summary = json.loads((out / "identified" / "summary.json").read_text(encoding="utf-8"))
    return Followed(summary, late, rms)


class _Led(NamedTuple):
    motion: Motion
    recording: SimulatedRecording

    @property
    def rms(self) -> dict[str, float]:
        """Of the true error over whole periods, by joint [rad, m]."""
        time = self.recording.time - REST
        inside = (time >= self.motion.excitation_start) & (time < self.motion.excitation_end)
        truth, wanted = self.recording.truth.position, self.recording.reference.position
        errors = np.sqrt(np.mean((truth - wanted)[inside] ** 2, axis=0))
        return dict(zip(load_machine().joint_names, errors.tolist(), strict=True))


def _led(
    name: str, periods: int, seed: int, law: str = PD_DEAD_ZONE, model: Model | None = None
) -> _Led:
    """The stand-in machine behind a bus, led through a trajectory from where it rests."""
    machine, stand_in = load_machine(), load_stand_in()
    clearance = load_clearance(machine_file("clearance.yaml"))
    trajectory = load_trajectory(machine_file(f"{name}.yaml"))
    motion = plan(machine, trajectory, stand_in.start, periods, clearance)
    gains = load_gains(machine_file("controller.yaml"), machine)
    plant = LatePlant(stand_in, machine, motion.start, seed=seed)
    sensors = Sensors(stand_in.sensors, machine, seed)
    made = controller(law, machine, gains.arrays, model)
    return _Led(motion, record(motion, plant, sensors, gains, controller=made))


def _behind_the_bus(planted: Mapping[str, float]) -> dict[str, float]:
    """The bus adds its mean delay to the lag of each valve."""
    delay = mean_delay(load_stand_in().sensors.period)
    return {name: value + delay * name.startswith("lag.") for name, value in planted.items()}
