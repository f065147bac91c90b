"""Gains, delays, turned encoders of the other make, three of each; and faults of no catalogue."""

from itertools import groupby

import numpy as np
from scipy.signal import lfilter

from crane_benchmark.independent.effects import FORCE_FORMS, FRICTION_FORMS
from crane_model.machine import Machine
from crane_sim.effects.form import Draw, Form, Magnitude, SensorFault, Where
from crane_sim.effects.sensing import BothTransducers, EncoderFault, OneTransducer, Shown

FULL = 2.5e7  # Pa, of a transducer


class SoftMembrane(OneTransducer):
    """A gain of chamber A that falls as its membrane stiffens."""

    def shown(self, time: np.ndarray, pressure: np.ndarray) -> np.ndarray:
        gain, stiffness = self.values
        return pressure * (1.0 + gain / (1.0 + pressure / (stiffness * FULL)))


class PlainGain(OneTransducer):
    """Chamber A by a factor."""

    def shown(self, time: np.ndarray, pressure: np.ndarray) -> np.ndarray:
        (gain,) = self.values
        return pressure * (1.0 + gain)


class AgeingGain(OneTransducer):
    """A gain of chamber A that creeps while the machine is on."""

    def shown(self, time: np.ndarray, pressure: np.ndarray) -> np.ndarray:
        gain, creep = self.values
        return pressure * (1.0 + gain * (1.0 + creep * time / 60.0))


class Late(BothTransducers):
    """Both chambers of a joint held back by the bus, and once more by a share of it."""

    def shown(self, time: np.ndarray, pressure: np.ndarray) -> np.ndarray:
        delay, share = self.values
        first = np.interp(time - delay * (1.0 - share), time, pressure)
        return (first + np.interp(time - delay * (1.0 + share), time, pressure)) / 2.0


class TwoLags(BothTransducers):
    """Two filters of first order behind one another."""

    def shown(self, time: np.ndarray, pressure: np.ndarray) -> np.ndarray:
        delay, share = self.values
        step = float(np.median(np.diff(time)))
        for part in (share * delay, (1.0 - share) * delay):
            keep = part / (part + step)
            pressure = lfilter([1.0 - keep], [1.0, -keep], pressure, zi=[keep * pressure[0]])[0]
        return pressure


class WanderingDelay(BothTransducers):
    """A bus whose load swings slowly."""

    def shown(self, time: np.ndarray, pressure: np.ndarray) -> np.ndarray:
        delay, swing = self.values
        return np.interp(time - delay * (1.0 + swing * np.sin(0.3 * time)), time, pressure)


class Mounted(EncoderFault):
    """An encoder that shows more than the joint has turned, by the same everywhere or nearly."""

    def error(self, q: np.ndarray) -> np.ndarray:
        (offset,) = self.values
        return np.full_like(q, offset)


class OnAUniversalJoint(Mounted):
    """Behind a bent universal joint: twice a turn it runs ahead."""

    def error(self, q: np.ndarray) -> np.ndarray:
        offset, share, phase = self.values
        return offset * (1.0 + share * np.sin(2.0 * q + phase))


class OnABelt(Mounted):
    """By a belt that jumped a tooth and stretches towards one end."""

    def error(self, q: np.ndarray) -> np.ndarray:
        offset, share = self.values
        return offset * (1.0 + share * q * np.abs(q))


class BentLine(OneTransducer):
    """A characteristic of chamber A that is bent between its ends: by the sine, or its square."""

    def shown(self, time: np.ndarray, pressure: np.ndarray) -> np.ndarray:
        bow, exponent = self.values
        place = np.clip(pressure / FULL, 0.0, 1.0)
        return pressure + bow * np.sin(np.pi * place**exponent)


class Steps(OneTransducer):
    """A converter of which one bit is wrong: the reading climbs in rounded steps."""

    def shown(self, time: np.ndarray, pressure: np.ndarray) -> np.ndarray:
        bow, every = self.values
        return pressure + bow * np.tanh(3.0 * np.sin(2.0 * np.pi * pressure / every))


class Saturating(OneTransducer):
    """A reading that falls behind as the pressure rises."""

    def shown(self, time: np.ndarray, pressure: np.ndarray) -> np.ndarray:
        bow, knee = self.values
        return pressure - bow * (np.maximum(pressure, 0.0) / (2.0 * knee)) ** 3


class Neighbour(SensorFault):
    """A channel of chamber B that picks up what another joint's transducers show."""

    def __init__(self, machine: Machine, joint: str, values: tuple[float, ...]):
        super().__init__(machine, joint, values)
        place = self.measured.index(self.column)
        self.other = self.measured[place - 1]

    def pressures(self, time: np.ndarray, chamber_a: np.ndarray, chamber_b: np.ndarray) -> Shown:
        shown = chamber_b.copy()
        shown[:, self.column] += self.values[0] * self.heard(time, chamber_a, chamber_b)
        return chamber_a, shown

    def heard(self, time: np.ndarray, a: np.ndarray, b: np.ndarray) -> np.ndarray:
        return a[:, self.other]


class NeighbourChanges(Neighbour):
    """By the capacity between two cables: changes alone."""

    def heard(self, time: np.ndarray, a: np.ndarray, b: np.ndarray) -> np.ndarray:
        step = float(np.median(np.diff(time)))
        keep = self.values[1] / (self.values[1] + step)
        signal = b[:, self.other]
        slow = lfilter([1.0 - keep], [1.0, -keep], signal, zi=[keep * signal[0]])[0]
        return signal - slow


class NeighbourDifference(Neighbour):
    """By a ground that both transducers of the joint before share."""

    def heard(self, time: np.ndarray, a: np.ndarray, b: np.ndarray) -> np.ndarray:
        return a[:, self.other] - b[:, self.other]


_GAIN = Magnitude("gain", "1", 0.02, 0.8)
_DELAY = Magnitude("delay", "s", 0.01, 0.2)
_TURNED = Magnitude("offset", "{coordinate}", 0.01, 0.2)
_BOW = Magnitude("bow", "Pa", 5e4, 3e6)
_PICKED_UP = Magnitude("share", "1", 0.02, 0.5)

READING_FORMS = (
    Form("chamber_gain", "plain", PlainGain, _GAIN, signed=True),
    Form("chamber_gain", "soft_membrane", SoftMembrane, _GAIN,
         (Draw("stiffness", "1", 1.0, 4.0),), signed=True),
    Form("chamber_gain", "ageing", AgeingGain, _GAIN,
         (Draw("creep", "1/min", -0.1, 0.1),), signed=True),
    Form("time_skew", "two_delays", Late, _DELAY, (Draw("share", "1", 0.0, 0.5),)),
    Form("time_skew", "two_lags", TwoLags, _DELAY, (Draw("share", "1", 0.2, 0.8),)),
    Form("time_skew", "wandering", WanderingDelay, _DELAY, (Draw("swing", "1", 0.0, 0.3),)),
    Form("encoder_offset", "mounted", Mounted, _TURNED, (), Where.TURNING, signed=True),
    Form("encoder_offset", "universal_joint", OnAUniversalJoint, _TURNED,
         (Draw("share", "1", 0.0, 0.15), Draw("phase", "rad", 0.0, 6.28)), Where.TURNING,
         signed=True),
    Form("encoder_offset", "belt", OnABelt, _TURNED, (Draw("share", "1", -0.05, 0.05),),
         Where.TURNING, signed=True),
    Form("transducer_bow", "bent", BentLine, _BOW, (Draw("exponent", "1", 0.6, 1.6),),
         outside=True, signed=True),
    Form("transducer_bow", "steps", Steps, _BOW, (Draw("every", "Pa", 1e6, 3e6),), outside=True),
    Form("transducer_bow", "saturating", Saturating, _BOW, (Draw("knee", "Pa", 4e6, 8e6),),
         outside=True),
    Form("crosstalk", "before", Neighbour, _PICKED_UP, outside=True, signed=True),
    Form("crosstalk", "changes", NeighbourChanges, _PICKED_UP, (Draw("over", "s", 0.3, 2.0),),
         outside=True, signed=True),
    Form("crosstalk", "difference", NeighbourDifference, _PICKED_UP, outside=True, signed=True),
)  # fmt: skip


# Zeros of pressure transducers that were lost, in three ways of the other make.


class LastingZero(OneTransducer):
    """A zero that stays where it went."""

    def shown(self, time: np.ndarray, pressure: np.ndarray) -> np.ndarray:
        (offset,) = self.values
        return pressure + offset


class FadingZero(OneTransducer):
    """An offset that is less the higher the pressure, as of a membrane that was overloaded."""

    def shown(self, time: np.ndarray, pressure: np.ndarray) -> np.ndarray:
        """None at a pressure beyond the range."""
        offset, range_end = self.values
        return pressure + offset * (1.0 - pressure / range_end)


class WanderingZero(OneTransducer):
    """A zero that swings slowly about where it went."""

    def shown(self, time: np.ndarray, pressure: np.ndarray) -> np.ndarray:
        offset, swing, period = self.values
        return pressure + offset * (1.0 + swing * np.sin(2.0 * np.pi * time / period))


_OFFSET = Magnitude("offset", "Pa", 5e4, 3e6)

ZERO_FORMS = (
    Form("pressure_offset", "lasting", LastingZero, _OFFSET, signed=True),
    Form("pressure_offset", "fading", FadingZero, _OFFSET,
         (Draw("range_end", "Pa", 6e7, 2e8),), signed=True),
    Form("pressure_offset", "wandering", WanderingZero, _OFFSET,
         (Draw("swing", "1", 0.02, 0.1), Draw("period", "s", 60.0, 300.0)), signed=True),
)  # fmt: skip


# All laws of all effects that a machine of the other make can hide: three of each effect.

_ALL = (*FRICTION_FORMS, *FORCE_FORMS, *ZERO_FORMS, *READING_FORMS)

FAMILIES: dict[str, tuple[Form, ...]] = {
    effect: tuple(forms) for effect, forms in groupby(_ALL, key=lambda form: form.effect)
}
"""Effect to its laws; effects of the catalogue, and some of none."""
