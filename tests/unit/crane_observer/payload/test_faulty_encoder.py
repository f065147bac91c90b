"""The payload estimate while an encoder sticks, until and after a finding."""

from dataclasses import replace

import numpy as np
import pytest
from unit.crane_observer.observed import JOINTS, at_work, known, recording

from crane_model import Model
from crane_observer import HeardRecording
from crane_observer.payload.estimator import (
    PayloadCondition,
    PayloadEstimate,
    PayloadEstimator,
    replay,
)

STUCK = (("inner_boom", 20.0, 23.0), ("outer_boom", 4.0, 8.0), ("telescope", 9.4, 11.0))
"""A joint, when its encoder sticks in motion, and the end of a time with the same load [s]."""
NOTICED = 0.15  # s: the first window that ends with half of it stuck


def until(end: float) -> HeardRecording:
    """The recording up to a time [s]; its encoders may be changed."""
    whole = recording()
    count = int(np.searchsorted(whole.pressure_time, end))  # all topics have the same stamps
    time = whole.pressure_time[:count]
    return replace(
        whole, encoder_time=time, encoders=whole.encoders[:count].copy(), pressure_time=time,
        chamber_a=whole.chamber_a[:count], chamber_b=whole.chamber_b[:count],
        supply=whole.supply[:count], command_time=time, commands=whole.commands[:count],
    )  # fmt: skip


def stick(given: HeardRecording, joint: str, begin: float, end: float) -> None:
    """The encoder shows one value from `begin` to `end` [s]."""
    first, last = np.searchsorted(given.encoder_time, [begin, end])
    given.encoders[first:last, JOINTS.index(joint)] = given.encoders[first, JOINTS.index(joint)]


def off(found: list[PayloadEstimate]) -> np.ndarray:
    """(n,) errors, in standard deviations."""
    made, load = at_work()
    time = [estimate.time - 0.15 for estimate in found]
    true = np.interp(time, made.time - made.time[0], load)
    return np.array(
        [(f.load.mass - m) / f.load.deviation for f, m in zip(found, true, strict=True)]
    )


@pytest.mark.parametrize(("joint", "begin", "end"), STUCK)
def test_an_encoder_that_sticks_is_in_doubt_at_once(joint: str, begin: float, end: float) -> None:
    given = until(end)
    stick(given, joint, begin, end)
    found = replay(PayloadEstimator(known()), given)
    sound = [f for f in found if f.time < begin]
    stuck = [f for f in found if f.time > begin + NOTICED]
    assert PayloadCondition.ENCODER_IN_DOUBT not in {estimate.condition for estimate in sound}
    assert {estimate.condition for estimate in stuck} == {PayloadCondition.ENCODER_IN_DOUBT}
    assert np.abs(off(stuck)).max() < 3.0


def test_an_encoder_that_comes_back_is_believed_again() -> None:
    given = until(8.0)
    stick(given, "outer_boom", 4.0, 6.0)
    found = replay(PayloadEstimator(known()), given)
    doubted = [f.time for f in found if f.condition is PayloadCondition.ENCODER_IN_DOUBT]
    # a window of 0.3 s must not hold the moment in which it comes back
    assert min(doubted) < 4.3 and 6.15 < max(doubted) < 6.6
    assert np.abs(off([f for f in found if f.time > 4.0])).max() < 3.0


def without_hydraulics() -> Model:
    return replace(known(), hydraulics=None)


@pytest.mark.parametrize(("model", "deviation"), [(known, 5.0), (without_hydraulics, 50.0)])
def test_a_finding_ends_the_use_of_an_encoder(model: object, deviation: float) -> None:
    """Without hydraulics, the stuck encoder has been believed: the load is forgotten."""
    joint, begin, end = STUCK[0]
    given = until(end)
    stick(given, joint, begin, end)
    assert callable(model)
    estimator = PayloadEstimator(model())
    replay(estimator, given)
    none, no_pressures = np.full(len(JOINTS), np.inf), np.zeros(len(JOINTS), dtype=bool)
    estimator.distrust(np.where(np.array(JOINTS) == joint, begin, none), no_pressures)
    time = end + 0.005 * np.arange(60)
    found = []
    for now in time.tolist():
        estimator.add_encoders(now, given.encoders[-1])
        found += estimator.add_pressures(now, given.chamber_a[-1], given.chamber_b[-1])
    assert {estimate.condition for estimate in found} == {PayloadCondition.POSITIONS_LOST}
    assert abs(found[-1].load.deviation / deviation - 1.0) < 1.0
    estimator.distrust(none, ~no_pressures)
    for now in (time + 0.3).tolist():
        estimator.add_encoders(now, given.encoders[-1])
        found += estimator.add_pressures(now, given.chamber_a[-1], given.chamber_b[-1])
    assert found[-1].condition is PayloadCondition.PRESSURES_LOST
