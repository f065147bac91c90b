"""Histories side by side: loads that friction could be, and what comes after them tells."""

import math

import numpy as np
import pytest
from unit.crane_observer.scale.made_windows import BY_MASS, HOP, MOVING, STANDING, window

from crane_observer.scale.changes import AHEAD, MOST, NEW, UNLIKELY, Changes, Histories, OtherLoad
from crane_observer.scale.filter import MASS, Balanced, LoadFilter, ModelDoubt

REST = [0.0] * STANDING
UP, DOWN = REST + [1.0] * MOVING, REST + [-1.0] * MOVING


def work(
    changes: Changes | Histories, carried: float, moves: list[tuple[float, list[float]]], seed: int
) -> tuple[list[float], int]:
    """Of a crane that carries so many kg itself: what is told after each move with a load, and how
    many changes were noticed. Friction is that of the model.
    """
    rng, time, told, noticed = np.random.default_rng(seed), 0.0, [], 0
    for load, directions in moves:
        for direction in directions:
            time += HOP
            one = window(load, direction, 0.0, rng)
            own = carried * BY_MASS
            balance = one.balance._replace(force=one.balance.force + own, asked=own)
            noticed += changes.add(time, one._replace(balance=balance))
        told.append(changes.load.mass)
    return told, noticed


def history(mass: float, deviation: float, evidence: float = 0.0, since: float = 0.0) -> Changes:
    """One in which that hangs there."""
    one = Changes(ModelDoubt(), 3)
    one.filter, one.evidence, one.since = filter_of(mass, deviation), evidence, since
    return one


def filter_of(mass: float, deviation: float) -> LoadFilter:
    """One that knows a load."""
    known = LoadFilter(ModelDoubt(), 3)
    known.x[MASS], known.P[MASS, MASS] = mass, deviation**2
    return known


def blind() -> Balanced:
    """A window that tells nothing: no pressure is known."""
    one = window(0.0, 0.0, 0.0, np.random.default_rng(1))
    return one._replace(balance=one.balance._replace(force=np.full(3, np.nan)))


def side_by_side(*each: Changes) -> Histories:
    """The first is believed."""
    histories = Histories(ModelDoubt(), 3)
    histories._each = list(each)
    return histories


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize(("carried", "load"), [(100.0, 20.0), (300.0, 30.0)])
def test_what_comes_later_tells_a_load_from_friction(
    carried: float, load: float, seed: int
) -> None:
    """The crane moves down empty, then up with a load: as well, friction could have grown. What one
    history took for friction, it weighs wrong for good.
    """
    moves = [(0.0, DOWN), (load, UP), (0.0, DOWN), (40.0, UP), (0.0, UP + DOWN), (60.0, UP + DOWN)]
    loads = [load for load, _ in moves]
    told, noticed = work(Histories(ModelDoubt(), 3), carried, moves, seed)
    assert told == pytest.approx(loads, abs=3.0)
    assert noticed == len(loads) - 1
    alone, _ = work(Changes(ModelDoubt(), 3), carried, moves, seed)
    assert abs(alone[-1] - loads[-1]) > 5.0


@pytest.mark.parametrize("seed", range(5))
def test_what_one_history_weighs_well_several_do(seed: int) -> None:
    rng = np.random.default_rng(seed)
    loads = [0.0, *rng.uniform(20.0, 150.0, 2), 0.0, float(rng.uniform(20.0, 150.0))]
    moves = [(load, UP + DOWN) for load in loads]
    told, noticed = work(Histories(ModelDoubt(), 3), 100.0, moves, seed)
    assert told == pytest.approx(loads, abs=3.0)
    assert noticed == len(loads) - 1


def test_the_mean_over_all_histories_is_told() -> None:
    """By Bayes: of two that foretold as well, neither is told as sure; of one that foretold a
    thousand times worse, little.
    """
    even = side_by_side(history(20.0, 1.0), history(40.0, 1.0)).load
    assert even.mass == pytest.approx(30.0, abs=0.1)
    assert even.deviation == pytest.approx(math.hypot(1.0, 10.0), abs=0.1)
    odd = side_by_side(history(20.0, 1.0), history(40.0, 1.0, -math.log(1000.0))).load
    assert odd.mass == pytest.approx(20.0 + 20.0 / 1001.0, abs=0.01)


def test_a_load_is_as_likely_as_all_moments_at_which_it_may_have_come() -> None:
    one = history(10.0, 1.0)
    one._others = [
        OtherLoad(float(k), filter_of(30.0, 4.0), math.log(50.0), NEW + 1, ahead=1.0)
        for k in range(4)
    ]
    later = OtherLoad(9.0, filter_of(60.0, 4.0), math.log(50.0), NEW + 1, ahead=-9.0)
    one._others.append(later)
    fork = one.fork([one.same], -4.0)
    assert fork is not None
    assert fork.likelihood == pytest.approx(math.log(4.0) + 1.0 - math.log(50.0), abs=0.01)
    assert fork.same.mass == pytest.approx(30.0, abs=0.1)
    assert one._others == [later]  # none is counted twice


@pytest.mark.parametrize(
    ("mass", "windows", "least"),
    [(30.0, NEW, -4.0), (30.0, NEW + 1, -2.0), (16.0, NEW + 1, -4.0)],
)
def test_what_is_new_or_unlikely_or_the_same_load_makes_no_history(
    mass: float, windows: int, least: float
) -> None:
    one = history(10.0, 1.0)
    one._others = [OtherLoad(1.0, filter_of(mass, 4.0), math.log(50.0), windows, ahead=1.0)]
    assert one.fork([one.same], least) is None
    assert len(one._others) == 1


def test_a_load_that_went_has_to_have_been_one() -> None:
    """A history that had the tip pulling upwards stays unlikely when the next load comes."""
    one = history(-40.0, 5.0)
    one.add(1.0, blind())
    (other,) = one._others
    other.filter, other.windows = filter_of(30.0, 4.0), NEW + 1
    other.ahead = 20.0
    fork = one.fork([one.same], -1e9)
    assert fork is not None
    # 30 kg less than what may be missing, which is 6 standard deviations
    assert fork.evidence == pytest.approx(20.0 + math.log(1e-9) - math.log(50.0), abs=0.2)


@pytest.mark.parametrize(("behind", "kept"), [(UNLIKELY - 1.0, 2), (UNLIKELY + 1.0, 1)])
def test_a_history_that_has_become_unlikely_is_given_up(behind: float, kept: int) -> None:
    histories = side_by_side(history(20.0, 1.0), history(40.0, 1.0, -behind))
    assert not histories.add(1.0, blind())
    assert len(histories._each) == kept


@pytest.mark.parametrize(("ahead", "changed"), [(AHEAD - 1.0, False), (AHEAD + 1.0, True)])
def test_one_that_is_far_likelier_is_believed_and_the_change_is_told(
    ahead: float, changed: bool
) -> None:
    histories = side_by_side(history(20.0, 1.0), history(40.0, 1.0, ahead, since=7.0))
    assert histories.add(8.0, blind()) is changed
    assert histories.since == (7.0 if changed else 0.0)


@pytest.mark.parametrize(("since", "kept"), [(1.0, 1), (5.0, 2)])
def test_the_same_load_in_two_histories_is_counted_once(since: float, kept: int) -> None:
    histories = side_by_side(history(20.0, 1.0), history(20.5, 1.0, since=since))
    histories.add(6.0, blind())
    assert len(histories._each) == kept


@pytest.mark.parametrize(("direction", "windows"), [(0.0, 50.0), (1.0, 200.0)])
def test_loads_come_more_often_to_a_crane_that_stands(direction: float, windows: float) -> None:
    one = history(10.0, 1.0)
    one.add(1.0, window(10.0, direction, 0.0, np.random.default_rng(1)))
    assert one._others[-1].seldom == pytest.approx(math.log(windows))


def test_histories_stay_few_over_work_that_leaves_much_open() -> None:
    """Always in one direction, so that friction and load are told apart badly."""
    rng, histories, most, time = np.random.default_rng(5), Histories(ModelDoubt(), 3), 0, 0.0
    own = 300.0 * BY_MASS
    for _ in range(30):
        load = float(rng.choice([0.0, 15.0, 30.0, 60.0]))
        for direction in UP if rng.uniform() < 0.5 else DOWN:
            time += HOP
            one = window(load, direction, rng.uniform(-0.5, 0.5), rng)
            balance = one.balance._replace(force=one.balance.force + own, asked=own)
            histories.add(time, one._replace(balance=balance))
            most = max(most, len(histories._each))
            best = max(each.likelihood for each in histories._each)
            others = [each.likelihood for each in histories._each[1:]]
            assert all(likelihood > best - UNLIKELY for likelihood in others)
    assert 1 < most <= MOST
