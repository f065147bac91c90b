"""What the three observers together cost a cycle of 200 Hz, and their memory over an hour of it."""

import gc
import os
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from unit.crane_observer.observed import known, recording

from crane_observer import PositionEstimator, SensorWatch
from crane_observer.payload.estimator import PayloadEstimator

LOST = 1  # the outer boom, whose encoder the position estimator does without
AT_MOST = 1.0  # ms a cycle
HOUR = 3600.0  # s
PAUSE = 0.5  # s between two rounds of the recording, in which nothing is heard
WARM = 8  # rounds, after which the monitor has all minutes that it keeps
GROWN = 1.02  # times


class Observers:
    """All three, from the same readings."""

    def __init__(self) -> None:
        self.position = PositionEstimator(known(), recording().encoders[0])
        self.monitor, self.scale = SensorWatch(known()), PayloadEstimator(known())
        self.told = 0

    def cycle(self, k: int, now: float) -> None:
        """Sample k of the recording, at `now` [s]."""
        given = recording()
        encoders, oil = given.encoders[k], (given.chamber_a[k], given.chamber_b[k])
        supply = float(given.supply[k])
        left = encoders.copy()
        left[LOST] = np.nan
        self.position.add_encoders(now, left)
        self.told += self.position.add_pressures(now, *oil, supply) is not None
        self.position.add_command(now, given.commands[k])
        self.monitor.add_encoders(now, encoders)
        self.monitor.add_pressures(now, *oil, supply)
        self.monitor.add_command(now, given.commands[k])
        self.scale.add_encoders(now, encoders)
        self.told += len(self.scale.add_pressures(now, *oil))


def rounds(duration: float) -> Iterator[tuple[int, int, float]]:
    """Round, sample and time [s], of the recording over and over."""
    begins, count = recording().pressure_time, 0
    while (begin := count * (begins[-1] + PAUSE)) < duration:
        for k, stamp in enumerate(begins):
            yield count, k, begin + float(stamp)
        count += 1


def test_all_observers_together_leave_the_core_to_others(measured) -> None:
    observers, spent = Observers(), []
    for count, k, now in rounds(3.0 * recording().pressure_time[-1]):
        begin = time.process_time()
        observers.cycle(k, now)
        if count:  # the first compiles
            spent.append(1e3 * (time.process_time() - begin))
    assert observers.told > 1000
    mean, most = float(np.mean(spent)), float(np.percentile(spent, 99.0))
    measured(
        "estimators of positions and payload, sensor monitor: mean and 99 % of the cycles",
        "1 ms a cycle of 200 Hz",
        "{mean:.2f}, {most:.2f} ms",
        mean=mean,
        most=most,
    )
    assert mean <= AT_MOST


def test_memory_stays_over_an_hour_of_samples(measured) -> None:
    observers, warm, last = Observers(), 0.0, 0
    for count, k, now in rounds(HOUR):
        if count == WARM and not warm:
            warm = resident()
        observers.cycle(k, now)
        last = count
    assert last > 100 and warm > 0.0
    hour = resident()
    measured(
        "memory of the process of all three after some minutes, and after an hour of samples",
        "the same",
        "{warm:.0f}, {hour:.0f} MB",
        warm=warm,
        hour=hour,
    )
    assert hour < GROWN * warm


def resident() -> float:
    """MB of this process now."""
    gc.collect()
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6
