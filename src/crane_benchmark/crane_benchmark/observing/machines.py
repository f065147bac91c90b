"""The machines that are observed, and recordings of them."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from crane_benchmark.observing.cycles import LiftingPlant, WorkCycles
from crane_model.machine import Machine, load_machine
from crane_model.machine_files import machine_file
from crane_sim.effects.form import Planted
from crane_sim.effects.sensing import faults
from crane_sim.faulty.faults import Faults
from crane_sim.hiding.calibrate import hidden_in
from crane_sim.hiding.spec import HiddenEffect, Spec
from crane_sim.parts.parameters import Edges, StandIn, load_stand_in
from crane_sim.plant.closed_loop import SimulatedRecording, Steps, record
from crane_sim.plant.sampled import Sensors
from crane_trajectory.control.controller import Gains, load_gains

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
        `failing`: faults as `crane_sim.faulty.faults.Faults` has them; `hung` as
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
