"""Controllers by what one bag of (36) tells of a machine, and rows of what they reach."""

import tempfile
from collections.abc import Callable, Sequence
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from benchmarks.controlled import Run, Score, drive
from benchmarks.controlled_machines import Controlled, stock

from crane_identification.identify import main as identify
from crane_model import Model, load_model
from crane_model.machine_files import machine_file
from crane_sim.make_bag import write_bag
from crane_trajectory import Motion, load_clearance, load_trajectory, plan
from crane_trajectory.control.choice import OF_THE_MODEL, PD_DEAD_BAND, SideBySide
from crane_trajectory.control.controller import Controller, PdDeadBand, load_gains
from crane_trajectory.control.flow_feedforward import FlowFeedforward, feedback_gains
from crane_trajectory.control.valves_and_oil import ValvesAndOil, identified
from crane_trajectory.motion.periodic import PeriodicTrajectory

Measured = Callable[..., None]
FLOW, PRESSURES, ADAPTIVE, FORCE = OF_THE_MODEL
RECOMMENDED = (FLOW, PRESSURES, ADAPTIVE)
SHOWN = {PD_DEAD_BAND: "(36)"}
FIXED = {"sense", "area_a", "area_b", "length_min", "length_max", "play",
         "supply_pressure", "tank_pressure"}  # fmt: skip
"""What a data sheet or a gauge tells, and what is known well or not at all."""
BOOMS = slice(1, 4)


class Known(NamedTuple):
    """What a controller knows of a machine; `joints` are those that it leads by the model."""

    model: Model
    hydraulics: ValvesAndOil
    joints: tuple[str, ...]

    def wrong_by(self, share: float, seed: int) -> "Known":
        """Every value off by up to a share of it, evenly drawn."""
        rng = np.random.default_rng(seed)

        def off(values: np.ndarray) -> np.ndarray:
            return values * rng.uniform(1.0 - share, 1.0 + share, len(values))

        known = self.hydraulics._asdict().items()
        changed = {name: off(values) for name, values in known if name not in FIXED}
        model = self.model
        return self._replace(
            model=model.with_estimate(off(model.theta), np.zeros(len(model.theta)), "drawn"),
            hydraulics=self.hydraulics._replace(**changed),
        )

    def without_play(self) -> "Known":
        """Told that the valves have none."""
        hydraulics = self.hydraulics
        return self._replace(hydraulics=hydraulics._replace(play=0.0 * hydraulics.play))


def identify_from_bags(machine: Controlled, *motions: Motion, average: bool = True) -> Known:
    """Mechanics and hydraulics from what (36) records of each motion in this very loop.

    Periods are averaged unless (36) hunts so that they differ.
    """
    with tempfile.TemporaryDirectory() as folder:
        out, bags = Path(folder, "identified"), []
        for number, to in enumerate(motions):
            bags.append(Path(folder, f"bag_{number}"))
            recording = drive(to, machine, pd_dead_band(machine)).recording
            write_bag(bags[-1], machine.machine, recording)
        model = machine_file("model.yaml", machine.name)
        train = ["--train", *map(str, bags), "--trust-recordings"]
        train += [] if average else ["--no-average"]
        assert not identify(["--model", str(model), *train, "--out", str(out)])
        found = load_model(out / "model.yaml")
    assert found.hydraulics is not None
    joints = tuple(joint for joint in machine.joints if joint in found.hydraulics.joints)
    return Known(found, identified(machine.machine, found.hydraulics, joints), joints)


def pd_dead_band(machine: Controlled) -> PdDeadBand:
    """(36)."""
    gains = load_gains(machine_file("controller.yaml", machine.name), machine.machine)
    return PdDeadBand(gains.arrays)


def controller(law: str, machine: Controlled, known: Known, scale: float = 1.0) -> Controller:
    """One of `choice`, its gains times `scale`."""
    rest = pd_dead_band(machine)
    if law == PD_DEAD_BAND:
        return rest
    gains = feedback_gains(machine.machine, known.model, scale, known.joints)
    led = FlowFeedforward(
        machine.machine,
        known.model,
        known.hydraulics,
        gains,
        joints=known.joints,
        **OF_THE_MODEL[law]._asdict(),
    )
    return led if known.joints == machine.joints else SideBySide(led, rest)


@cache
def motion(name: str = "excitation_20s", periods: int = 2, machine: str = stock().name) -> Motion:
    """A shipped trajectory from where the machine rests."""
    return planned(load_trajectory(machine_file(f"{name}.yaml", machine)), stock(machine), periods)


def planned(trajectory: PeriodicTrajectory, machine: Controlled, periods: int = 1) -> Motion:
    """From where the machine rests."""
    clearance = load_clearance(machine_file("clearance.yaml", machine.name))
    return plan(machine.machine, trajectory, machine.simulated.start, periods, clearance)


@cache
def of_stock() -> Known:
    """The laboratory crane as one bag shows it."""
    return identify_from_bags(stock(), motion(periods=3))


def run(
    law: str, machine: Controlled, known: Known, to: Motion | None = None,
    scale: float = 1.0, **more: Any,
) -> Run:  # fmt: skip
    """A run by a law that nothing has stopped."""
    done = drive(to or motion(), machine, controller(law, machine, known, scale), **more)
    assert law == PD_DEAD_BAND or not done.worst.stops, done.worst.text
    return done


def scores(
    laws: Sequence[str], machine: Controlled, known: Known, to: Motion | None = None, **more: Any
) -> dict[str, Score]:
    """Of a run by each law."""
    return {law: run(law, machine, known, to, **more).score() for law in laws}


def row(measured: Measured, what: str, target: str, values: dict[str, np.ndarray]) -> None:
    """Show values (k,) by law."""
    numbers, parts = {}, []
    for law, found in values.items():
        keys = ["".join(c if c.isalnum() else "_" for c in f"{law}_{k}") for k in range(len(found))]
        numbers |= dict(zip(keys, found, strict=True))
        parts.append(f"{SHOWN.get(law, law)} " + "/".join(f"{{{key}:.3g}}" for key in keys))
    measured(what, target, "; ".join(parts), **numbers)


def rms(found: dict[str, Score]) -> dict[str, np.ndarray]:
    """Of the booms by law [mrad, mrad, mm]."""
    return {law: score.rms[BOOMS] for law, score in found.items()}
