"""A simulated crane behind a bus, under a controller of `crane_trajectory.control`, 200 Hz."""

from typing import NamedTuple

import numpy as np
from benchmarks.controlled_machines import Controlled

from crane_model.machine_files import machine_file
from crane_sim import Sensors, SimulatedRecording, record
from crane_sim.plant.closed_loop import BUS_DELAY_S, REST_S, LatePlant
from crane_trajectory import Motion
from crane_trajectory.control.controller import (
    ControlCondition,
    Controller,
    SensorReading,
    Wanted,
    WrappedController,
    load_gains,
)

SWINGS = 3.0  # Hz, above which speed beside the reference is ripple


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
        time = recording.time - REST_S
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


class Watched(WrappedController):
    """A controller that is told the phase of the motion; the gravest condition is kept."""

    def __init__(self, controller: Controller, motion: Motion):
        super().__init__(controller)
        self._motion = motion
        self._time = -REST_S
        self.worst = ControlCondition.AT_REST

    def command(self, dt: float, reading: SensorReading, wanted: Wanted) -> np.ndarray:
        self._time += dt
        told = wanted._replace(phase=_phase(self._motion, self._time))
        answer = super().command(dt, reading, told)
        self.worst = max(self.worst, *self.conditions)
        return answer


def drive(
    motion: Motion,
    machine: Controlled,
    controller: Controller,
    late: float = 0.0,
    plant: type[LatePlant] = LatePlant,
) -> Run:
    """From rest to rest, `late` s later than the live suite is."""
    behind = plant(
        machine.simulated, machine.machine, motion.start, machine.hidden, BUS_DELAY_S + late, seed=7
    )
    sensors = Sensors(machine.simulated.sensors, machine.machine, 0)
    gains = load_gains(machine_file("controller.yaml", machine.name), machine.machine)
    watched = Watched(controller, motion)
    return Run(motion, record(motion, behind, sensors, gains, controller=watched), watched.worst)


def _phase(motion: Motion, time: float) -> float:
    if not motion.excitation_start <= time < motion.excitation_end:
        return np.nan
    return (time - motion.excitation_start) % motion.trajectory.period
