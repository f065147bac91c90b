"""The simulated crane under a controller, as a recording of its sensors would show it."""

from collections import deque
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from crane_driver.velocity_filter import VelocityFilter
from crane_model.errors import ConfigurationError, RangeError
from crane_model.hydraulics.simulation import IdentifiedSimulation
from crane_model.machine import Machine
from crane_model.model_file import Model
from crane_sim.effects.form import InjectedForm
from crane_sim.parts.parameters import SimulatedCrane
from crane_sim.plant.plant import Plant
from crane_sim.plant.sampled import MachineInMotion, Pressures, RecordedMachine, Sensors
from crane_trajectory.control.controller import (
    Controller,
    Gains,
    Point,
    SensorReading,
    Wanted,
    command,
)
from crane_trajectory.motion.motion import Reference


class Led:
    """Answers what sensors show, cycle by cycle, from rest."""

    def __init__(
        self,
        controller: Controller,
        plant: MachineInMotion,
        sensors: Sensors,
        now: Reference,
        ahead: Reference,
    ):
        """`now` is the reference of each cycle, `ahead` the one `controller.preview` later."""
        joints = plant.machine.joint_names
        self._controller, self._plant, self._sensors = controller, plant, sensors
        self._now, self._ahead = now, ahead
        self._fitted = [joints.index(name) for name in sensors.cylinders]
        self._nothing = np.full(len(joints), np.nan)
        self._last: float | None = None
        self._read: list[Pressures] = []
        controller.start(np.zeros(len(joints)))

    def command(self, k: int, time: float, q: np.ndarray, velocity: np.ndarray) -> np.ndarray:
        """Commands (j,) that answer what encoders show (j,), (j,) in cycle k, at its time [s]."""
        plant, at = self._plant, np.array([time])
        chambers = plant.pressure_a[np.newaxis], plant.pressure_b[np.newaxis]
        read = self._sensors.pressures(
            *chambers, np.array([plant.supply_pressure]), plant.tank_pressure, at
        )
        self._read.append(read)
        p_a, p_b = self._nothing.copy(), self._nothing.copy()
        p_a[self._fitted], p_b[self._fitted] = read.chamber_a[0], read.chamber_b[0]
        now, ahead = (
            Point(*(part[k] for part in reference[:3])) for reference in (self._now, self._ahead)
        )
        dt = 0.0 if self._last is None else time - self._last
        self._last = time
        reading = SensorReading(q, velocity, p_a, p_b, float(read.supply[0]))
        return self._controller.command(dt, reading, Wanted(now, ahead))

    @property
    def pressures(self) -> Pressures:
        return Pressures(*(np.concatenate(parts) for parts in zip(*self._read, strict=True)))


REST_S = 1.0  # recorded at rest before and after the motion

Steps = Callable[[Iterable[int]], Iterable[int]]


class Course(Protocol):
    """Reference course from rest to rest, as in `crane_trajectory.motion.motion`."""

    @property
    def start(self) -> np.ndarray:
        """(j,) where it rests at time 0 [rad, m]."""

    @property
    def duration(self) -> float:
        """Until it is at rest again [s]."""

    def reference(self, time: np.ndarray) -> Reference:
        """At time (n,) [s]."""

    def probe(self, time: np.ndarray) -> np.ndarray:
        """Signal added to the commands at time (n,) [s]: (n, j)."""


@dataclass(frozen=True)
class States:
    """True states at n instants; an axis of j follows the joints."""

    time: np.ndarray  # (n,) s since the machine was started
    position: np.ndarray  # (n, j) rad, m
    velocity: np.ndarray  # (n, j)
    acceleration: np.ndarray  # (n, j)
    pressure_a: np.ndarray  # (n, j) Pa
    pressure_b: np.ndarray  # (n, j)


@dataclass(frozen=True)
class TrueStates(States):
    """States hidden in a real machine, at the n instants of a recording; k injected effects."""

    injected_force: np.ndarray  # (k, n, j) N m, N
    injected_flow: np.ndarray  # (k, n, j) m3/s


@dataclass(frozen=True)
class SimulatedRecording:
    """n cycles of the controller; (n, j) from the base to the tip."""

    time: np.ndarray  # (n,) s since the machine was started, when the sensors were read
    position: np.ndarray  # (n, j) rad, m: encoder readings
    velocity: np.ndarray  # (n, j) rad/s, m/s: the driver's filter; NaN in the first sample
    pressures: Pressures
    cylinders: tuple[str, ...]  # the columns of `pressures`
    command: np.ndarray  # (n, j) -1..1
    reference: Reference
    truth: TrueStates


def record(
    motion: Course,
    plant: RecordedMachine,
    sensors: Sensors,
    gains: Gains,
    progress: Steps = iter,
    controller: Controller | None = None,
) -> SimulatedRecording:
    """Lead the plant, which rests where the motion starts, through the motion and to rest again.

    Each cycle reads the sensors, filters the velocity and commands the valves; they stay closed
    until a velocity is known.

    Parameters
    ----------
    motion
        Where the crane is to go.
    plant
        The simulated crane.
    sensors
        What is shown of it.
    gains
        Of the controller (36).
    progress
        Wraps the cycles, as tqdm does.
    controller
        Leads the crane in place of (36).

    Returns
    -------
    Readings, commands and reference of all cycles, and what truly happened.
    """
    chain, density = plant.parameters.sensors, plant.parameters.jerk_density
    joints = plant.machine.joint_names
    count = round((motion.duration + 2.0 * REST_S) / chain.period)
    begin = plant.time
    times = sensors.instants(begin + chain.period, count)
    reference = motion.reference(times - begin - REST_S)
    added = motion.probe(times - begin - REST_S)
    led = None
    if controller is not None:
        ahead = motion.reference(times - begin - REST_S + controller.preview)
        led = Led(controller, plant, sensors, reference, ahead)
    velocity_filter = VelocityFilter(
        [density[joint] for joint in joints], chain.equivalent_counts(joints)
    )
    position, velocity, commands, q, v, a, p_a, p_b = np.zeros((8, count, len(joints)))
    force, flow = np.zeros((2, len(plant.injected_force), count, len(joints)))
    supply = np.empty(count)
    arrays, u = gains.arrays, np.zeros(len(joints))
    for k in progress(range(count)):
        time = float(times[k])
        plant.leak(sensors.timed.passed(plant.time))
        spools = sensors.timed.commands(plant.time, commands[k - 1])  # zero before the first
        plant.advance(spools, time - plant.time)
        q[k], v[k] = plant.q, plant.v
        a[k] = plant.acceleration
        if len(force):
            force[:, k], flow[:, k] = plant.injected_force, plant.injected_flow
        p_a[k], p_b[k], supply[k] = plant.pressure_a, plant.pressure_b, plant.supply_pressure
        position[k] = sensors.positions(q[k], time)
        _, velocity[k], _ = velocity_filter.update(time, position[k])
        if led is not None:
            u = led.command(k, time, position[k], velocity[k])
        elif not np.isnan(velocity[k]).any():
            u = command(
                arrays,
                *(position[k], velocity[k], reference.position[k], reference.velocity[k]),
                units=plant.machine.units,
            )
        commands[k] = np.clip(u + added[k], -1.0, 1.0)
    shown = (
        sensors.pressures(p_a, p_b, supply, plant.tank_pressure, times)
        if led is None
        else led.pressures
    )
    return SimulatedRecording(
        time=times,
        position=position,
        velocity=velocity,
        pressures=shown,
        cylinders=sensors.cylinders,
        command=commands,
        reference=reference,
        truth=TrueStates(times, q, v, a, p_a, p_b, force, flow),
    )


# A plant behind a bus: commands come into force some time after they were given.

BUS_DELAY_S, BUS_SPREAD_S = 0.005, 0.010  # s, of the bus and the computers of the live suite
MIN_STEP_S = 1e-6  # below which nothing is simulated


def mean_delay(period: float, delay: float = BUS_DELAY_S, spread: float = BUS_SPREAD_S) -> float:
    """Mean delay of a command that is given every `period` s [s].

    A command waits for those before it, so the mean lies above `delay` + `spread` / 2: of the
    latest of `spread` U_j - j `period`, U_j evenly drawn from 0 to 1.
    """
    before = period * np.arange(np.ceil(spread / period))

    def later_than(wait: float) -> float:
        return float(1.0 - np.prod(np.minimum((wait + before) / spread, 1.0)))

    kinks = (spread - before)[1:]
    from scipy.integrate import quad  # half a second, for the few that ask

    return delay + float(quad(later_than, 0.0, spread, points=kinks)[0])


class LatePlant(Plant):
    """Each command is in force `delay` s and up to `spread` s more, evenly drawn, after it was
    given; a bus keeps the order. What was given stays in force until then.
    """

    def __init__(
        self,
        parameters: SimulatedCrane,
        machine: Machine,
        q0: np.ndarray,
        effects: Sequence[InjectedForm] = (),
        delay: float = BUS_DELAY_S,
        spread: float = BUS_SPREAD_S,
        seed: int = 0,
    ):
        """As `Plant` has it; delays are drawn by `seed`."""
        super().__init__(parameters, machine, q0, effects)
        self._delay, self._spread = delay, spread
        self._rng = np.random.default_rng([seed, 7])
        self._waiting: deque[tuple[float, np.ndarray]] = deque()
        self._in_force = np.zeros(len(machine.joint_names))

    def advance(self, command: np.ndarray, duration: float) -> None:
        """As `Plant` has it; `command` (j,) is given now."""
        begin = self.time
        due = begin + self._delay + self._rng.uniform(0.0, self._spread)
        if self._waiting:
            due = max(due, self._waiting[-1][0])
        self._waiting.append((due, np.array(command, dtype=float)))
        while self._waiting and self._waiting[0][0] < begin + duration:
            due, following = self._waiting.popleft()
            self._run(due - self.time)
            self._in_force = following
        self._run(begin + duration - self.time)

    def _run(self, duration: float) -> None:
        if duration > MIN_STEP_S:
            super().advance(self._in_force, duration)


# The identified simulation of a crane in place of the simulated one.


class IdentifiedPlant:
    """A `MachineInMotion`. Joints whose hydraulics the model lacks stand where they are.

    The lag of the loop is left out of the valves: what carries the commands here has one of its
    own.
    """

    def __init__(self, model: Model, machine: Machine, q0: np.ndarray):
        """At rest at q0 (j,); `ConfigurationError` for a wrong model, `RangeError` for q0."""
        if model.machine is None or model.machine.model_dump() != machine.model_dump():
            raise ConfigurationError(
                f"model '{model.name}' was not identified with the machine {machine.name}, as its "
                "file has it now; name its machine by --machine, or identify it again"
            )
        self.machine = machine
        self._columns = [machine.index(joint) for joint in model.joints]
        self._identified = IdentifiedSimulation(model, q0[np.newaxis, self._columns])
        self._q = np.array(q0, dtype=float)
        self.tank_pressure = machine.hydraulics.tank_pressure

    @property
    def standing(self) -> tuple[str, ...]:
        return tuple(
            joint for joint in self.machine.joint_names if joint not in self._identified.joints
        )

    def advance(self, command: np.ndarray, duration: float) -> None:
        self._identified.advance(np.asarray(command)[np.newaxis, self._columns], duration)

    def leak(self, passed: np.ndarray) -> None:
        if passed.any():
            raise RangeError("the pistons of an identified crane leak as its model says, not more")

    @property
    def q(self) -> np.ndarray:
        now = self._q.copy()
        now[self._columns] = self._identified.position[0]
        return now

    @property
    def pressure_a(self) -> np.ndarray:
        """(j,) Pa; half of the supply's where the joint stands."""
        return self._pressures(self._identified.pressures.chamber_a)

    @property
    def pressure_b(self) -> np.ndarray:
        """(j,) Pa; half of the supply's where the joint stands."""
        return self._pressures(self._identified.pressures.chamber_b)

    @property
    def supply_pressure(self) -> float:
        return float(self._identified.pressures.supply[0])

    def _pressures(self, of_the_model: np.ndarray) -> np.ndarray:
        found = np.full(len(self._q), 0.5 * self.supply_pressure)
        found[self._columns] = of_the_model[0]
        return found
