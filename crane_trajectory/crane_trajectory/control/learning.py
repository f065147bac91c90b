"""Learning controllers: what they learn from period to period, and how it is told and saved."""

from collections.abc import Iterator

import numpy as np

from crane_model.hydraulics.values import HydraulicValues, Measured
from crane_trajectory.control.flow_feedforward import FlowFeedforward
from crane_trajectory.control.interface import Controller, SensorReading, Wanted, WrappedController

# Iterative learning: what a periodic reference needs beside what its controller already does.
#
# From each whole period the errors e give the next one a velocity beside the reference,
#
#     v <- Q [v + gain (e' + kv e + ki Int(e))]
#
# what the feedback did, and what it had yet to do. Q passes frequencies up to `CUT_OFF` without a
# shift of phase. Where oil swings below that, the loop answers so late that learning makes the
# error grow; where only noise is left, it wanders. So each harmonic of each joint is judged by
# itself: one whose error has grown goes back to what it had before, is measured anew, and from then
# on goes only half as far. Harmonics of a nearly linear loop do not mix, hence none ends worse than
# it was, but for noise, and learning stops where there is nothing to learn.

STEP = 0.005  # s, of the learnt course
GAIN = 0.5
CUT_OFF = 3.0  # Hz
FADING = 0.5  # s, in which it is mixed in and out
LARGEST_SHARE = 0.1  # of the largest speed: what may be learnt
MOST_MISSING = 0.05  # of a period, from which is still learnt


class Learning(WrappedController):
    """A controller that uses the model and learns a reference of a period [s]."""

    def __init__(self, controller: Controller, led: FlowFeedforward, period: float):
        """`led` is the controller, or the part of it that uses the model."""
        super().__init__(controller)
        self.led = led
        self._gains, self._columns = led.gains, led.columns
        count = max(round(period / STEP), 2)
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
        """As the controller; what was learnt stays."""
        self._phase, self._share = np.nan, 0.0
        self._errors[:] = np.nan
        super().start(command)

    def command(self, dt: float, reading: SensorReading, wanted: Wanted) -> np.ndarray:
        """As the controller, with what was learnt."""
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
            more = [np.interp(at, course, one, period=self._period) for one in self.learnt.T]
            ahead = wanted.ahead
            velocity = ahead.velocity.copy()
            velocity[self._columns] += self._share * np.array(more)
            wanted = wanted._replace(ahead=ahead._replace(velocity=velocity))
        return super().command(dt, reading, wanted)

    def _learn(self) -> None:
        """From the period that has ended."""
        known = np.isfinite(self._errors).all(axis=1)
        if known.mean() < 1.0 - MOST_MISSING:
            self._errors[:] = np.nan
            return
        count = len(known)
        places = np.flatnonzero(known)
        errors = [np.interp(np.arange(count), places, one[places], period=count)
                  for one in self._errors.T]  # fmt: skip
        self._errors[:] = np.nan
        omega = 2j * np.pi * np.fft.rfftfreq(count, self._period / count)[1:, np.newaxis]
        kv, ki = self._gains["kv"], self._gains["ki"]
        step = np.fft.rfft(errors, axis=1).T
        size = np.abs(step)
        step[1:] *= omega + kv + ki / omega
        step[0] = 0.0  # the integral of the controller takes care of it
        learnt = np.fft.rfft(self.learnt, axis=0)
        wanted = learnt + GAIN * step
        wanted[1:] /= 1.0 + (np.abs(omega) / (2.0 * np.pi * CUT_OFF)) ** 4
        worse = size > self._least
        self._pace[worse] /= 2.0
        self._kept = np.where(worse, self._kept, learnt)
        self._least = np.where(worse, np.inf, size)
        spectrum = np.where(worse, self._kept, learnt + self._pace * (wanted - learnt))
        most = LARGEST_SHARE * self._gains["largest_speed"]
        self.learnt = np.clip(np.fft.irfft(spectrum, count, axis=0), -most, most)


# What an adaptive controller has learnt, in words and as hydraulics of a model file.

DIRECTIONS = (
    ("extending", "dead_zone_a", ("supply_a", "b_tank")),
    ("retracting", "dead_zone_b", ("a_tank", "supply_b")),
)
"""Name, dead zone and the gains at chambers A and B, as `adaptation` has them."""


def learnt_hydraulics(known: HydraulicValues, led: FlowFeedforward) -> HydraulicValues:
    """The values of which the controller was made, `known`, with what it has learnt since."""
    joints = dict(known.joints)
    for joint, learnt in zip(led.joints, led.memory.learnt, strict=True):
        valve = joints[joint].valve
        changes: dict[str, Measured] = {}
        for (_, dead_zone, gains), one in zip(DIRECTIONS, learnt, strict=True):
            values, std_dev = one[0], np.sqrt(np.diag(one[1:]))
            if values[0] == getattr(valve, dead_zone).value:
                continue  # nothing was learnt in this direction
            changes[dead_zone] = _measured(values[0], std_dev[0], valve.units[dead_zone])
            for k, name in enumerate(gains, start=1):
                whole_stroke = getattr(valve, name).value * (1.0 - values[0]) / values[k]
                changes[name] = _measured(
                    whole_stroke, whole_stroke * std_dev[k] / values[k], valve.units[name]
                )
        if changes:
            joints[joint] = joints[joint].model_copy(
                update={"valve": valve.model_copy(update=changes)}
            )
    provenance = known.provenance.removesuffix(LEARNT) + LEARNT
    return known.model_copy(update={"joints": joints, "provenance": provenance})


LEARNT = "; dead zones and flow gains learnt while following"


def in_words(led: FlowFeedforward) -> Iterator[tuple[str, str]]:
    """What, and its value, of every joint and direction."""
    for joint, learnt in zip(led.joints, led.memory.learnt, strict=True):
        for (direction, _, _), one in zip(DIRECTIONS, learnt, strict=True):
            dead_zone, std_dev = one[0, 0], np.sqrt(one[1, 0])
            gains = (1.0 - dead_zone) / one[0, 1:]
            yield (
                f"learnt, {joint} {direction}: dead zone, gains at A and B over those of the model",
                f"{dead_zone:.4f} ± {std_dev:.4f}, {gains[0]:.3f}, {gains[1]:.3f}",
            )


def _measured(value: float, std_dev: float, unit: str) -> Measured:
    return Measured(value=float(value), std_dev=float(std_dev), unit=unit)
