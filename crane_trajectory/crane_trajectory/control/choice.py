"""The controllers by name, made from what is known of a machine, and those that learn."""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from crane_model.errors import ConfigurationError
from crane_model.hydraulics import HydraulicValues, Measured
from crane_model.machine import Machine
from crane_model.model_file import Model
from crane_trajectory.control.controller import (
    STOP_RATE,
    ControlCondition,
    Controller,
    GainArrays,
    PdDeadBand,
    SensorReading,
    Wanted,
    WrappedController,
)
from crane_trajectory.control.dead_time import PredictiveFlow
from crane_trajectory.control.flow_feedforward import FlowFeedforward, feedback_gains
from crane_trajectory.control.valves_and_oil import identified


class ModelLaw(NamedTuple):
    """Control law that uses the model, as `FlowFeedforward` does."""

    pressures: bool = True
    adaptive: bool = False
    by_force: bool = False


PD_DEAD_BAND = "pd_dead_band"
OF_THE_MODEL = {
    "flow_feedforward": ModelLaw(pressures=False),
    "flow_and_pressures": ModelLaw(),
    "adaptive_flow": ModelLaw(adaptive=True),
    "computed_force": ModelLaw(by_force=True),
}
"""Those that need an identified model."""
PREDICTIVE = "predictive_flow"
NAMES = (PD_DEAD_BAND, *OF_THE_MODEL, PREDICTIVE)
MAY_LEARN = ("flow_feedforward", "flow_and_pressures")

SUITED, SUITED_TO_SHARED_PUMP = "flow_and_pressures", PREDICTIVE


def suited_controller(machine: Machine) -> str:
    """Return the controller with which a fitted model is tried first: with load sensing, pressures
    tell the loads of all joints, and the valves are slow.
    """
    return SUITED if machine.hydraulics.load_sensing is None else SUITED_TO_SHARED_PUMP


COURSE_STEP = 0.005  # s, of the learnt course
LEARNING_GAIN = 0.5
CUT_OFF = 3.0  # Hz
FADING = 0.5  # s, in which it is mixed in and out
LARGEST_LEARNT = 0.1  # of the largest speed: what may be learnt
MOST_MISSING = 0.05  # of a period, from which is still learnt


class LearntDirection(NamedTuple):
    """A direction of a cylinder, and where a model file has its dead band and gains at A and B."""

    name: str
    dead_band: str
    gains: tuple[str, str]


DIRECTIONS = (
    LearntDirection("extending", "dead_band_a", ("supply_a", "b_tank")),
    LearntDirection("retracting", "dead_band_b", ("a_tank", "supply_b")),
)
LEARNT_PROVENANCE = "; dead bands and flow gains learnt while following"


class Learning(WrappedController):
    """A controller that uses the model and learns a reference of a period [s].

    Iterative learning: what a periodic reference needs beside what its controller already does.
    From each whole period the errors e give the next one a velocity beside the reference,

        v <- Q [v + gain (e' + kv e + ki Int(e))]

    what the feedback did, and what it had yet to do. Q passes frequencies up to `CUT_OFF` without a
    shift of phase. Where oil swings below that, the loop answers so late that learning makes the
    error grow; where only noise is left, it wanders. So each harmonic of each joint is judged by
    itself: one whose error has grown goes back to what it had before, is measured anew, and from
    then on goes only half as far. Harmonics of a nearly linear loop do not mix, hence none ends
    worse than it was, but for noise, and learning stops where there is nothing to learn.
    """

    def __init__(self, controller: Controller, led: FlowFeedforward, period: float):
        """`led` is the controller, or the part of it that uses the model."""
        super().__init__(controller)
        self.led = led
        self._gains, self._columns = led.gains, led.columns
        count = max(round(period / COURSE_STEP), 2)
        self._period = period
        joints = len(self._gains)
        self.learnt = np.zeros((count, joints))  # rad/s, m/s over the period
        harmonics = (count // 2 + 1, joints)
        self._pace = np.ones(harmonics)  # share of the way to the next v
        self._kept = np.zeros(harmonics, dtype=complex)  # spectrum of the best v so far
        self._least = np.full(harmonics, np.inf)  # error with it; inf: to be measured
        self._errors = np.full((count, joints), np.nan)
        self._phase = np.nan
        self._share = 0.0

    def start(self, command: np.ndarray) -> None:
        self._phase, self._share = np.nan, 0.0
        self._errors[:] = np.nan
        super().start(command)

    def command(self, dt: float, reading: SensorReading, wanted: Wanted) -> np.ndarray:
        phase = wanted.phase
        periodic = bool(np.isfinite(phase))
        if periodic and phase < self._phase:
            self._learn()
        self._phase = phase
        if periodic:
            place = int(phase / self._period * len(self._errors)) % len(self._errors)
            error = wanted.now.position - reading.position
            self._errors[place] = error[self._columns]
        change = dt / FADING if periodic else -dt / FADING
        self._share = min(max(self._share + change, 0.0), 1.0)
        if self._share > 0.0 and periodic:
            course = np.arange(len(self.learnt)) * self._period / len(self.learnt)
            at = (phase + self.preview) % self._period
            more = [np.interp(at, course, learnt, period=self._period) for learnt in self.learnt.T]
            ahead = wanted.ahead
            velocity = ahead.velocity.copy()
            velocity[self._columns] += self._share * np.array(more)
            wanted = wanted._replace(ahead=ahead._replace(velocity=velocity))
        return super().command(dt, reading, wanted)

    def _learn(self) -> None:
        known = np.isfinite(self._errors).all(axis=1)
        if known.mean() < 1.0 - MOST_MISSING:
            self._errors[:] = np.nan
            return
        count = len(known)
        places = np.flatnonzero(known)
        errors = [np.interp(np.arange(count), places, joint_errors[places], period=count)
                  for joint_errors in self._errors.T]  # fmt: skip
        self._errors[:] = np.nan
        omega = 2j * np.pi * np.fft.rfftfreq(count, self._period / count)[1:, np.newaxis]
        kv, ki = self._gains["kv"], self._gains["ki"]
        step = np.fft.rfft(errors, axis=1).T
        size = np.abs(step)
        step[1:] *= omega + kv + ki / omega
        step[0] = 0.0  # the integral of the controller takes care of it
        learnt = np.fft.rfft(self.learnt, axis=0)
        wanted = learnt + LEARNING_GAIN * step
        wanted[1:] /= 1.0 + (np.abs(omega) / (2.0 * np.pi * CUT_OFF)) ** 4
        worse = size > self._least
        self._pace[worse] /= 2.0
        self._kept = np.where(worse, self._kept, learnt)
        self._least = np.where(worse, np.inf, size)
        spectrum = np.where(worse, self._kept, learnt + self._pace * (wanted - learnt))
        most = LARGEST_LEARNT * self._gains["largest_speed"]
        self.learnt = np.clip(np.fft.irfft(spectrum, count, axis=0), -most, most)


class SideBySide:
    """Some joints controlled by the model, the others by (36); where either stops, both do."""

    def __init__(self, led: FlowFeedforward, rest: PdDeadBand):
        self.led, self._rest = led, rest
        self.preview, self.by_model = led.preview, led.by_model
        self._last: np.ndarray | None = None

    def start(self, command: np.ndarray) -> None:
        """Take over where `command` (j,) was in force, without a jump."""
        self._last = np.array(command, dtype=float)
        self.led.start(self._last[self.led.columns])
        self._rest.start(self._last)

    def command(self, dt: float, reading: SensorReading, wanted: Wanted) -> np.ndarray:
        u = self._rest.command(dt, reading, wanted).copy()
        u[self.led.columns] = self.led.command(dt, reading, wanted)
        if self._last is not None and any(condition.stops for condition in self.conditions):
            size = np.maximum(np.abs(self._last) - STOP_RATE * dt, 0.0)
            u = np.copysign(size, self._last)
        self._last = u
        return u.copy()

    @property
    def conditions(self) -> tuple[ControlCondition, ...]:
        """Conditions of each joint, after the last command."""
        found = list(self._rest.conditions)
        for column, condition in zip(self.led.columns, self.led.conditions, strict=True):
            found[column] = condition
        return tuple(found)


def controller(
    name: str, machine: Machine, gains: GainArrays, model: Model | None = None, scale: float = 1.0
) -> Controller:
    """The controller called `name`; `gains` are those of (36), `scale` that of all others.

    Joints that the hydraulics of `model` lack are led by (36). `ConfigurationError` if the name is
    none of `NAMES`, or the model does not have what it needs or is that of another machine.
    """
    rest = PdDeadBand(gains)
    if name == PD_DEAD_BAND:
        return rest
    if name not in NAMES:
        raise ConfigurationError(f"no controller '{name}'; there are {', '.join(NAMES)}")
    if model is None or model.values is None or model.hydraulics is None:
        raise ConfigurationError(
            f"controller '{name}': needs an identified model with the hydraulics of "
            f"{machine.name}; identify it from a recording with valve commands, or use "
            f"{PD_DEAD_BAND}"
        )
    if model.machine is None or model.machine.model_dump() != machine.model_dump():
        raise ConfigurationError(
            f"controller '{name}': model '{model.name}' was not identified with the machine "
            f"{machine.name}, as its file has it now; identify it again"
        )
    known = model.hydraulics
    if name == PREDICTIVE:
        return PredictiveFlow(machine, model, known, scale)
    joints = tuple(joint for joint in machine.joint_names if joint in known.joints)
    feedback = feedback_gains(machine, model, scale, joints)
    hydraulics = identified(machine, known, joints)
    law = OF_THE_MODEL[name]
    led = FlowFeedforward(
        machine, model, hydraulics, feedback, law.pressures, law.adaptive, law.by_force, joints
    )
    return led if len(joints) == len(machine.joint_names) else SideBySide(led, rest)


def led_by_model(made: Controller | None) -> FlowFeedforward | None:
    """The part of a controller that uses the model; None where there is none."""
    if isinstance(made, Learning | SideBySide):
        return made.led
    return made if isinstance(made, FlowFeedforward) else None


def learning(name: str, made: Controller, period: float) -> Learning:
    """The controller `made` by its name, which learns a motion of that period [s], too.

    `ConfigurationError` if it is none of `MAY_LEARN`.
    """
    led = led_by_model(made)
    if name not in MAY_LEARN or led is None:
        raise ConfigurationError(
            f"controller '{name}': does not learn a periodic motion; {' and '.join(MAY_LEARN)} do"
        )
    return Learning(made, led, period)


def learnt_hydraulics(known: HydraulicValues, led: FlowFeedforward) -> HydraulicValues:
    """The values of which the controller was made, `known`, with what it has learnt since."""
    joints = dict(known.joints)
    for joint, learnt in zip(led.joints, led.memory.learnt, strict=True):
        valve = joints[joint].valve
        changes: dict[str, Measured] = {}
        for direction, record in zip(DIRECTIONS, learnt, strict=True):
            dead_band, std_dev = record["dead_band"], np.sqrt(np.diag(record["covariance"]))
            if dead_band == getattr(valve, direction.dead_band).value:
                continue  # nothing was learnt in this direction
            found = {direction.dead_band: (dead_band, std_dev[0])}
            for name, gain, spread in zip(
                direction.gains, record["gain"], std_dev[1:], strict=True
            ):
                whole_stroke = getattr(valve, name).value * (1.0 - dead_band) / gain
                found[name] = whole_stroke, whole_stroke * spread / gain
            for name, (value, spread) in found.items():
                unit = valve.units[name]
                changes[name] = Measured(value=float(value), std_dev=float(spread), unit=unit)
        if changes:
            update = {"valve": valve.model_copy(update=changes)}
            joints[joint] = joints[joint].model_copy(update=update)
    provenance = known.provenance.removesuffix(LEARNT_PROVENANCE) + LEARNT_PROVENANCE
    return known.model_copy(update={"joints": joints, "provenance": provenance})


def in_words(led: FlowFeedforward) -> Iterator[tuple[str, str]]:
    """Learnt quantity and its value, of every joint and direction."""
    for joint, learnt in zip(led.joints, led.memory.learnt, strict=True):
        for direction, record in zip(DIRECTIONS, learnt, strict=True):
            dead_band, std_dev = record["dead_band"], np.sqrt(record["covariance"][0, 0])
            gains = (1.0 - dead_band) / record["gain"]
            yield (
                f"learnt, {joint} {direction.name}: dead band, gains at A and B over those of the "
                "model",
                f"{dead_band:.4f} ± {std_dev:.4f}, {gains[0]:.3f}, {gains[1]:.3f}",
            )
