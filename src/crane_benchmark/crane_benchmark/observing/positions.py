"""The position sensor on machines at work, beside flow alone and a filter that knows no load."""

from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.stats import chi2

from crane_benchmark.observing.consistency import Consistency, FreedomWatch
from crane_benchmark.observing.machines import Observed
from crane_model.kinematics import tip_position
from crane_model.model_file import Model
from crane_observer.position.replay import EstimatedCourse, replay, replay_smoothed
from crane_observer.position.sensor import ENCODER, PositionSensor
from crane_observer.position.state import Trust
from crane_observer.recording import HeardRecording
from crane_sim.plant.closed_loop import SimulatedRecording

NO_FORCE = 1e12  # Pa, noise of a force balance that is not to count
OFF = 0.3  # rad or m
CONVERGED = 60.0  # s of motion


class Errors(NamedTuple):
    """RMS over a run."""

    joints: np.ndarray  # (j,) rad, m
    tip: float  # m
    nees: float  # normalised error squared of the joints without encoder, over their number
    inside: float  # share of the windows in which they are in their 95 % ellipsoid

    def shown(self, joint: int | None) -> float:
        """Of a joint [mrad, mm], or of the tip [cm]."""
        return 1e2 * self.tip if joint is None else 1e3 * float(self.joints[joint])


class Kind(NamedTuple):
    """An observer, by what it trusts."""

    name: str

    def trust(self, model: Model) -> Trust:
        """Of this model."""
        full = Trust.of(model)
        if self is FLOW:
            return replace(full, noise=NO_FORCE)
        if self is NO_LOAD:
            return replace(full, load=0.0, load_drift=0.0)
        return full


FILTER, FLOW, NO_LOAD = Kind("position sensor"), Kind("flow alone"), Kind("without load")


def heard(made: SimulatedRecording, model: Model, observed: Observed) -> HeardRecording:
    """What the sensors of the joints of the model showed."""
    time = made.time - made.time[0]
    columns = [observed.machine.index(joint) for joint in model.joints]
    rows = [made.cylinders.index(joint) for joint in model.joints]
    pressures = made.pressures
    return HeardRecording(
        Path("made"), 0, time, made.position[:, columns], time, pressures.chamber_a[:, rows],
        pressures.chamber_b[:, rows], pressures.supply, time, made.command[:, columns],
    )  # fmt: skip


class ObservedRecording(NamedTuple):
    """A recording of a machine, and the model that was identified of it."""

    observed: Observed
    made: SimulatedRecording
    model: Model

    def observe(self, hidden: np.ndarray, kind: Kind, off: float = 0.0) -> Errors:
        """From a start that is known, or `off` by so much and only trusted so far; errors of such
        a start count when it has had time to converge.
        """
        recording = heard(self.made, self.model, self.observed)
        course = replay(self._sensor(recording, hidden, kind, off), recording, hidden)
        return self._errors(recording, course, hidden, off)

    def observe_and_smooth(
        self, hidden: np.ndarray, off: float = 0.0
    ) -> tuple[Errors, Errors, Consistency]:
        """The same by the position sensor, and with all that came later."""
        recording = heard(self.made, self.model, self.observed)
        sensor = self._sensor(recording, hidden, FILTER, off)
        (one,) = sensor.hypotheses.filters
        watch = FreedomWatch(one, hidden, _counted_from(off))
        course, smoothed = replay_smoothed(sensor, recording, hidden, watch)
        told = self._errors(recording, course, hidden, off)
        return (
            told,
            self._errors(recording, smoothed, hidden, off),
            Consistency(told.nees, watch.freedom),
        )

    def _sensor(
        self, recording: HeardRecording, hidden: np.ndarray, kind: Kind, off: float
    ) -> PositionSensor:
        limits = [self.observed.machine.limits[joint] for joint in self.model.joints]
        start = np.clip(
            recording.encoders[0] + np.where(hidden, off, 0.0),
            [one.position_min for one in limits],
            [one.position_max for one in limits],
        )
        return PositionSensor(self.model, start, max(off, ENCODER), kind.trust(self.model))

    def _errors(
        self, recording: HeardRecording, course: EstimatedCourse, hidden: np.ndarray, off: float
    ) -> Errors:
        machine = self.observed.machine
        columns = [machine.index(joint) for joint in self.model.joints]
        truth = self.made.truth.position.T
        true = np.stack([np.interp(course.time, recording.encoder_time, q) for q in truth], axis=1)
        whole = true.copy()
        whole[:, columns] = course.position
        counted = course.time > _counted_from(off)
        error = (whole - true)[counted][:, columns]
        tip = np.linalg.norm(
            tip_position(machine, whole[counted]) - tip_position(machine, true[counted]), axis=1
        )
        places = np.flatnonzero(hidden)
        covariance = course.covariance[counted][:, places][:, :, places]
        away = error[:, places]
        squared = np.einsum("ni,nij,nj->n", away, np.linalg.inv(covariance), away)
        return Errors(
            np.sqrt((error**2).mean(axis=0)),
            float(np.sqrt((tip**2).mean())),
            float(squared.mean()) / len(places),
            float((squared < chi2.ppf(0.95, len(places))).mean()),
        )


def _counted_from(off: float) -> float:
    """s, from which on errors count."""
    return CONVERGED if off else 0.0
