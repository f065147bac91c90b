"""The machines that are observed, and recordings of them."""

import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from crane_model.machine import Machine, load_machine
from crane_model.machine_files import machine_file
from crane_observer.recording import HeardRecording
from crane_sim.calibration import injected_in
from crane_sim.effects.form import InjectedForm
from crane_sim.effects.kernel import FORMS
from crane_sim.effects.sensing import faults
from crane_sim.ground_truth import InjectedEffect, Spec
from crane_sim.parts.parameters import Edges, SimulatedCrane, load_simulated_crane
from crane_sim.plant.closed_loop import REST_S, SimulatedRecording, record
from crane_sim.plant.plant import Plant
from crane_sim.plant.sampled import Sensors
from crane_sim.sensor_faults import Faults
from crane_trajectory.control.controller import Gains, load_gains
from crane_trajectory.motion.motion import Reference

REACHED = 0.7  # of the range of a joint, about its middle
HASTE = 0.6  # of the speed that a joint may have, at most
RESTS = (0.8, 2.5)  # s between two moves
LEAST_MOVE_S = 2.0  # s that a move takes
STAYING = 0.3  # share of the moves in which a joint stays
CARRIED = (20.0, 150.0)  # kg
PAYLOAD = InjectedForm(FORMS["payload"][0], None, (0.0, 0.0, 0.1))
"""A load that hangs in the tip itself; its mass comes and goes, and its centre with it."""
SHARE = 0.03  # of the drive force, of each effect that (16) lacks
HYSTERESIS_SHARE = 0.01  # of the stroke, hysteresis of the valves
GAIN_DIFFERENCE = 0.02  # share by which gains differ
ZERO = 3e4  # Pa, by which transducers are off


@dataclass(frozen=True)
class WorkCycles:
    """Moves k from `poses[k]` to `poses[k + 1]`, from `begins[k]` to `ends[k]` [s]; at rest then.

    `loads` (k,) [kg] hangs at the tip from the middle of the rest before move k on, its centre
    `beyond` (k,) [m] it, along the line from the last joint.
    """

    poses: np.ndarray  # (k + 1, j)
    begins: np.ndarray  # (k,)
    ends: np.ndarray  # (k,)
    loads: np.ndarray  # (k,)
    beyond: np.ndarray  # (k,)

    @classmethod
    def drawn(
        cls,
        machine: Machine,
        start: np.ndarray,
        duration: float,
        seed: int,
        hung: float = 0.0,
    ) -> "WorkCycles":
        """From the pose `start` (j,), for at least `duration` [s]; joints without pressure
        transducers stay where they are. `hung` [m] is the standard deviation of the centres of
        the loads about the tip.
        """
        rng = np.random.default_rng([seed, 17])
        joints = machine.joint_names
        low, high, middle, speed, _ = machine.ranges()
        moving = np.array([machine.cylinders[joint].pressure_sensors for joint in joints])
        half = REACHED * (high - low) / 2.0
        poses, begins, ends, loads, now, load = [start], [], [], [], 0.0, 0.0
        while now < duration:
            now += rng.uniform(*RESTS)
            free = moving & (rng.uniform(size=len(joints)) > STAYING)
            target = np.where(free, middle + half * rng.uniform(-1.0, 1.0, len(joints)), poses[-1])
            needed = 1.875 * np.abs(target - poses[-1]) / (HASTE * speed)  # of the fifth-order move
            begins.append(now)
            now += max(LEAST_MOVE_S, float(needed.max()))
            ends.append(now)
            if begins[1:] and rng.uniform() < 0.5:
                load = 0.0 if load else float(rng.uniform(*CARRIED))
            loads.append(load)
            poses.append(target)
        came = np.concatenate([[False], np.diff(loads) != 0.0])
        centres = hung * np.random.default_rng([seed, 18]).normal(size=len(loads))
        beyond = centres[np.cumsum(came)]
        return cls(*map(np.array, (poses, begins, ends, loads, beyond)))

    @property
    def start(self) -> np.ndarray:
        """(j,) the first pose."""
        return np.asarray(self.poses[0])

    @property
    def duration(self) -> float:
        """Until the last move is over [s]."""
        return float(self.ends[-1])

    def reference(self, time: np.ndarray) -> Reference:
        """At time (n,) [s]: polynomials of fifth order, from rest to rest."""
        k = np.clip(np.searchsorted(self.begins, time, side="right") - 1, 0, None)
        span = (self.ends - self.begins)[k, np.newaxis]
        s = np.clip((time - self.begins[k])[:, np.newaxis] / span, 0.0, 1.0)
        way = (self.poses[1:] - self.poses[:-1])[k]
        return Reference(
            position=self.poses[k] + way * s**3 * (10.0 - 15.0 * s + 6.0 * s**2),
            velocity=way * 30.0 * s**2 * (1.0 - s) ** 2 / span,
            acceleration=way * 60.0 * s * (1.0 - 3.0 * s + 2.0 * s**2) / span**2,
            phase=np.full(len(time), np.nan),
        )

    def probe(self, time: np.ndarray) -> np.ndarray:
        return np.zeros((len(time), self.poses.shape[1]))

    def load(self, time: np.ndarray) -> np.ndarray:
        """Payload at time (n,) [s] since the beginning of the motion, (n,) [kg]."""
        k = self._carried(time)
        return np.where(k < 0, 0.0, self.loads[np.clip(k, 0, None)])

    def carried(self, time: float) -> tuple[float, float]:
        """The same at one time, and how far its centre is beyond the tip [m]."""
        k = int(self._carried(np.array([time]))[0])
        return (0.0, 0.0) if k < 0 else (float(self.loads[k]), float(self.beyond[k]))

    def _carried(self, time: np.ndarray) -> np.ndarray:
        """(n,) the move whose load hangs there; -1 before the first."""
        rest_before = np.concatenate([[0.0], self.ends[:-1]])
        changes = (rest_before + self.begins) / 2.0
        return np.searchsorted(changes, time, side="right") - 1


class LiftingPlant(Plant):
    """The machine at work: what hangs at its tip comes and goes, beside what else it hides."""

    def __init__(
        self,
        parameters: SimulatedCrane,
        machine: Machine,
        cycles: WorkCycles,
        hidden: Sequence[InjectedForm],
    ):
        super().__init__(parameters, machine, cycles.start, [PAYLOAD, *hidden])
        self._cycles = cycles

    def advance(self, command: np.ndarray, duration: float) -> None:
        """With the load of the moment; the motion begins when the machine has been at rest."""
        self.set_magnitude(0, *self._cycles.carried(self.time - REST_S))
        super().advance(command, duration)


# Recordings of a machine at work, kept, so that a benchmark that was interrupted goes on.


class HeardWork(NamedTuple):
    """Signals of a machine at work."""

    begin: float  # s since the machine was started, where the times of `heard` count from
    heard: HeardRecording

    @property
    def seconds(self) -> float:
        return float(np.ptp(self.heard.pressure_time))


ARRAYS = tuple(field.name for field in fields(HeardRecording))[2:]


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


class Observed(NamedTuple):
    """A machine with all that it hides."""

    machine: Machine
    simulated: SimulatedCrane
    hidden: tuple[InjectedForm, ...]
    gains: Gains

    def at_work(
        self,
        duration: float,
        seed: int,
        failing: Sequence[str] = (),
        hung: float = 0.0,
    ) -> tuple[SimulatedRecording, np.ndarray]:
        """A recording of at least `duration` [s], and the load (n,) [kg] at each of its samples;
        `failing`: faults as `crane_sim.sensor_faults.Faults` has them; `hung` as
        `WorkCycles.drawn` has it.
        """
        cycles = WorkCycles.drawn(self.machine, self.simulated.start, duration, seed, hung)
        plant = LiftingPlant(self.simulated, self.machine, cycles, self.hidden)
        sensors = Sensors(
            self.simulated.sensors,
            self.machine,
            seed,
            faults(self.hidden, self.machine),
            Faults(self.machine, failing, seed),
        )
        recording = record(cycles, plant, sensors, self.gains)
        return recording, cycles.load(recording.time - 1.0)


def stock() -> Observed:
    """The laboratory crane as its file has it."""
    machine = load_machine()
    return Observed(
        machine, load_simulated_crane(), (), load_gains(machine_file("controller.yaml"), machine)
    )


def hard() -> Observed:
    """With dynamic friction, effects beyond (16), uneven valves, and transducer zeros."""
    machine = load_machine()
    simulated = load_simulated_crane(machine_file("simulated_crane_dynamic_friction.yaml"))
    joints = [joint for joint in machine.joint_names if machine.cylinders[joint].pressure_sensors]
    signs = dict(zip(joints, (1.0, -1.0, 1.0), strict=False))
    valves = {}
    for joint, valve in simulated.valves.items():
        more = GAIN_DIFFERENCE * signs.get(joint, 0.0)
        edges = Edges(
            supply_a=1.0 + more, b_tank=1.0 + more, supply_b=1.0 - more, a_tank=1.0 - more
        )
        valves[joint] = valve.model_copy(update={"edges": edges})
    simulated = simulated.model_copy(update={"valves": valves})
    effects = [
        InjectedEffect(
            effect="load_friction", joint=joints[0], form="weight", relative_magnitude=SHARE
        ),
        InjectedEffect(effect="seal_friction", joint=joints[1], relative_magnitude=SHARE),
        InjectedEffect(effect="position_friction", joint=joints[2], relative_magnitude=SHARE),
    ]
    for joint, sign in signs.items():
        width, offset = {"width": HYSTERESIS_SHARE}, {"offset": sign * ZERO, "recovery": 0.0}
        effects.append(InjectedEffect(effect="valve_hysteresis", joint=joint, parameters=width))
        effects.append(InjectedEffect(effect="pressure_offset", joint=joint, parameters=offset))
    gains = load_gains(machine_file("controller.yaml"), machine)
    spec = Spec(seed=4, effects=tuple(effects))
    return Observed(machine, simulated, injected_in(spec, machine, simulated, gains), gains)
