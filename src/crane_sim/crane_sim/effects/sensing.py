"""Injected faults of sensors: zeros, gains, delays, and the small flaws of every machine."""

from collections.abc import Callable, Sequence

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


Reading = Callable[..., np.ndarray]
"""From time (n,) [s], pressure (n,) [Pa] and the values of a form to what is shown (n,)."""


def of_transducers(a: Reading, b: Reading) -> type[SensorFault]:
    """The fault of the transducers of a joint that show this of chambers A and B."""

    class Fault(SensorFault):
        def pressures(
            self, time: np.ndarray, chamber_a: np.ndarray, chamber_b: np.ndarray
        ) -> Shown:
            shown_a, shown_b = chamber_a.copy(), chamber_b.copy()
            shown_a[:, self.column] = a(time, chamber_a[:, self.column], *self.values)
            shown_b[:, self.column] = b(time, chamber_b[:, self.column], *self.values)
            return shown_a, shown_b

    return Fault


def _true(time: np.ndarray, pressure: np.ndarray, *values: float) -> np.ndarray:
    return pressure


def of_chamber_a(reading: Reading) -> type[SensorFault]:
    """The fault of the transducer of chamber A that shows this."""
    return of_transducers(reading, _true)


def of_chamber_b(reading: Reading) -> type[SensorFault]:
    """The fault of the transducer of chamber B that shows this."""
    return of_transducers(_true, reading)


def of_both(reading: Reading) -> type[SensorFault]:
    """The fault of the transducers of both chambers that show this."""
    return of_transducers(reading, reading)


def of_encoder(error: Callable[..., np.ndarray]) -> type[SensorFault]:
    """The fault of an encoder with this error, by position (...,) and the values of a form."""

    class Fault(SensorFault):
        def positions(self, q: np.ndarray) -> np.ndarray:
            shown = q.copy()
            shown[..., self.column] += error(q[..., self.column], *self.values)
            return shown

    return Fault


def of_neighbour(chamber: int, step: int, heard: Reading) -> type[SensorFault]:
    """The channel of chamber A (0) or B (1) that picks up a share of the joint `step` further.

    `heard` is from time, pressures of A and B there and the values after the share.
    """

    class Fault(SensorFault):
        def pressures(
            self, time: np.ndarray, chamber_a: np.ndarray, chamber_b: np.ndarray
        ) -> Shown:
            place = self.measured.index(self.column) + step
            other = self.measured[place % len(self.measured)]
            share, *values = self.values
            shown = chamber_a.copy(), chamber_b.copy()
            shown[chamber][:, self.column] += share * heard(
                time, chamber_a[:, other], chamber_b[:, other], *values
            )
            return shown

    return Fault


# Readings that come late.


def _averaged(time: np.ndarray, pressure: np.ndarray, delay: float, share: float) -> np.ndarray:
    """Means over a time, stamped late: a share of the delay is half that time."""
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


# Pulsation of pumps, aliased by the sampling.


def _pumped(
    time: np.ndarray, share: float, behind: float, ripple: float, frequency: float
) -> np.ndarray:
    """A share of that of one pump, slowly beating, some radians behind."""
    beat = ripple * (1.0 + 0.3 * np.sin(0.9 * time))
    return share * beat * np.sin(2.0 * np.pi * frequency * time - behind)


def _two_pumps(time: np.ndarray, ripple: float, frequency: float, ratio: float) -> np.ndarray:
    """Pulsation of two pumps, each at its own frequency."""
    both = np.sin(2.0 * np.pi * frequency * time)
    return ripple * (both + 0.6 * np.sin(2.0 * np.pi * ratio * frequency * time + 1.0))


# Flaws of the sensors of every machine: structured noise, no effect to be found.

# a disk off its centre: an error that follows the sine of the angle
ECCENTRIC = of_encoder(lambda q, error, turns, phase: error * np.sin(turns * q + phase))


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
        ECCENTRIC(machine, joint, (rng.uniform(*ECCENTRICITY_RAD), 1.0, rng.uniform(0, 2 * np.pi)))
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
    # comes back a little as the transducer warms up
    Form("pressure_offset", "warming",
         of_chamber_a(lambda time, p, offset, recovery, warming:
                      p + offset * (1.0 - recovery * (1.0 - np.exp(-time / warming)))),
         _OFFSET, (Draw("recovery", "1", 0.0, 0.1), Draw("warming", "s", 30.0, 90.0)), signed=True),
    Form("pressure_offset", "drifting",
         of_chamber_a(lambda time, p, offset, drift: p + offset * (1.0 + drift * time / MINUTE_S)),
         _OFFSET, (Draw("drift", "1/min", -0.1, 0.1),), signed=True),
    # lost by an overload: less the higher the pressure
    Form("pressure_offset", "overloaded",
         of_chamber_a(lambda time, p, offset, stiff:
                      p + offset / (1.0 + np.maximum(p, 0.0) / stiff)),
         _OFFSET, (Draw("stiff", "Pa", 6e7, 2e8),), signed=True),
    # of both transducers, or of the piston areas
    Form("pressure_gain", "both", of_both(lambda time, p, gain: p * (1.0 + gain)),
         Magnitude("gain", "1", 0.02, 0.5), signed=True),
    Form("chamber_gain", "chamber_b", of_chamber_b(lambda time, p, gain: p * (1.0 + gain)),
         _GAIN_B, signed=True),
    # follows the pressure
    Form("chamber_gain", "pressed",
         of_chamber_b(lambda time, p, gain, exponent:
                      p + gain * REFERENCE_PRESSURE_PA
                      * (np.maximum(p, 0.0) / REFERENCE_PRESSURE_PA) ** exponent),
         _GAIN_B, (Draw("exponent", "1", 0.8, 1.2),), signed=True),
    # of A by a part of that of B, the other way
    Form("chamber_gain", "opposed",
         of_transducers(lambda time, p, gain, share: p * (1.0 - share * gain),
                        lambda time, p, gain, share: p * (1.0 + gain)),
         _GAIN_B, (Draw("share", "1", 0.0, 0.5),), signed=True),
    Form("encoder_offset", "turned", of_encoder(lambda q, offset: np.full_like(q, offset)),
         _TURNED, (), Where.TURNING, signed=True),
    # on a coupling that is a little bent
    Form("encoder_offset", "strained",
         of_encoder(lambda q, offset, share, phase: offset * (1.0 + share * np.sin(q + phase))),
         _TURNED, (Draw("share", "1", 0.0, 0.2), Draw("phase", "rad", 0.0, 2 * np.pi)),
         Where.TURNING, signed=True),
    # on a wheel of not quite the right size
    Form("encoder_offset", "slipped",
         of_encoder(lambda q, offset, share: offset * (1.0 + share * q)),
         _TURNED, (Draw("share", "1", -0.1, 0.1),), Where.TURNING, signed=True),
    # stamped late: of a moment before
    Form("time_skew", "delay",
         of_both(lambda time, p, delay: np.interp(time - delay, time, p)),
         Magnitude("delay", "s", 0.01, 0.2)),
    # a narrow line before the transducers, with the same delay at low frequency
    Form("time_skew", "lag",
         of_both(lambda time, p, lag: _lagging(time, np.ascontiguousarray(p), lag)),
         Magnitude("lag", "s", 0.01, 0.2)),
    Form("time_skew", "averaged", of_both(_averaged), Magnitude("delay", "s", 0.01, 0.2),
         (Draw("share", "1", 0.3, 1.0),)),
    Form("crosstalk", "next_joint", of_neighbour(0, 1, lambda time, a, b: b), _PICKED_UP,
         outside=True, signed=True),
    Form("crosstalk", "of_chamber_a", of_neighbour(0, 1, lambda time, a, b: a), _PICKED_UP,
         outside=True, signed=True),
    # one lifts the ground of the other, more than in proportion
    Form("crosstalk", "shared_ground",
         of_neighbour(0, 1, lambda time, a, b, exponent:
                      REFERENCE_PRESSURE_PA
                      * (np.maximum(b, 0.0) / REFERENCE_PRESSURE_PA) ** exponent),
         _PICKED_UP, (Draw("exponent", "1", 1.4, 2.4),), outside=True, signed=True),
    Form("encoder_eccentricity", "disk", ECCENTRIC, _ERROR, _DISK, Where.TURNING,
         outside=True),
    # off its centre and not round
    Form("encoder_eccentricity", "two_lobes",
         of_encoder(lambda q, error, turns, phase, second:
                    error * (np.sin(turns * q + phase)
                             + second * np.sin(2.0 * (turns * q + phase)))),
         _ERROR, (*_DISK, Draw("second", "1", 0.2, 0.6)), Where.TURNING, outside=True),
    # lines divided with an error that builds up and jumps back
    Form("encoder_eccentricity", "graduation",
         of_encoder(lambda q, error, turns, phase:
                    error * np.arctan2(np.sin(turns * q + phase),
                                       1.5 + np.cos(turns * q + phase))),
         _ERROR, _DISK, Where.TURNING, outside=True),
    # bent in between two calibrated ends: one way, both ways, or from a knee on
    Form("transducer_nonlinearity", "parabola",
         of_chamber_a(lambda time, p, deviation, span:
                      p + 4.0 * deviation * (p / span) * (1.0 - p / span)),
         _DEVIATION, (_SPAN,), outside=True, signed=True),
    Form("transducer_nonlinearity", "cubic",
         of_chamber_a(lambda time, p, deviation, span:
                      p + 20.8 * deviation * (p / span) * (1.0 - p / span) * (0.5 - p / span)),
         _DEVIATION, (_SPAN,), outside=True, signed=True),
    Form("transducer_nonlinearity", "knee",
         of_chamber_a(lambda time, p, deviation, knee, span:
                      p - deviation * np.maximum(p - knee, 0.0) / (span - knee)),
         _DEVIATION, (Draw("knee", "Pa", 3e6, 6e6), _SPAN), outside=True, signed=True),
    Form("pressure_ripple", "pump",
         of_transducers(lambda time, p, *values: p + _pumped(time, 1.0, 0.0, *values),
                        lambda time, p, *values: p + _pumped(time, 0.4, 1.0, *values)),
         _RIPPLE, (_RATE,), outside=True),
    # of a pump whose speed wanders: the pulsation is nowhere for long
    Form("pressure_ripple", "wandering",
         of_chamber_a(lambda time, p, ripple, frequency, wander:
                      p + ripple * np.sin(2.0 * np.pi * frequency
                                          * (time + wander * np.sin(0.4 * time)))),
         _RIPPLE, (_RATE, Draw("wander", "s", 0.02, 0.1)), outside=True),
    Form("pressure_ripple", "two_pumps",
         of_transducers(lambda time, p, *values: p + _two_pumps(time, *values),
                        lambda time, p, *values: p - 0.3 * _two_pumps(time, *values)),
         _RIPPLE, (_RATE, Draw("ratio", "1", 1.3, 2.2)), outside=True),
)  # fmt: skip
