"""Hidden faults of transducers: zeros, gains, bent characteristics."""

from abc import ABC, abstractmethod

import numpy as np

from crane_sim.effects.form import SensorFault

BOTH = tuple[np.ndarray, np.ndarray]
MINUTE = 60.0  # s
ABOUT_PA = 5e6  # where a gain that follows the pressure is what it says


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


class DriftingZero(OneTransducer):
    """A zero that goes on drifting."""

    def shown(self, time: np.ndarray, pressure: np.ndarray) -> np.ndarray:
        """A little more with each second."""
        offset, drift = self.values
        return pressure + offset * (1.0 + drift * time / MINUTE)


class OverloadedZero(OneTransducer):
    """A zero that was lost by an overload, which shows less the higher the pressure."""

    def shown(self, time: np.ndarray, pressure: np.ndarray) -> np.ndarray:
        """Half of it at the pressure `stiff`."""
        offset, stiff = self.values
        return pressure + offset / (1.0 + np.maximum(pressure, 0.0) / stiff)


class Bow(OneTransducer):
    """A characteristic that is bent in between its two calibrated ends."""

    def shown(self, time: np.ndarray, pressure: np.ndarray) -> np.ndarray:
        """A parabola through both ends."""
        bow, span = self.values
        ratio = pressure / span
        return pressure + 4.0 * bow * ratio * (1.0 - ratio)


class CubicBow(OneTransducer):
    """A characteristic bent both ways between its ends."""

    def shown(self, time: np.ndarray, pressure: np.ndarray) -> np.ndarray:
        """A cubic parabola through both ends and the middle."""
        bow, span = self.values
        ratio = pressure / span
        return pressure + 20.8 * bow * ratio * (1.0 - ratio) * (0.5 - ratio)


class Knee(OneTransducer):
    """A characteristic that goes on less steeply from some pressure."""

    def shown(self, time: np.ndarray, pressure: np.ndarray) -> np.ndarray:
        """Less by the bow, at the end of the span."""
        bow, knee, span = self.values
        return pressure - bow * np.maximum(pressure - knee, 0.0) / (span - knee)


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


class PressedGainOfB(SensorFault):
    """The transducer of chamber B off by a factor that follows the pressure."""

    def pressures(self, time: np.ndarray, chamber_a: np.ndarray, chamber_b: np.ndarray) -> BOTH:
        """Only the column of chamber B."""
        gain, exponent = self.values
        shown = chamber_b.copy()
        ratio = np.maximum(chamber_b[:, self.column], 0.0) / ABOUT_PA
        shown[:, self.column] += gain * ABOUT_PA * ratio**exponent
        return chamber_a, shown


class OpposedGains(SensorFault):
    """The transducer of chamber B off by a factor, that of A by a part of it, the other way."""

    def pressures(self, time: np.ndarray, chamber_a: np.ndarray, chamber_b: np.ndarray) -> BOTH:
        """Both columns."""
        gain, share = self.values
        shown_a, shown_b = chamber_a.copy(), chamber_b.copy()
        shown_a[:, self.column] *= 1.0 - share * gain
        shown_b[:, self.column] *= 1.0 + gain
        return shown_a, shown_b
