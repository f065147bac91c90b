"""Faults of sensors of the other make: three of each effect of the catalogue, and of others."""

from itertools import groupby

import numpy as np
from scipy.signal import lfilter

from crane_benchmark.independent.effects import FORCE_FORMS, FRICTION_FORMS
from crane_sim.effects.form import Draw, Form, Magnitude, Where
from crane_sim.effects.sensing import of_both, of_chamber_a, of_encoder, of_neighbour

FULL = 2.5e7  # Pa, of a transducer


def _two_delays(time: np.ndarray, pressure: np.ndarray, delay: float, share: float) -> np.ndarray:
    """Held back by the bus, and once more by a share of it."""
    first = np.interp(time - delay * (1.0 - share), time, pressure)
    return (first + np.interp(time - delay * (1.0 + share), time, pressure)) / 2.0


def _lagging(time: np.ndarray, pressure: np.ndarray, lag: float) -> np.ndarray:
    """Behind a filter of first order."""
    step = float(np.median(np.diff(time)))
    keep = lag / (lag + step)
    return np.asarray(lfilter([1.0 - keep], [1.0, -keep], pressure, zi=[keep * pressure[0]])[0])


_OFFSET = Magnitude("offset", "Pa", 5e4, 3e6)
_GAIN = Magnitude("gain", "1", 0.02, 0.8)
_DELAY = Magnitude("delay", "s", 0.01, 0.2)
_TURNED = Magnitude("offset", "{coordinate}", 0.01, 0.2)
_DEVIATION = Magnitude("deviation", "Pa", 5e4, 3e6)
_PICKED_UP = Magnitude("share", "1", 0.02, 0.5)
ZERO_FORMS = (
    Form("pressure_offset", "lasting", of_chamber_a(lambda time, p, offset: p + offset),
         _OFFSET, signed=True),
    # less the higher the pressure, as of a membrane that was overloaded
    Form("pressure_offset", "fading",
         of_chamber_a(lambda time, p, offset, end: p + offset * (1.0 - p / end)),
         _OFFSET, (Draw("range_end", "Pa", 6e7, 2e8),), signed=True),
    Form("pressure_offset", "wandering",
         of_chamber_a(lambda time, p, offset, swing, period:
                      p + offset * (1.0 + swing * np.sin(2.0 * np.pi * time / period))),
         _OFFSET, (Draw("swing", "1", 0.02, 0.1), Draw("period", "s", 60.0, 300.0)), signed=True),
)  # fmt: skip
READING_FORMS = (
    Form("chamber_gain", "plain", of_chamber_a(lambda time, p, gain: p * (1.0 + gain)),
         _GAIN, signed=True),
    # falls as the membrane stiffens
    Form("chamber_gain", "soft_membrane",
         of_chamber_a(lambda time, p, gain, stiffness:
                      p * (1.0 + gain / (1.0 + p / (stiffness * FULL)))),
         _GAIN, (Draw("stiffness", "1", 1.0, 4.0),), signed=True),
    # creeps while the machine is on
    Form("chamber_gain", "ageing",
         of_chamber_a(lambda time, p, gain, creep: p * (1.0 + gain * (1.0 + creep * time / 60.0))),
         _GAIN, (Draw("creep", "1/min", -0.1, 0.1),), signed=True),
    Form("time_skew", "two_delays", of_both(_two_delays), _DELAY, (Draw("share", "1", 0.0, 0.5),)),
    Form("time_skew", "two_lags",
         of_both(lambda time, p, delay, share:
                 _lagging(time, _lagging(time, p, share * delay), (1.0 - share) * delay)),
         _DELAY, (Draw("share", "1", 0.2, 0.8),)),
    # a bus whose load swings slowly
    Form("time_skew", "wandering",
         of_both(lambda time, p, delay, swing:
                 np.interp(time - delay * (1.0 + swing * np.sin(0.3 * time)), time, p)),
         _DELAY, (Draw("swing", "1", 0.0, 0.3),)),
    Form("encoder_offset", "mounted", of_encoder(lambda q, offset: np.full_like(q, offset)),
         _TURNED, (), Where.TURNING, signed=True),
    # behind a bent universal joint: twice a turn it runs ahead
    Form("encoder_offset", "universal_joint",
         of_encoder(lambda q, offset, share, phase:
                    offset * (1.0 + share * np.sin(2.0 * q + phase))),
         _TURNED, (Draw("share", "1", 0.0, 0.15), Draw("phase", "rad", 0.0, 6.28)), Where.TURNING,
         signed=True),
    # by a belt that jumped a tooth and stretches towards one end
    Form("encoder_offset", "belt",
         of_encoder(lambda q, offset, share: offset * (1.0 + share * q * np.abs(q))),
         _TURNED, (Draw("share", "1", -0.05, 0.05),), Where.TURNING, signed=True),
    # bent between the ends: by the sine, or its square
    Form("transducer_nonlinearity", "bent",
         of_chamber_a(lambda time, p, deviation, exponent:
                      p + deviation * np.sin(np.pi * np.clip(p / FULL, 0.0, 1.0) ** exponent)),
         _DEVIATION, (Draw("exponent", "1", 0.6, 1.6),), outside=True, signed=True),
    # a converter of which one bit is wrong: the reading climbs in rounded steps
    Form("transducer_nonlinearity", "steps",
         of_chamber_a(lambda time, p, deviation, every:
                      p + deviation * np.tanh(3.0 * np.sin(2.0 * np.pi * p / every))),
         _DEVIATION, (Draw("every", "Pa", 1e6, 3e6),), outside=True),
    # falls behind as the pressure rises
    Form("transducer_nonlinearity", "saturating",
         of_chamber_a(lambda time, p, deviation, knee:
                      p - deviation * (np.maximum(p, 0.0) / (2.0 * knee)) ** 3),
         _DEVIATION, (Draw("knee", "Pa", 4e6, 8e6),), outside=True),
    Form("crosstalk", "before", of_neighbour(1, -1, lambda time, a, b: a), _PICKED_UP,
         outside=True, signed=True),
    # changes alone, by the capacity between two cables
    Form("crosstalk", "changes",
         of_neighbour(1, -1, lambda time, a, b, over: b - _lagging(time, b, over)),
         _PICKED_UP, (Draw("over", "s", 0.3, 2.0),), outside=True, signed=True),
    # by a ground that both transducers share
    Form("crosstalk", "difference", of_neighbour(1, -1, lambda time, a, b: a - b), _PICKED_UP,
         outside=True, signed=True),
)  # fmt: skip

# All laws of all effects that a machine of the other make can hide: three of each effect.
_ALL = (*FRICTION_FORMS, *FORCE_FORMS, *ZERO_FORMS, *READING_FORMS)
FAMILIES: dict[str, tuple[Form, ...]] = {
    effect: tuple(forms) for effect, forms in groupby(_ALL, key=lambda form: form.effect)
}
"""Effect to its laws; effects of the catalogue, and some of none."""
