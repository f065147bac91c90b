"""Readings that are lost, no numbers, late or out of order: a named condition, and back from it."""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
import pytest
from unit.crane_observer.observed import known, recording

from crane_observer.monitor.replay import Heed, SensorWatch
from crane_observer.position.sensor import PositionSensor, SensorCondition
from crane_observer.scale.scale import Scale, ScaleCondition

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
            return (stamp, *(number * one[row] for one in values))

        supply = of("supply", given.supply)
        yield Cycle(
            of("encoders", given.encoders),
            of("pressures", given.chamber_a, given.chamber_b),
            np.nan if supply is None else float(supply[1]),
            of("commands", given.commands),
        )


SENSOR = {
    "encoders": {SensorCondition.ENCODER_LOST},
    "pressures": {SensorCondition.PRESSURES_LOST},
    "commands": {SensorCondition.COMMANDS_LOST},
    "supply": {SensorCondition.SUPPLY_LOST},
}


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("disturbed", SENSOR)
def test_the_position_sensor_names_it_and_recovers(disturbed: str, way: str) -> None:
    if disturbed == "supply" and way in ("late", "out of order"):
        pytest.skip("it comes in one message with the pressures")
    given, told = recording(), []
    sensor = PositionSensor(known(), given.encoders[0])
    for cycle in cycles(disturbed, way):
        if cycle.encoders:
            sensor.add_encoders(*cycle.encoders)
        if cycle.command:
            sensor.add_command(*cycle.command)
        if cycle.oil:
            one = sensor.add_pressures(*cycle.oil, cycle.supply)
            if one is not None:
                told.append(one)
    named = {one.condition for one in told} - {SensorCondition.GOOD}
    assert named == (set() if way == "out of order" else SENSOR[disturbed])
    assert told[-1].condition is SensorCondition.GOOD
    assert all(np.isfinite(one.estimate.covariance).all() for one in told)
    assert np.abs(told[-1].estimate.position - given.encoders[END - 1]).max() < 2e-3
    counted = {"late": sensor.late, "no number": sensor.invalid, "out of order": sensor.late}
    if disturbed in ("pressures", "commands") and way in counted:
        assert counted[way] >= (UNTIL - FROM) // 2


SCALE = {
    "encoders": {ScaleCondition.POSITIONS_LOST},
    "pressures": {ScaleCondition.PRESSURES_LOST},
}


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("disturbed", SCALE)
def test_the_scale_names_it_and_recovers(disturbed: str, way: str) -> None:
    scale, found = Scale(known()), []
    for cycle in cycles(disturbed, way):
        if cycle.encoders:
            scale.add_encoders(*cycle.encoders)
        if cycle.oil:
            found += scale.add_pressures(*cycle.oil)
    healthy = {ScaleCondition.GOOD, ScaleCondition.AT_REST}
    lost = {ScaleCondition.PRESSURES_LOST, ScaleCondition.POSITIONS_LOST}
    time = recording().pressure_time
    during = {one.condition for one in found if time[FROM] + 0.4 < one.time < time[UNTIL - 1]}
    if way != "out of order" and during:  # without its clock it tells nothing
        assert during <= lost
        assert during & SCALE[disturbed]
    assert found[-1].condition in healthy
    assert all(np.isfinite(one.load.mass) for one in found)
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
