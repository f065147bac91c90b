"""The machines that are observed, and recordings of them."""

import os
from collections.abc import Callable, Sequence
from dataclasses import fields, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from crane_benchmark.observing.cycles import LiftingPlant, WorkCycles
from crane_model.machine import Machine, load_machine
from crane_model.machine_files import machine_file
from crane_observer.recording import HeardRecording
from crane_sim.effects.form import Planted
from crane_sim.effects.sensing import faults
from crane_sim.hiding.calibrate import hidden_in
from crane_sim.hiding.label import HiddenEffect, Spec
from crane_sim.parts.parameters import Edges, StandIn, load_stand_in
from crane_sim.plant.closed_loop import SimulatedRecording, Steps, record
from crane_sim.plant.sampled import Sensors
from crane_sim.sensor_faults import Faults
from crane_trajectory.control.pd_dead_zone import Gains, load_gains

# Recordings of a machine at work, kept, so that a benchmark that was interrupted goes on.


class HeardWork(NamedTuple):
    """What was heard of a machine at work."""

    begin: float  # s since the machine was started, where the times of `heard` count from
    heard: HeardRecording

    @property
    def seconds(self) -> float:
        """How long it is."""
        return float(np.ptp(self.heard.pressure_time))


ARRAYS = tuple(one.name for one in fields(HeardRecording))[2:]


class KeptRecordings:
    """In a folder, a file for each. They depend on the machine and its seeds, not on who watches;
    several processes may make different ones.
    """

    def __init__(self, folder: Path):
        folder.mkdir(parents=True, exist_ok=True)
        self.folder = folder

    def recording(self, name: str, made: Callable[[], HeardWork]) -> HeardWork:
        """That of this name, made now unless it was before."""
        file = self.folder / f"{name}.npz"
        if not file.exists():
            work = made()
            unfinished = self.folder / f"{name}.unfinished.{os.getpid()}"
            with unfinished.open("wb") as stream:
                arrays = {key: getattr(work.heard, key) for key in ARRAYS}
                np.savez(stream, allow_pickle=False, begin=work.begin, **arrays)
            unfinished.replace(file)
            return work._replace(heard=replace(work.heard, path=file))
        with np.load(file) as kept:
            arrays = {key: kept[key] for key in ARRAYS}
            return HeardWork(float(kept["begin"]), HeardRecording(file, 0, **arrays))


SHARE = 0.03  # of the drive force, of each effect that (16) lacks
WIDTH = 0.01  # of the stroke, hysteresis of the valves
UNEQUAL = 0.02  # share by which gains differ
ZERO = 3e4  # Pa, by which transducers are off


class Observed(NamedTuple):
    """A machine with all that it hides."""

    machine: Machine
    stand_in: StandIn
    hidden: tuple[Planted, ...]
    gains: Gains

    def at_work(
        self,
        duration: float,
        seed: int,
        loaded: bool = True,
        progress: Steps = iter,
        failing: Sequence[str] = (),
        hung: float = 0.0,
    ) -> tuple[SimulatedRecording, np.ndarray]:
        """A recording of at least `duration` [s], and the load (n,) [kg] at each of its samples;
        `failing`: faults as `crane_sim.sensor_faults.Faults` has them; `hung` as
        `WorkCycles.drawn` has it.
        """
        cycles = WorkCycles.drawn(self.machine, self.stand_in.start, duration, seed, loaded, hung)
        plant = LiftingPlant(self.stand_in, self.machine, cycles, self.hidden)
        sensors = Sensors(
            self.stand_in.sensors,
            self.machine,
            seed,
            faults(self.hidden, self.machine),
            Faults(self.machine, failing, seed),
        )
        recording = record(cycles, plant, sensors, self.gains, progress)
        return recording, cycles.load(recording.time - 1.0)


def stock() -> Observed:
    """The laboratory crane as its file has it."""
    machine = load_machine()
    return Observed(
        machine, load_stand_in(), (), load_gains(machine_file("controller.yaml"), machine)
    )


def hard() -> Observed:
    """With dynamic friction, effects that (16) lacks, valves with hysteresis and unequal gains,
    and transducers whose zeros are off.
    """
    machine = load_machine()
    stand_in = load_stand_in(machine_file("stand_in_dynamic_friction.yaml"))
    joints = [joint for joint in machine.joint_names if machine.cylinders[joint].pressure_sensors]
    signs = dict(zip(joints, (1.0, -1.0, 1.0), strict=False))
    valves = {}
    for joint, valve in stand_in.valves.items():
        more = UNEQUAL * signs.get(joint, 0.0)
        edges = Edges(
            supply_a=1.0 + more, b_tank=1.0 + more, supply_b=1.0 - more, a_tank=1.0 - more
        )
        valves[joint] = valve.model_copy(update={"edges": edges})
    stand_in = stand_in.model_copy(update={"valves": valves})
    effects = [
        HiddenEffect(effect="load_friction", joint=joints[0], form="weight", strength=SHARE),
        HiddenEffect(effect="seal_friction", joint=joints[1], strength=SHARE),
        HiddenEffect(effect="position_friction", joint=joints[2], strength=SHARE),
    ]
    for joint, sign in signs.items():
        width, offset = {"width": WIDTH}, {"offset": sign * ZERO, "recovery": 0.0}
        effects.append(HiddenEffect(effect="valve_hysteresis", joint=joint, parameters=width))
        effects.append(HiddenEffect(effect="pressure_offset", joint=joint, parameters=offset))
    gains = load_gains(machine_file("controller.yaml"), machine)
    spec = Spec(seed=4, effects=tuple(effects))
    return Observed(machine, stand_in, hidden_in(spec, machine, stand_in, gains), gains)
