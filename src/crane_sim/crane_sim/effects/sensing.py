"""Families of hidden faults of sensors: zeros, gains, delays, and some that no catalogue has."""

from collections.abc import Sequence

import numpy as np

from crane_model.machine import Machine
from crane_sim.effects import encoders, readings, transducers
from crane_sim.effects.form import Draw, Form, Magnitude, Planted, SensorFault, Where


def faults(planted: Sequence[Planted], machine: Machine) -> tuple[SensorFault, ...]:
    """The faults among hidden effects, in their order."""
    return tuple(
        effect.form.law(machine, effect.joint, effect.values)
        for effect in planted
        if not isinstance(effect.form.law, int) and effect.joint is not None
    )


_OFFSET = Magnitude("offset", "Pa", 5e4, 3e6)
_GAIN_B = Magnitude("gain", "1", 0.02, 0.8)
_TURNED = Magnitude("offset", "{coordinate}", 0.01, 0.2)
_BOW, _SPAN = Magnitude("bow", "Pa", 5e4, 3e6), Draw("span", "Pa", 1.2e7, 2.0e7)
_RIPPLE, _RATE = Magnitude("ripple", "Pa", 5e4, 3e6), Draw("frequency", "Hz", 1.0, 4.0)
_ERROR = Magnitude("error", "{coordinate}", 0.01, 0.1)
_DISK = (Draw("turns", "rad/{coordinate}", 6.0, 16.0), Draw("phase", "rad", 0.0, 2 * np.pi))
_PICKED_UP = Magnitude("share", "1", 0.02, 0.5)

FORMS = (
    Form("pressure_offset", "warming", transducers.Zero, _OFFSET,
         (Draw("recovery", "1", 0.0, 0.1), Draw("warming", "s", 30.0, 90.0)), signed=True),
    Form("pressure_offset", "drifting", transducers.DriftingZero, _OFFSET,
         (Draw("drift", "1/min", -0.1, 0.1),), signed=True),
    Form("pressure_offset", "overloaded", transducers.OverloadedZero, _OFFSET,
         (Draw("stiff", "Pa", 6e7, 2e8),), signed=True),
    Form("pressure_gain", "both", transducers.BothGains, Magnitude("gain", "1", 0.02, 0.5),
         signed=True),
    Form("chamber_gain", "chamber_b", transducers.GainOfB, _GAIN_B, signed=True),
    Form("chamber_gain", "pressed", transducers.PressedGainOfB, _GAIN_B,
         (Draw("exponent", "1", 0.8, 1.2),), signed=True),
    Form("chamber_gain", "opposed", transducers.OpposedGains, _GAIN_B,
         (Draw("share", "1", 0.0, 0.5),), signed=True),
    Form("encoder_offset", "turned", encoders.Turned, _TURNED, (), Where.TURNING, signed=True),
    Form("encoder_offset", "strained", encoders.Strained, _TURNED,
         (Draw("share", "1", 0.0, 0.2), Draw("phase", "rad", 0.0, 2 * np.pi)), Where.TURNING,
         signed=True),
    Form("encoder_offset", "slipped", encoders.Slipped, _TURNED, (Draw("share", "1", -0.1, 0.1),),
         Where.TURNING, signed=True),
    Form("time_skew", "delay", readings.DelayedReadings, Magnitude("delay", "s", 0.01, 0.2)),
    Form("time_skew", "lag", readings.LaggingReadings, Magnitude("lag", "s", 0.01, 0.2)),
    Form("time_skew", "averaged", readings.AveragedReadings, Magnitude("delay", "s", 0.01, 0.2),
         (Draw("share", "1", 0.3, 1.0),)),
    Form("crosstalk", "next_joint", readings.Crosstalk, _PICKED_UP,
         outside=True, signed=True),
    Form("crosstalk", "of_chamber_a", readings.CrosstalkOfA, _PICKED_UP,
         outside=True, signed=True),
    Form("crosstalk", "shared_ground", readings.SharedGround, _PICKED_UP,
         (Draw("exponent", "1", 1.4, 2.4),), outside=True, signed=True),
    Form("encoder_eccentricity", "disk", encoders.Eccentric, _ERROR, _DISK, Where.TURNING,
         outside=True),
    Form("encoder_eccentricity", "two_lobes", encoders.TwoLobes, _ERROR,
         (*_DISK, Draw("second", "1", 0.2, 0.6)), Where.TURNING, outside=True),
    Form("encoder_eccentricity", "graduation", encoders.Graduation, _ERROR, _DISK, Where.TURNING,
         outside=True),
    Form("transducer_bow", "parabola", transducers.Bow, _BOW, (_SPAN,),
         outside=True, signed=True),
    Form("transducer_bow", "cubic", transducers.CubicBow, _BOW, (_SPAN,),
         outside=True, signed=True),
    Form("transducer_bow", "knee", transducers.Knee, _BOW, (Draw("knee", "Pa", 3e6, 6e6), _SPAN),
         outside=True, signed=True),
    Form("pressure_ripple", "pump", readings.Ripple, _RIPPLE, (_RATE,), outside=True),
    Form("pressure_ripple", "wandering", readings.WanderingRipple, _RIPPLE,
         (_RATE, Draw("wander", "s", 0.02, 0.1)), outside=True),
    Form("pressure_ripple", "two_pumps", readings.TwoRipples, _RIPPLE,
         (_RATE, Draw("ratio", "1", 1.3, 2.2)), outside=True),
)  # fmt: skip
