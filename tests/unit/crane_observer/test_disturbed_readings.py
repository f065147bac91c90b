"""Readings that are lost, no numbers, late or out of order: a named condition, and back from it."""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
import pytest
from unit.crane_observer.observed import known, recording

from crane_observer import PositionEstimator, SensorWatch
from crane_observer.monitor.replay import Heed
from crane_observer.payload.estimator import PayloadCondition, PayloadEstimator
from crane_observer.position.estimator import EstimatorCondition

FROM, UNTIL, END = 2100, 2500, 3500  # samples: all joints move
OLD = 3.0  # s by which a late reading is late: longer than that lasts
WAYS = ("lost", "no number", "late", "out of order")


class Cycle(NamedTuple):
    """What comes at a time, with its stamp [s]."""

    encoders: tuple[float, np.ndarray] | None
    oil: tuple[float, np.ndarray, np.ndarray] | None
    supply: float
    command: tuple[float, np.ndarray] | None


def cycles(disturbed: str, way: str) -> Iterator[Cycle]:
    """Samples, of which one kind is disturbed for some time."""
    given = recording()
    for k in range(END):

        def of(kind: str, *values: np.ndarray, k: int = k) -> tuple | None:
            hit = kind == disturbed and FROM <= k < UNTIL
            if hit and way == "lost":
                return None
            row = k ^ 1 if hit and way == "out of order" else k
            stamp = float(given.pressure_time[row]) - (OLD if hit and way == "late" else 0.0)
            number = np.nan if hit and way == "no number" else 1.0
            return (stamp, *(number * series[row] for series in values))

        supply = of("supply", given.supply)
        yield Cycle(
            of("encoders", given.encoders),
            of("pressures", given.chamber_a, given.chamber_b),
            np.nan if supply is None else float(supply[1]),
            of("commands", given.commands),
        )


SENSOR = {
    "encoders": {EstimatorCondition.ENCODER_LOST},
    "pressures": {EstimatorCondition.PRESSURES_LOST},
    "commands": {EstimatorCondition.COMMANDS_LOST},
    "supply": {EstimatorCondition.SUPPLY_LOST},
}


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("disturbed", SENSOR)
def test_the_position_estimator_names_it_and_recovers(disturbed: str, way: str) -> None:
    if disturbed == "supply" and way in ("late", "out of order"):
        pytest.skip("it comes in one message with the pressures")
    given, told = recording(), []
    sensor = PositionEstimator(known(), given.encoders[0])
    for cycle in cycles(disturbed, way):
        if cycle.encoders:
            sensor.add_encoders(*cycle.encoders)
        if cycle.command:
            sensor.add_command(*cycle.command)
        if cycle.oil:
            window = sensor.add_pressures(*cycle.oil, cycle.supply)
            if window is not None:
                told.append(window)
    named = {window.condition for window in told} - {EstimatorCondition.GOOD}
    assert named == (set() if way == "out of order" else SENSOR[disturbed])
    assert told[-1].condition is EstimatorCondition.GOOD
    assert all(np.isfinite(window.estimate.covariance).all() for window in told)
    assert np.abs(told[-1].estimate.position - given.encoders[END - 1]).max() < 2e-3
    counted = {"late": sensor.late, "no number": sensor.invalid, "out of order": sensor.late}
    if disturbed in ("pressures", "commands") and way in counted:
        assert counted[way] >= (UNTIL - FROM) // 2


SCALE = {
    "encoders": {PayloadCondition.POSITIONS_LOST},
    "pressures": {PayloadCondition.PRESSURES_LOST},
}


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("disturbed", SCALE)
def test_the_scale_names_it_and_recovers(disturbed: str, way: str) -> None:
    scale, found = PayloadEstimator(known()), []
    for cycle in cycles(disturbed, way):
        if cycle.encoders:
            scale.add_encoders(*cycle.encoders)
        if cycle.oil:
            found += scale.add_pressures(*cycle.oil)
    healthy = {PayloadCondition.GOOD, PayloadCondition.AT_REST}
    lost = {PayloadCondition.PRESSURES_LOST, PayloadCondition.POSITIONS_LOST}
    time = recording().pressure_time
    during = {
        estimate.condition
        for estimate in found
        if time[FROM] + 0.4 < estimate.time < time[UNTIL - 1]
    }
    if way != "out of order" and during:  # without its clock it tells nothing
        assert during <= lost
        assert during & SCALE[disturbed]
    assert found[-1].condition in healthy
    assert all(np.isfinite(estimate.load.mass) for estimate in found)
    assert scale.late + scale.invalid >= (0 if way == "lost" else (UNTIL - FROM) // 2)


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("disturbed", ["encoders", "pressures"])
def test_the_monitor_names_it_and_recovers(disturbed: str, way: str) -> None:
    watched = SensorWatch(known())
    for cycle in cycles(disturbed, way):
        if cycle.encoders:
            watched.add_encoders(*cycle.encoders)
        if cycle.oil:
            watched.add_pressures(*cycle.oil, cycle.supply)
        if cycle.command:
            watched.add_command(*cycle.command)
    assert watched.condition is Heed.WATCHING
    assert watched.refused > 0 and watched.last_refusal
