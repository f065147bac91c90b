"""The stand-in machine under a controller, as a recording of its sensors would show it."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from crane_driver.velocity_filter import VelocityFilter
from crane_sim.plant.led import Led
from crane_sim.plant.machine_in_motion import RecordedMachine
from crane_sim.plant.sampled import Pressures, Sensors
from crane_trajectory.control.controller import Gains, command
from crane_trajectory.control.interface import Controller
from crane_trajectory.motion.motion import Reference

REST = 1.0  # s, recorded at rest before and after the motion

Steps = Callable[[Iterable[int]], Iterable[int]]


class Course(Protocol):
    """Where the crane is led, from rest to rest, as `crane_trajectory.motion.motion` has it."""

    @property
    def start(self) -> np.ndarray:
        """(j,) where it rests at time 0 [rad, m]."""

    @property
    def duration(self) -> float:
        """Until it is at rest again [s]."""

    def reference(self, time: np.ndarray) -> Reference:
        """At time (n,) [s]."""

    def probe(self, time: np.ndarray) -> np.ndarray:
        """What is added to the commands at time (n,) [s]: (n, j)."""


@dataclass(frozen=True)
class States:
    """What truly happened, at n instants; an axis of j follows the joints."""

    time: np.ndarray  # (n,) s since the machine was started
    position: np.ndarray  # (n, j) rad, m
    velocity: np.ndarray  # (n, j)
    acceleration: np.ndarray  # (n, j)
    pressure_a: np.ndarray  # (n, j) Pa
    pressure_b: np.ndarray  # (n, j)


@dataclass(frozen=True)
class TrueStates(States):
    """What no real machine shows, at the n instants of a recording; k effects are hidden."""

    hidden_force: np.ndarray  # (k, n, j) N m, N
    hidden_flow: np.ndarray  # (k, n, j) m3/s


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

    Each cycle reads the sensors, filters the velocity and commands the valves, by (36) with `gains`
    or by the `controller`; the valves stay closed until a velocity is known. `progress` wraps the
    cycles, as tqdm does.
    """
    chain, density = plant.parameters.sensors, plant.parameters.jerk_density
    joints = plant.machine.joint_names
    count = round((motion.duration + 2.0 * REST) / chain.period)
    begin = plant.time
    times = sensors.instants(begin + chain.period, count)
    reference = motion.reference(times - begin - REST)
    added = motion.probe(times - begin - REST)
    led = None
    if controller is not None:
        ahead = motion.reference(times - begin - REST + controller.preview)
        led = Led(controller, plant, sensors, reference, ahead)
    velocity_filter = VelocityFilter(
        [density[joint] for joint in joints], [chain.encoder_resolution[joint] for joint in joints]
    )
    position, velocity, commands, q, v, a, p_a, p_b = np.zeros((8, count, len(joints)))
    force, flow = np.zeros((2, plant.hidden_count, count, len(joints)))
    supply = np.empty(count)
    arrays, u = gains.arrays, np.zeros(len(joints))
    for k in progress(range(count)):
        time = float(times[k])
        plant.leak(sensors.timed.passed(plant.time))
        spools = sensors.timed.commands(plant.time, commands[k - 1])  # zero before the first
        plant.advance(spools, time - plant.time)
        q[k], v[k] = plant.q, plant.v
        a[k] = plant.acceleration
        if plant.hidden_count:
            force[:, k], flow[:, k] = plant.hidden_force, plant.hidden_flow
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
