"""The stand-in machine under a controller of `crane_trajectory.control`, in a loop with delay.

200 Hz; the command that answers a reading is in force 5 ms + U(0, 10) ms later and held.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from benchmarks.controlled_machines import JOINTS, MACHINE, Controlled

from crane_driver.velocity_filter import VelocityFilter
from crane_sim.plant.closed_loop import Course
from crane_sim.plant.plant import Plant
from crane_sim.plant.sampled import Sensors
from crane_trajectory.control.interface import (
    ControlCondition,
    Controller,
    Point,
    SensorReading,
    Wanted,
)

REST = 1.0  # s before and after the motion
DELAY, SPREAD = 0.005, 0.010  # s
SWINGS = 3.0  # Hz, above which speed beside the reference is ripple


class Score(NamedTuple):
    """What a run over whole periods came to, (j,) each [mrad, mm, s]."""

    rms: np.ndarray
    largest: np.ndarray
    time: np.ndarray  # s, largest error over largest speed
    ripple: np.ndarray  # mrad/s, mm/s, above `SWINGS`
    valve: np.ndarray  # way of the command in a second
    worst: ControlCondition


def drive(
    motion: Course,
    machine: Controlled,
    controller: Controller,
    late: float = 0.0,
    each: Callable[[float, Plant], None] | None = None,
    begin: float = 0.0,
    end: float = np.inf,
) -> Score:
    """One run from rest to rest, `late` s later than the loop is; `each` sees every cycle.

    Scored between the times `begin` and `end` of the motion [s].
    """
    stand_in = machine.stand_in
    plant = Plant(stand_in, MACHINE, motion.start, machine.hidden)
    sensors, chain = Sensors(stand_in.sensors, MACHINE, 0), stand_in.sensors
    fitted = [JOINTS.index(name) for name in sensors.cylinders]
    count = round((motion.duration + 2.0 * REST) / chain.period)
    times = sensors.instants(chain.period, count)
    now = motion.reference(times - REST)
    ahead = motion.reference(times - REST + controller.preview)
    delays = np.random.default_rng(7).uniform(DELAY, DELAY + SPREAD, count) + late
    effect = np.maximum.accumulate(times + delays)
    filtered = VelocityFilter(
        [stand_in.jerk_density[joint] for joint in JOINTS],
        [chain.encoder_resolution[joint] for joint in JOINTS],
    )
    error, velocity, commands = np.zeros((3, count, len(JOINTS)))
    u, sent, worst = np.zeros(len(JOINTS)), 0, ControlCondition.AT_REST
    controller.start(u)
    for k, time in enumerate(times.tolist()):
        while sent < k and effect[sent] <= time:
            plant.advance(u, max(float(effect[sent]) - plant.time, 1e-9))
            u, sent = commands[sent], sent + 1
        plant.advance(u, time - plant.time)
        if each is not None:
            each(time - REST, plant)
        position = sensors.positions(plant.q)
        _, slope, _ = filtered.update(time, position)
        shown = sensors.pressures(
            plant.pressure_a[None], plant.pressure_b[None],
            np.array([plant.supply_pressure]), plant.tank_pressure,
        )  # fmt: skip
        p_a, p_b = np.full((2, len(JOINTS)), np.nan)
        p_a[fitted], p_b[fitted] = shown.chamber_a[0], shown.chamber_b[0]
        reading = SensorReading(position, slope, p_a, p_b, float(shown.supply[0]))
        points = [Point(*(part[k] for part in reference[:3])) for reference in (now, ahead)]
        dt = time - float(times[k - 1]) if k else chain.period
        commands[k] = controller.command(dt, reading, Wanted(*points))
        worst = max(worst, *controller.conditions)
        error[k], velocity[k] = now.position[k] - plant.q, plant.v
    inside = (times - REST >= begin) & (times - REST < end)
    beside = velocity[inside] - now.velocity[inside]
    spectrum = np.fft.rfft(beside, axis=0)
    spectrum[np.fft.rfftfreq(len(beside), chain.period) < SWINGS] = 0.0
    largest, fastest = np.abs(error[inside]).max(0), np.abs(now.velocity[inside]).max(0)
    return Score(
        1e3 * np.sqrt(np.mean(error[inside] ** 2, axis=0)),
        1e3 * largest,
        largest / np.maximum(fastest, 1e-9),
        1e3 * np.sqrt(np.mean(np.fft.irfft(spectrum, len(beside), axis=0) ** 2, axis=0)),
        np.abs(np.diff(commands[inside], axis=0)).sum(0) / (inside.sum() * chain.period),
        worst,
    )
