"""What the benchmark says of the position estimator at work, on the model that knows the values."""

import numpy as np
from unit.crane_observer.observed import at_work, known

from crane_benchmark.observing.machines import stock
from crane_benchmark.observing.observer import ObservedQuantity, ObservedRecording, together


def test_nees_stands_beside_the_band_that_slow_errors_leave() -> None:
    made, _ = at_work()
    hidden = np.array([False, True, False])
    watched = ObservedRecording(stock(), made, known())
    sensor, smoothed, consistency = watched.observe_and_smooth(hidden)
    windows = np.ptp(made.time) / 0.05
    assert consistency.nees == sensor.nees > 0.0
    assert 1.0 <= consistency.freedom < 0.1 * windows
    quantity = ObservedQuantity("it", 2.0, (1.0, 1.0, 1.0, 1.0), sensor, smoothed, consistency)
    alone, twice = together([quantity]), together([quantity, quantity])
    assert alone.values["low"] < twice.values["low"] < 1.0
    assert 1.0 < twice.values["high"] < alone.values["high"]
    assert twice.values["consistent"] in (0.0, 2.0)
    assert twice.values["recordings"] == 2.0
