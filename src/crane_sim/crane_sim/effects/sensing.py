"""Injected faults of sensors: zeros, gains, delays, and the small flaws of every machine."""

from abc import ABC, abstractmethod
from collections.abc import Sequence

import numpy as np
from numba import njit

from crane_model.machine import Machine
from crane_sim.effects.form import (
    Draw,
    Form,
    InjectedForm,
    Magnitude,
    SensorFault,
    Where,
    measured_joints,
)

Shown = tuple[np.ndarray, np.ndarray]  # pressures of chambers A and B
MINUTE_S = 60.0
REFERENCE_PRESSURE_PA = 5e6  # where a gain that follows the pressure is what it says

PISTON_RATE_HZ = (170.0, 260.0)  # strokes of the pump's pistons a second, far above the sampling
PULSATION_PA = (1e3, 6e3)  # in a chamber, below the noise of a transducer
SECOND_HARMONIC = 0.4  # of the pulsation, twice as fast
PULSATION_DRIFT = 0.004  # of the rate: the motor slips as the load comes and goes
DRIFT_RAD_S = 0.5
ECCENTRICITY_RAD = (5e-5, 2e-4)  # 1 to 4 counts of an encoder


# Transducers: zeros, gains, nonlinearity.


class OneTransducer(SensorFault, ABC):
    """A fault of the transducer of chamber A."""

    def pressures(self, time: np.ndarray, chamber_a: np.ndarray, chamber_b: np.ndarray) -> Shown:
        shown = chamber_a.copy()
        shown[:, self.column] = self.shown(time, chamber_a[:, self.column])
        return shown, chamber_b

    @abstractmethod
    def shown(self, time: np.ndarray, pressure: np.ndarray) -> np.ndarray:
        """Reading of a pressure (n,) [Pa]."""


class BothTransducers(SensorFault, ABC):
    """A fault of the transducers of both chambers, the same in each."""

    def pressures(self, time: np.ndarray, chamber_a: np.ndarray, chamber_b: np.ndarray) -> Shown:
        shown_a, shown_b = chamber_a.copy(), chamber_b.copy()
        shown_a[:, self.column] = self.shown(time, chamber_a[:, self.column])
        shown_b[:, self.column] = self.shown(time, chamber_b[:, self.column])
        return shown_a, shown_b

    @abstractmethod
    def shown(self, time: np.ndarray, pressure: np.ndarray) -> np.ndarray:
        """Readings of both for a pressure (n,) [Pa]."""


class Zero(OneTransducer):
    """A zero that has been lost, and comes back a little as the transducer warms up."""

    def shown(self, time: np.ndarray, pressure: np.ndarray) -> np.ndarray:
        offset, recovery, warming = self.values
        gone = recovery * (1.0 - np.exp(-time / warming))
        return pressure + offset * (1.0 - gone)


class DriftingZero(OneTransducer):
    """A zero that goes on drifting."""

    def shown(self, time: np.ndarray, pressure: np.ndarray) -> np.ndarray:
        offset, drift = self.values
        return pressure + offset * (1.0 + drift * time / MINUTE_S)


class OverloadedZero(OneTransducer):
    """A zero that was lost by an overload, which shows less the higher the pressure."""

    def shown(self, time: np.ndarray, pressure: np.ndarray) -> np.ndarray:
        offset, stiff = self.values
        return pressure + offset / (1.0 + np.maximum(pressure, 0.0) / stiff)


class ParabolicNonlinearity(OneTransducer):
    """A characteristic that is bent in between its two calibrated ends."""

    def shown(self, time: np.ndarray, pressure: np.ndarray) -> np.ndarray:
        deviation, span = self.values
        ratio = pressure / span
        return pressure + 4.0 * deviation * ratio * (1.0 - ratio)


class CubicNonlinearity(OneTransducer):
    """A characteristic bent both ways between its ends."""

    def shown(self, time: np.ndarray, pressure: np.ndarray) -> np.ndarray:
        deviation, span = self.values
        ratio = pressure / span
        return pressure + 20.8 * deviation * ratio * (1.0 - ratio) * (0.5 - ratio)


class Knee(OneTransducer):
    """A characteristic that goes on less steeply from some pressure."""

    def shown(self, time: np.ndarray, pressure: np.ndarray) -> np.ndarray:
        deviation, knee, span = self.values
        return pressure - deviation * np.maximum(pressure - knee, 0.0) / (span - knee)


class BothGains(BothTransducers):
    """Both transducers of a cylinder, or its piston areas, off by one factor."""

    def shown(self, time: np.ndarray, pressure: np.ndarray) -> np.ndarray:
        (gain,) = self.values
        return pressure * (1.0 + gain)


class GainOfB(SensorFault):
    """The transducer of chamber B off by a factor."""

    def pressures(self, time: np.ndarray, chamber_a: np.ndarray, chamber_b: np.ndarray) -> Shown:
        (gain,) = self.values
        shown = chamber_b.copy()
        shown[:, self.column] *= 1.0 + gain
        return chamber_a, shown


class PressedGainOfB(SensorFault):
    """The transducer of chamber B off by a factor that follows the pressure."""

    def pressures(self, time: np.ndarray, chamber_a: np.ndarray, chamber_b: np.ndarray) -> Shown:
        gain, exponent = self.values
        shown = chamber_b.copy()
        ratio = np.maximum(chamber_b[:, self.column], 0.0) / REFERENCE_PRESSURE_PA
        shown[:, self.column] += gain * REFERENCE_PRESSURE_PA * ratio**exponent
        return chamber_a, shown


class OpposedGains(SensorFault):
    """The transducer of chamber B off by a factor, that of A by a part of it, the other way."""

    def pressures(self, time: np.ndarray, chamber_a: np.ndarray, chamber_b: np.ndarray) -> Shown:
        gain, share = self.values
        shown_a, shown_b = chamber_a.copy(), chamber_b.copy()
        shown_a[:, self.column] *= 1.0 - share * gain
        shown_b[:, self.column] *= 1.0 + gain
        return shown_a, shown_b


# Encoders: turned, off their centres, ill divided.


class EncoderFault(SensorFault, ABC):
    """A fault of an encoder that depends on the position."""

    def positions(self, q: np.ndarray) -> np.ndarray:
        shown = q.copy()
        shown[..., self.column] += self.error(q[..., self.column])
        return shown

    @abstractmethod
    def error(self, q: np.ndarray) -> np.ndarray:
        """Error of the reading at positions (...,) of the joint."""


class Turned(EncoderFault):
    """An encoder that was mounted a little turned."""

    def error(self, q: np.ndarray) -> np.ndarray:
        (offset,) = self.values
        return np.full_like(q, offset)


class Strained(EncoderFault):
    """An encoder whose coupling was mounted turned and a little bent."""

    def error(self, q: np.ndarray) -> np.ndarray:
        offset, share, phase = self.values
        return offset * (1.0 + share * np.sin(q + phase))


class Slipped(EncoderFault):
    """An encoder that was mounted turned, on a wheel of not quite the right size."""

    def error(self, q: np.ndarray) -> np.ndarray:
        offset, share = self.values
        return offset * (1.0 + share * q)


class Eccentric(EncoderFault):
    """An encoder disk off its centre: an error that follows the sine of the angle."""

    def error(self, q: np.ndarray) -> np.ndarray:
        error, turns, phase = self.values
        return error * np.sin(turns * q + phase)


class TwoLobes(EncoderFault):
    """A disk off its centre and not round."""

    def error(self, q: np.ndarray) -> np.ndarray:
        error, turns, phase, second = self.values
        angle = turns * q + phase
        return error * (np.sin(angle) + second * np.sin(2.0 * angle))


class Graduation(EncoderFault):
    """A disk whose lines were divided with an error that builds up and jumps back."""

    def error(self, q: np.ndarray) -> np.ndarray:
        error, turns, phase = self.values
        angle = turns * q + phase
        return error * np.arctan2(np.sin(angle), 1.5 + np.cos(angle))


# Readings of transducers: pulsation, crosstalk, delays.


class Ripple(SensorFault):
    """The pump's pulsation in both chambers, aliased by the sampling, slowly beating."""

    def pressures(self, time: np.ndarray, chamber_a: np.ndarray, chamber_b: np.ndarray) -> Shown:
        ripple, frequency = self.values
        shown_a, shown_b = chamber_a.copy(), chamber_b.copy()
        phase = 2.0 * np.pi * frequency * time
        beat = ripple * (1.0 + 0.3 * np.sin(0.9 * time))
        shown_a[:, self.column] += beat * np.sin(phase)
        shown_b[:, self.column] += 0.4 * beat * np.sin(phase - 1.0)
        return shown_a, shown_b


class WanderingRipple(SensorFault):
    """As of a pump whose speed wanders: the pulsation is nowhere for long."""

    def pressures(self, time: np.ndarray, chamber_a: np.ndarray, chamber_b: np.ndarray) -> Shown:
        ripple, frequency, wander = self.values
        shown = chamber_a.copy()
        phase = 2.0 * np.pi * frequency * (time + wander * np.sin(0.4 * time))
        shown[:, self.column] += ripple * np.sin(phase)
        return shown, chamber_b


class TwoRipples(SensorFault):
    """Two pumps, each with a line of its own, in both chambers."""

    def pressures(self, time: np.ndarray, chamber_a: np.ndarray, chamber_b: np.ndarray) -> Shown:
        ripple, frequency, ratio = self.values
        shown_a, shown_b = chamber_a.copy(), chamber_b.copy()
        both = np.sin(2.0 * np.pi * frequency * time)
        both = ripple * (both + 0.6 * np.sin(2.0 * np.pi * ratio * frequency * time + 1.0))
        shown_a[:, self.column] += both
        shown_b[:, self.column] -= 0.3 * both
        return shown_a, shown_b


class Crosstalk(SensorFault):
    """A channel that picks up some of the next joint's."""

    def pressures(self, time: np.ndarray, chamber_a: np.ndarray, chamber_b: np.ndarray) -> Shown:
        share = self.values[0]
        following = self.measured.index(self.column) + 1
        source = self.measured[following % len(self.measured)]
        shown = chamber_a.copy()
        shown[:, self.column] += share * chamber_b[:, source]
        return shown, chamber_b


class CrosstalkOfA(Crosstalk):
    """A channel that picks up some of the like one of the next joint."""

    def pressures(self, time: np.ndarray, chamber_a: np.ndarray, chamber_b: np.ndarray) -> Shown:
        return super().pressures(time, chamber_a, chamber_a)[0], chamber_b


class SharedGround(Crosstalk):
    """Channels of which one lifts the other's ground, more than in proportion."""

    def pressures(self, time: np.ndarray, chamber_a: np.ndarray, chamber_b: np.ndarray) -> Shown:
        lifted = (
            REFERENCE_PRESSURE_PA
            * (np.maximum(chamber_b, 0.0) / REFERENCE_PRESSURE_PA) ** self.values[1]
        )
        return super().pressures(time, chamber_a, lifted)[0], chamber_b


class DelayedReadings(BothTransducers):
    """Pressures that are stamped late: those of a moment before are shown."""

    def shown(self, time: np.ndarray, pressure: np.ndarray) -> np.ndarray:
        (delay,) = self.values
        return np.interp(time - delay, time, pressure)


class LaggingReadings(BothTransducers):
    """A narrow line before the transducers: first order, with the same delay at low frequency."""

    def shown(self, time: np.ndarray, pressure: np.ndarray) -> np.ndarray:
        (lag,) = self.values
        return _lagging(time, np.ascontiguousarray(pressure), lag)


class AveragedReadings(BothTransducers):
    """Readings that are means over a time, stamped late: a share of the delay is half that time."""

    def shown(self, time: np.ndarray, pressure: np.ndarray) -> np.ndarray:
        delay, share = self.values
        steps = np.diff(time)
        summed = np.append(0.0, np.cumsum((pressure[1:] + pressure[:-1]) / 2.0 * steps))
        end = np.maximum(time - (1.0 - share) * delay, time[0])
        begin = np.maximum(end - 2.0 * share * delay, time[0])
        over = end - begin
        mean = np.diff(np.interp(np.stack([begin, end]), time, summed), axis=0)[0]
        mean /= np.where(over > 0.0, over, 1.0)
        return np.where(over > 0.0, mean, pressure[0])


@njit(cache=True)
def _lagging(time: np.ndarray, true: np.ndarray, lag: float) -> np.ndarray:
    """Exact for a true signal that is straight between samples."""
    shown = true.copy()
    for k in range(1, len(true)):
        interval = time[k] - time[k - 1]
        slope = (true[k] - true[k - 1]) / interval
        behind = true[k - 1] - slope * lag  # where the answer to this straight line begins
        decay = np.exp(-interval / lag)
        shown[k] = behind + slope * interval + (shown[k - 1] - behind) * decay
    return shown


# Flaws of the sensors of every machine: structured noise, no effect to be found.


class PumpPulsation(SensorFault):
    """The pump's pulsation in all chambers, which the sampling aliases to wherever it falls.

    `values`: rate [Hz], then pulsation [Pa] and phase [rad] of chambers A and B of each joint.
    """

    def pressures(self, time: np.ndarray, chamber_a: np.ndarray, chamber_b: np.ndarray) -> Shown:
        rate, *rest = self.values
        chambers = np.array(rest).reshape(2, 2, -1)  # chamber, pulsation or phase, joint
        slip = PULSATION_DRIFT / DRIFT_RAD_S * np.cos(DRIFT_RAD_S * time)
        angle = 2.0 * np.pi * rate * (time + slip)[:, np.newaxis]
        shown = [
            pressure
            + size * (np.sin(angle + phase) + SECOND_HARMONIC * np.sin(2.0 * angle + phase))
            for pressure, (size, phase) in zip((chamber_a, chamber_b), chambers, strict=True)
        ]
        return shown[0], shown[1]


def drawn_flaws(machine: Machine, seed: int) -> tuple[SensorFault, ...]:
    """Pulsation of the pump, and eccentric encoder disks; the same seed gives the same ones."""
    rng = np.random.default_rng([seed, 11])
    joints = measured_joints(machine)
    count = len(machine.joint_names)
    sizes, phases = rng.uniform(*PULSATION_PA, (2, count)), rng.uniform(0.0, 2 * np.pi, (2, count))
    chambers = np.stack([sizes, phases], axis=1).ravel()
    rate = rng.uniform(*PISTON_RATE_HZ)
    eccentric = [
        Eccentric(machine, joint, (rng.uniform(*ECCENTRICITY_RAD), 1.0, rng.uniform(0, 2 * np.pi)))
        for joint in joints
        if machine.units[joint] == "rad"
    ]
    return (*eccentric, PumpPulsation(machine, joints[0], (rate, *chambers)))


def faults(effects: Sequence[InjectedForm], machine: Machine) -> tuple[SensorFault, ...]:
    """The faults among injected effects, in their order."""
    return tuple(
        effect.form.law(machine, effect.joint, effect.values)
        for effect in effects
        if not isinstance(effect.form.law, int) and effect.joint is not None
    )


_OFFSET = Magnitude("offset", "Pa", 5e4, 3e6)
_GAIN_B = Magnitude("gain", "1", 0.02, 0.8)
_TURNED = Magnitude("offset", "{coordinate}", 0.01, 0.2)
_DEVIATION, _SPAN = Magnitude("deviation", "Pa", 5e4, 3e6), Draw("span", "Pa", 1.2e7, 2.0e7)
_RIPPLE, _RATE = Magnitude("ripple", "Pa", 5e4, 3e6), Draw("frequency", "Hz", 1.0, 4.0)
_ERROR = Magnitude("error", "{coordinate}", 0.01, 0.1)
_DISK = (Draw("turns", "rad/{coordinate}", 6.0, 16.0), Draw("phase", "rad", 0.0, 2 * np.pi))
_PICKED_UP = Magnitude("share", "1", 0.02, 0.5)

SENSING_FORMS = (
    Form("pressure_offset", "warming", Zero, _OFFSET,
         (Draw("recovery", "1", 0.0, 0.1), Draw("warming", "s", 30.0, 90.0)), signed=True),
    Form("pressure_offset", "drifting", DriftingZero, _OFFSET,
         (Draw("drift", "1/min", -0.1, 0.1),), signed=True),
    Form("pressure_offset", "overloaded", OverloadedZero, _OFFSET,
         (Draw("stiff", "Pa", 6e7, 2e8),), signed=True),
    Form("pressure_gain", "both", BothGains, Magnitude("gain", "1", 0.02, 0.5),
         signed=True),
    Form("chamber_gain", "chamber_b", GainOfB, _GAIN_B, signed=True),
    Form("chamber_gain", "pressed", PressedGainOfB, _GAIN_B,
         (Draw("exponent", "1", 0.8, 1.2),), signed=True),
    Form("chamber_gain", "opposed", OpposedGains, _GAIN_B,
         (Draw("share", "1", 0.0, 0.5),), signed=True),
    Form("encoder_offset", "turned", Turned, _TURNED, (), Where.TURNING, signed=True),
    Form("encoder_offset", "strained", Strained, _TURNED,
         (Draw("share", "1", 0.0, 0.2), Draw("phase", "rad", 0.0, 2 * np.pi)), Where.TURNING,
         signed=True),
    Form("encoder_offset", "slipped", Slipped, _TURNED, (Draw("share", "1", -0.1, 0.1),),
         Where.TURNING, signed=True),
    Form("time_skew", "delay", DelayedReadings, Magnitude("delay", "s", 0.01, 0.2)),
    Form("time_skew", "lag", LaggingReadings, Magnitude("lag", "s", 0.01, 0.2)),
    Form("time_skew", "averaged", AveragedReadings, Magnitude("delay", "s", 0.01, 0.2),
         (Draw("share", "1", 0.3, 1.0),)),
    Form("crosstalk", "next_joint", Crosstalk, _PICKED_UP,
         outside=True, signed=True),
    Form("crosstalk", "of_chamber_a", CrosstalkOfA, _PICKED_UP,
         outside=True, signed=True),
    Form("crosstalk", "shared_ground", SharedGround, _PICKED_UP,
         (Draw("exponent", "1", 1.4, 2.4),), outside=True, signed=True),
    Form("encoder_eccentricity", "disk", Eccentric, _ERROR, _DISK, Where.TURNING,
         outside=True),
    Form("encoder_eccentricity", "two_lobes", TwoLobes, _ERROR,
         (*_DISK, Draw("second", "1", 0.2, 0.6)), Where.TURNING, outside=True),
    Form("encoder_eccentricity", "graduation", Graduation, _ERROR, _DISK, Where.TURNING,
         outside=True),
    Form("transducer_nonlinearity", "parabola", ParabolicNonlinearity, _DEVIATION, (_SPAN,),
         outside=True, signed=True),
    Form("transducer_nonlinearity", "cubic", CubicNonlinearity, _DEVIATION, (_SPAN,),
         outside=True, signed=True),
    Form("transducer_nonlinearity", "knee", Knee, _DEVIATION, (Draw("knee", "Pa", 3e6, 6e6), _SPAN),
         outside=True, signed=True),
    Form("pressure_ripple", "pump", Ripple, _RIPPLE, (_RATE,), outside=True),
    Form("pressure_ripple", "wandering", WanderingRipple, _RIPPLE,
         (_RATE, Draw("wander", "s", 0.02, 0.1)), outside=True),
    Form("pressure_ripple", "two_pumps", TwoRipples, _RIPPLE,
         (_RATE, Draw("ratio", "1", 1.3, 2.2)), outside=True),
)  # fmt: skip
