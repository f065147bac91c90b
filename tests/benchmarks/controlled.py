"""A stand-in machine under a controller of `crane_trajectory.control`, in a loop with delay.

200 Hz; the command that answers a reading is in force 5 ms + U(0, 10) ms later and held.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from benchmarks.controlled_machines import Controlled

from crane_driver.velocity_filter import VelocityFilter
from crane_sim.plant.closed_loop import REST, SimulatedRecording, TrueStates
from crane_sim.plant.plant import Plant
from crane_sim.plant.sampled import Pressures, Sensors
from crane_trajectory.control.interface import (
    ControlCondition,
    Controller,
    Point,
    SensorReading,
    Wanted,
)
from crane_trajectory.motion.motion import Motion

DELAY, SPREAD = 0.005, 0.010  # s
SWINGS = 3.0  # Hz, above which speed beside the reference is ripple
EachCycle = Callable[[float, Plant], None]


class Score(NamedTuple):
    """What a run over whole periods came to, (j,) each [mrad, mm, s]."""

    rms: np.ndarray
    time: np.ndarray  # s, largest error over largest speed
    ripple: np.ndarray  # mrad/s, mm/s, above `SWINGS`
    valve: np.ndarray  # way of the command in a second


class Run(NamedTuple):
    """What happened from rest to rest."""

    motion: Motion
    recording: SimulatedRecording
    worst: ControlCondition

    def score(self, period: int | None = None) -> Score:
        """Over all periods, or that one."""
        motion, recording = self.motion, self.recording
        begin, end = motion.excitation_start, motion.excitation_end
        if period is not None:
            begin += period * motion.trajectory.period
            end = begin + motion.trajectory.period
        time = recording.time - REST
        inside = (time >= begin) & (time < end)
        wanted, truth = recording.reference, recording.truth
        error = (wanted.position - truth.position)[inside]
        beside = (truth.velocity - wanted.velocity)[inside]
        tick = float(np.median(np.diff(time)))
        spectrum = np.fft.rfft(beside, axis=0)
        spectrum[np.fft.rfftfreq(len(beside), tick) < SWINGS] = 0.0
        swings = np.fft.irfft(spectrum, len(beside), axis=0)
        fastest = np.abs(wanted.velocity[inside]).max(0)
        return Score(
            1e3 * np.sqrt(np.mean(error**2, axis=0)),
            np.abs(error).max(0) / np.maximum(fastest, 1e-9),
            1e3 * np.sqrt(np.mean(swings**2, axis=0)),
            np.abs(np.diff(recording.command[inside], axis=0)).sum(0) / (inside.sum() * tick),
        )


def drive(
    motion: Motion,
    machine: Controlled,
    controller: Controller,
    late: float = 0.0,
    each: EachCycle | None = None,
) -> Run:
    """From rest to rest, `late` s later than the loop is; `each` sees every cycle."""
    stand_in, joints = machine.stand_in, machine.joints
    plant = Plant(stand_in, machine.machine, motion.start, machine.hidden)
    sensors, chain = Sensors(stand_in.sensors, machine.machine, 0), stand_in.sensors
    fitted = [joints.index(name) for name in sensors.cylinders]
    count = round((motion.duration + 2.0 * REST) / chain.period)
    times = sensors.instants(chain.period, count)
    now = motion.reference(times - REST)
    ahead = motion.reference(times - REST + controller.preview)
    delays = np.random.default_rng(7).uniform(DELAY, DELAY + SPREAD, count) + late
    effect = np.maximum.accumulate(times + delays)
    filtered = VelocityFilter(
        [stand_in.jerk_density[joint] for joint in joints],
        [chain.encoder_resolution[joint] for joint in joints],
    )
    position, velocity, commands, q, v, a, p_a, p_b = np.zeros((8, count, len(joints)))
    read: list[Pressures] = []
    u, sent, worst = np.zeros(len(joints)), 0, ControlCondition.AT_REST
    controller.start(u)
    for k, time in enumerate(times.tolist()):
        while sent < k and effect[sent] <= time:
            plant.advance(u, max(float(effect[sent]) - plant.time, 1e-9))
            u, sent = commands[sent], sent + 1
        plant.advance(u, time - plant.time)
        if each is not None:
            each(time - REST, plant)
        q[k], v[k], a[k] = plant.q, plant.v, plant.acceleration
        p_a[k], p_b[k] = plant.pressure_a, plant.pressure_b
        position[k] = sensors.positions(q[k])
        _, velocity[k], _ = filtered.update(time, position[k])
        supply, tank = np.array([plant.supply_pressure]), plant.tank_pressure
        shown = sensors.pressures(p_a[k : k + 1], p_b[k : k + 1], supply, tank)
        read.append(shown)
        chambers = np.full((2, len(joints)), np.nan)
        chambers[:, fitted] = shown.chamber_a[0], shown.chamber_b[0]
        reading = SensorReading(position[k], velocity[k], *chambers, float(shown.supply[0]))
        points = [Point(*(part[k] for part in one[:3])) for one in (now, ahead)]
        dt = time - float(times[k - 1]) if k else chain.period
        commands[k] = controller.command(dt, reading, Wanted(*points, _phase(motion, time - REST)))
        worst = max(worst, *controller.conditions)
    nothing = np.zeros((0, count, len(joints)))
    recording = SimulatedRecording(
        times,
        position,
        velocity,
        Pressures(*(np.concatenate(parts) for parts in zip(*read, strict=True))),
        sensors.cylinders,
        commands,
        now,
        TrueStates(times, q, v, a, p_a, p_b, nothing, nothing),
    )
    return Run(motion, recording, worst)


def _phase(motion: Motion, time: float) -> float:
    if not motion.excitation_start <= time < motion.excitation_end:
        return np.nan
    return (time - motion.excitation_start) % motion.trajectory.period
