"""The spool as a model file tells it: late by the lag that was measured, however divided."""

import numpy as np
import pytest

from crane_model.hydraulics import Measured, ValveValues
from crane_model.hydraulics.simulation import valve_openings

STEP, SLOPE = 1e-3, 0.2  # s; of the stroke a second
UNKNOWN = {"supply_a": 1e-7, "a_tank": 1e-7, "supply_b": 1e-7, "b_tank": 1e-7}


def valve(lag: float, frequency: float, damping: float) -> ValveValues:
    values = {"dead_band_a": 0.0, "dead_band_b": 0.0, "hysteresis": 0.0, "lag": lag}
    values |= {"natural_frequency": frequency, "damping_ratio": damping} | UNKNOWN
    units = ValveValues.units
    return ValveValues(**{name: Measured(value=values[name], unit=units[name]) for name in units})


@pytest.mark.parametrize(
    ("lag", "frequency", "damping"),
    [(0.030, 100.0, 0.8), (0.0103, 108.0, 0.8), (0.010, 30.0, 1.4), (0.002, 500.0, 0.5)],
    ids=["with delay", "slower than the valve", "much slower", "just as slow"],
)
def test_an_opening_trails_a_ramp_by_the_lag(lag: float, frequency: float, damping: float) -> None:
    stamps = STEP * np.arange(2000)
    times = stamps[1000:] + 0.25 * STEP
    values = valve(lag, frequency, damping)
    opened = valve_openings(values, 1.0, stamps, SLOPE * stamps, times)
    held = 0.5 * STEP  # by which steps trail the ramp
    assert opened.mean() == pytest.approx(SLOPE * (times.mean() - lag - held), abs=SLOPE * 1e-4)
    assert values.delay >= 0.0
