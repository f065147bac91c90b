"""Hidden faults of sensors: zeros, gains, delays, and some that no catalogue has."""

from abc import ABC, abstractmethod
from collections.abc import Sequence

import numpy as np
from numba import njit

from crane_model.machine import Machine
from crane_sim.effects.fault import SensorFault
from crane_sim.effects.form import Draw, Form, Magnitude, Planted, Where

BOTH = tuple[np.ndarray, np.ndarray]


def faults(planted: Sequence[Planted], machine: Machine) -> tuple[SensorFault, ...]:
    """The faults among hidden effects, in their order."""
    return tuple(
        effect.form.law(machine, effect.joint, effect.values)
        for effect in planted
        if not isinstance(effect.form.law, int) and effect.joint is not None
    )


class OneTransducer(SensorFault, ABC):
    """A fault of the transducer of chamber A."""

    def pressures(self, time: np.ndarray, chamber_a: np.ndarray, chamber_b: np.ndarray) -> BOTH:
        """Only that column is changed."""
        shown = chamber_a.copy()
        shown[:, self.column] = self.shown(time, chamber_a[:, self.column])
        return shown, chamber_b

    @abstractmethod
    def shown(self, time: np.ndarray, pressure: np.ndarray) -> np.ndarray:
        """What it shows of a pressure (n,) [Pa]."""


class BothTransducers(SensorFault, ABC):
    """A fault of the transducers of both chambers, the same in each."""

    def pressures(self, time: np.ndarray, chamber_a: np.ndarray, chamber_b: np.ndarray) -> BOTH:
        """Only that column is changed, in both."""
        shown_a, shown_b = chamber_a.copy(), chamber_b.copy()
        shown_a[:, self.column] = self.shown(time, chamber_a[:, self.column])
        shown_b[:, self.column] = self.shown(time, chamber_b[:, self.column])
        return shown_a, shown_b

    @abstractmethod
    def shown(self, time: np.ndarray, pressure: np.ndarray) -> np.ndarray:
        """What either shows of a pressure (n,) [Pa]."""


class Zero(OneTransducer):
    """A zero that has been lost, and comes back a little as the transducer warms up."""

    def shown(self, time: np.ndarray, pressure: np.ndarray) -> np.ndarray:
        """Most of the offset stays."""
        offset, recovery, warming = self.values
        gone = recovery * (1.0 - np.exp(-time / warming))
        return pressure + offset * (1.0 - gone)


class Bow(OneTransducer):
    """A characteristic that is bent in between its two calibrated ends."""

    def shown(self, time: np.ndarray, pressure: np.ndarray) -> np.ndarray:
        """A parabola through both ends."""
        bow, span = self.values
        ratio = pressure / span
        return pressure + 4.0 * bow * ratio * (1.0 - ratio)


class Ripple(SensorFault):
    """The pump's pulsation in both chambers, aliased by the sampling, slowly beating."""

    def pressures(self, time: np.ndarray, chamber_a: np.ndarray, chamber_b: np.ndarray) -> BOTH:
        """In chamber B weaker and later."""
        ripple, frequency = self.values
        shown_a, shown_b = chamber_a.copy(), chamber_b.copy()
        phase = 2.0 * np.pi * frequency * time
        beat = ripple * (1.0 + 0.3 * np.sin(0.9 * time))
        shown_a[:, self.column] += beat * np.sin(phase)
        shown_b[:, self.column] += 0.4 * beat * np.sin(phase - 1.0)
        return shown_a, shown_b


class Crosstalk(SensorFault):
    """A channel that picks up some of the next joint's."""

    def pressures(self, time: np.ndarray, chamber_a: np.ndarray, chamber_b: np.ndarray) -> BOTH:
        """Chamber B of the neighbour reaches the channel of chamber A."""
        (share,) = self.values
        following = self.measured.index(self.column) + 1
        source = self.measured[following % len(self.measured)]
        shown = chamber_a.copy()
        shown[:, self.column] += share * chamber_b[:, source]
        return shown, chamber_b


class BothGains(BothTransducers):
    """Both transducers of a cylinder, or its piston areas, off by one factor."""

    def shown(self, time: np.ndarray, pressure: np.ndarray) -> np.ndarray:
        """The pressure times 1 + gain."""
        (gain,) = self.values
        return pressure * (1.0 + gain)


class GainOfB(SensorFault):
    """The transducer of chamber B off by a factor."""

    def pressures(self, time: np.ndarray, chamber_a: np.ndarray, chamber_b: np.ndarray) -> BOTH:
        """Only the column of chamber B."""
        (gain,) = self.values
        shown = chamber_b.copy()
        shown[:, self.column] *= 1.0 + gain
        return chamber_a, shown


class DelayedReadings(BothTransducers):
    """Pressures that are stamped late: those of a moment before are shown."""

    def shown(self, time: np.ndarray, pressure: np.ndarray) -> np.ndarray:
        """Straight lines between the samples."""
        (delay,) = self.values
        return np.interp(time - delay, time, pressure)


class LaggingReadings(BothTransducers):
    """A narrow line before the transducers: first order, with the same delay at low frequency."""

    def shown(self, time: np.ndarray, pressure: np.ndarray) -> np.ndarray:
        """The pressure behind a first-order lag, settled at the first sample."""
        (lag,) = self.values
        return _lagging(time, np.ascontiguousarray(pressure), lag)


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


class Turned(SensorFault):
    """An encoder that was mounted a little turned."""

    def positions(self, q: np.ndarray) -> np.ndarray:
        """Only that column."""
        shown = q.copy()
        (offset,) = self.values
        shown[..., self.column] += offset
        return shown


class Eccentric(SensorFault):
    """An encoder disk off its centre: an error that follows the sine of the angle."""

    def positions(self, q: np.ndarray) -> np.ndarray:
        """Only that column."""
        shown = q.copy()
        error, turns, phase = self.values
        shown[..., self.column] += error * np.sin(turns * q[..., self.column] + phase)
        return shown


_OFFSET = Magnitude("offset", "Pa", 5e4, 3e6)

FORMS = (
    Form("pressure_offset", "warming", Zero, _OFFSET,
         (Draw("recovery", "1", 0.0, 0.1), Draw("warming", "s", 30.0, 90.0)), signed=True),
    Form("pressure_gain", "both", BothGains, Magnitude("gain", "1", 0.02, 0.5), signed=True),
    Form("chamber_gain", "chamber_b", GainOfB, Magnitude("gain", "1", 0.02, 0.8), signed=True),
    Form("encoder_offset", "turned", Turned, Magnitude("offset", "{coordinate}", 0.01, 0.2),
         (), Where.TURNING, signed=True),
    Form("time_skew", "delay", DelayedReadings, Magnitude("delay", "s", 0.01, 0.2)),
    Form("time_skew", "lag", LaggingReadings, Magnitude("lag", "s", 0.01, 0.2)),
    Form("crosstalk", "next_joint", Crosstalk, Magnitude("share", "1", 0.02, 0.5),
         outside=True, signed=True),
    Form("encoder_eccentricity", "disk", Eccentric,
         Magnitude("error", "{coordinate}", 0.01, 0.1),
         (Draw("turns", "rad/{coordinate}", 6.0, 16.0), Draw("phase", "rad", 0.0, 2 * np.pi)),
         Where.TURNING, outside=True),
    Form("transducer_bow", "parabola", Bow, Magnitude("bow", "Pa", 5e4, 3e6),
         (Draw("span", "Pa", 1.2e7, 2.0e7),), outside=True, signed=True),
    Form("pressure_ripple", "pump", Ripple, Magnitude("ripple", "Pa", 5e4, 3e6),
         (Draw("frequency", "Hz", 1.0, 4.0),), outside=True),
)  # fmt: skip
