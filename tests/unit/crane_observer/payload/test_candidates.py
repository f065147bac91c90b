"""Loads that come and go in windows made by the filter's own equation, with what standing hides."""

import math

import numpy as np
import pytest
from unit.crane_observer.payload.made_windows import BY_MASS, DRY, HOP, MOVING, STANDING, window

from crane_observer.payload.filter import MASS, LoadFilter, LoadState, ModelDoubt, TipLoad
from crane_observer.payload.hypotheses import MOST_CANDIDATES, LoadCandidate, LoadHypothesis


def work(
    loads: list[float], held: float, seed: int
) -> tuple[LoadHypothesis, list[float], list[float]]:
    """Each load comes at rest and is moved up, then down. When changes were noticed, and what was
    known of each load at last.
    """
    rng, changes = np.random.default_rng(seed), LoadHypothesis(ModelDoubt(), 3)
    time, noticed, known = 0.0, [], []
    for load in loads:
        for direction in [0.0] * STANDING + [1.0] * MOVING + [-1.0] * MOVING:
            time += HOP
            if changes.add(time, window(load, direction, held, rng)):
                noticed.append(time)
        known.append(float(changes.filter.x[MASS]))
    return changes, noticed, known


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("held", [-1.0, 0.0, 1.0])
def test_friction_that_holds_a_load_at_rest_does_not_hide_it(held: float, seed: int) -> None:
    """It came while the joints stood: how friction holds them then is nothing to go by."""
    loads = [0.0, 90.0, 0.0, 25.0, 0.0]
    _, noticed, known = work(loads, held, seed)
    assert known == pytest.approx(loads, abs=5.0)
    assert len(noticed) == len(loads) - 1
    cycle = HOP * (STANDING + 2 * MOVING)
    for number, time in enumerate(noticed, start=1):
        assert 0.0 < time - number * cycle < HOP * (STANDING + 8)


@pytest.mark.parametrize("seed", range(10))
def test_a_load_that_stays_is_no_other_one(seed: int) -> None:
    """However friction holds it, in rest after rest."""
    held = np.random.default_rng(seed).uniform(-1.0, 1.0)
    changes, noticed, known = work([60.0] * 6, held, seed)
    assert len(noticed) <= 1  # it was noticed, if it was not known from the start
    assert known[-1] == pytest.approx(60.0, abs=2.0)
    assert changes.since <= HOP * (STANDING + MOVING)


def test_a_window_that_nothing_explains_changes_no_load() -> None:
    rng = np.random.default_rng(1)
    changes, _, _ = work([60.0], 0.0, 1)
    wrong = window(60.0, 1.0, 0.0, rng)
    odd = wrong._replace(balance=wrong.balance._replace(force=np.array([3e3, -4e3, 5e3])))
    assert not changes.add(1e3, odd)
    for k in range(10):
        assert not changes.add(1e3 + (k + 1) * HOP, window(60.0, 1.0, 0.0, rng))
    assert changes.filter.x[MASS] == pytest.approx(60.0, abs=2.0)


@pytest.mark.parametrize("grows", [0.0, 0.03, 0.06])
def test_friction_that_grows_with_the_load_is_learnt_and_not_weighed(grows: float) -> None:
    """The outer boom is moved up and down with loads, in turn; none counts as heavier."""
    rng, changes = np.random.default_rng(3), LoadHypothesis(ModelDoubt(), 3)
    known, loads, carried = [], [0.0, 120.0, 0.0, 60.0], 80.0 * BY_MASS
    for number, load in enumerate(loads):
        for k, direction in enumerate([0.0] * STANDING + [1.0] * MOVING + [-1.0] * MOVING):
            balanced = window(load, direction, 0.0, rng)
            more = carried + grows * np.array([0.0, direction, 0.0]) * (carried + BY_MASS * load)
            balance = balanced.balance._replace(force=balanced.balance.force + more, asked=carried)
            changes.add(100.0 * number + HOP * k, balanced._replace(balance=balance))
        known.append(float(changes.filter.x[MASS]))
    # 6 % is two standard deviations from what is usual: not all of it is believed
    assert known == pytest.approx(loads, abs=2.0)
    learnt = changes.filter.x[changes.filter.of(LoadState.CARRIED)][1]
    assert learnt == pytest.approx(grows, abs=0.02)


def crawl_to_a_stop(doubt: ModelDoubt, load: float, rubs: float) -> tuple[LoadHypothesis, bool]:
    """A load is weighed; then only the inner boom moves on, slower and slower, in a pose in which
    the load hardly pulls at it, and rubs by a share of its dry friction more when about to stop.
    What is known then, and whether another load was noticed.
    """
    rng, changes = np.random.default_rng(4), LoadHypothesis(doubt, 3)
    for k, direction in enumerate([0.0] * STANDING + [1.0] * MOVING + [-1.0] * MOVING):
        changes.add(HOP * k, window(load, direction, 0.0, rng))
    by_mass, inner = np.array([-1.5, -15.0, -8.0]), np.array([True, False, False])
    noticed = False
    for k, crawling in enumerate(np.concatenate([np.zeros(10), np.linspace(0.1, 0.7, 8)])):
        balanced = window(load, 0.0, 0.0, rng)
        force = by_mass * load - DRY * inner * (1.0 + rubs * crawling) + rng.normal(0.0, 15.0, 3)
        balanced = balanced._replace(
            balance=balanced.balance._replace(force=force, mass=by_mass, moment=0.1 * by_mass),
            moving=inner, standing=~inner, crawling=crawling * inner,
        )  # fmt: skip
        noticed |= changes.add(100.0 + HOP * k, balanced)
    return changes, noticed


@pytest.mark.parametrize("load", [0.0, 38.0, 120.0])
@pytest.mark.parametrize("rubs", [-0.15, 0.15, 0.25])
def test_friction_of_a_joint_that_is_about_to_stop_is_no_other_load(
    rubs: float, load: float
) -> None:
    changes, noticed = crawl_to_a_stop(ModelDoubt(), load, rubs)
    assert not noticed
    assert abs(changes.load.mass - load) < 2.0 * changes.load.deviation < 10.0


@pytest.mark.parametrize("held", [-0.9, 0.9])
def test_a_joint_that_sticks_and_slips_tells_no_more_the_longer_it_does(held: float) -> None:
    """Its friction is about the same all the while, and not drawn anew in each window."""
    rng, changes = np.random.default_rng(6), LoadHypothesis(ModelDoubt(), 3)
    slips = np.array([True, False, False])
    for k in range(40):
        balanced = window(0.0, 0.0, 0.0, rng)
        force = DRY * held * slips + rng.normal(0.0, 15.0, 3)
        balance = balanced.balance._replace(force=force)
        changes.add(HOP * k, balanced._replace(balance=balance, standing=~slips))
    assert abs(changes.load.mass) < 2.0 * changes.load.deviation


def test_what_came_later_than_the_noticed_load_stays_in_question_beside_it() -> None:
    """As far behind as it is, and with nothing of its lead over the load before."""
    chosen = LoadCandidate(1.0, LoadFilter(ModelDoubt(), 3), ahead=12.0, leading=2)
    later = LoadCandidate(2.0, LoadFilter(ModelDoubt(), 3), windows=7, ahead=11.0, leading=1)
    beside = later.beside(chosen)
    assert (beside.ahead, beside.leading, beside.windows) == (-1.0, 0, 7)
    assert beside.filter is later.filter


@pytest.mark.parametrize(("mass", "differs"), [(50.0, False), (62.0, True)])
def test_a_load_differs_from_what_the_same_one_is_taken_for_now(mass: float, differs: bool) -> None:
    unknown, same = LoadFilter(ModelDoubt(), 3), TipLoad(45.0, 5.0, math.nan, math.nan)
    unknown.x[MASS], unknown.P[MASS, MASS] = mass, 5.0**2
    assert LoadCandidate(0.0, unknown).differs(same) is differs


def test_less_than_nothing_does_not_hang_there() -> None:
    """Of two that predict as well, the one that would pull upwards is the less likely."""
    heavy, floating = LoadFilter(ModelDoubt(), 3), LoadFilter(ModelDoubt(), 3)
    for load_filter, mass in ((heavy, 40.0), (floating, -40.0)):
        load_filter.x[MASS], load_filter.P[MASS, MASS] = mass, 5.0**2
    assert LoadCandidate(0.0, heavy, ahead=8.0).likelihood == pytest.approx(8.0, abs=0.1)
    assert LoadCandidate(0.0, floating, ahead=8.0).likelihood < -5.0


def test_the_same_load_with_other_errors_crowds_out_no_load_that_comes() -> None:
    """As after a start that nothing explained: what begins later predicts all that follows better,
    and says the same load.
    """
    rng = np.random.default_rng(2)
    changes, _, _ = work([140.0], 0.0, 2)
    changes._candidates = [
        LoadCandidate(-float(k), changes.filter.copy(), windows=99, ahead=12.0)
        for k in range(MOST_CANDIDATES)
    ]
    noticed = [
        changes.add(1e3 + HOP * k, window(0.0, direction, 0.0, rng))
        for k, direction in enumerate([0.0] * STANDING + [1.0] * MOVING)
    ]
    assert sum(noticed) == 1
    assert changes.load.mass == pytest.approx(0.0, abs=5.0)


def test_what_may_have_happened_beside_widens_what_is_told() -> None:
    """Two explanations of one event, as likely as each other: neither is told as sure."""
    changes = LoadHypothesis(ModelDoubt(), 3)
    changes.filter.x[MASS], changes.filter.P[MASS, MASS] = 20.0, 1.0
    heavier = changes.filter.copy()
    heavier.x[MASS] = 40.0
    changes._candidates = [LoadCandidate(1.0, heavier, seldom=0.0)]
    assert changes.load.mass == pytest.approx(30.0, abs=1.0)
    assert changes.load.deviation == pytest.approx(10.0, abs=1.0)


def test_what_is_told_is_the_mean_over_what_may_have_come() -> None:
    """By Bayes: a load that predicts a hundred times better, and comes once in a hundred windows,
    is as likely as the same load; noticed it is not yet.
    """
    changes = LoadHypothesis(ModelDoubt(), 3)
    changes.filter.x[MASS], changes.filter.P[MASS, MASS] = 11.0, 1.5**2
    heavier = changes.filter.copy()
    heavier.x[MASS] = 24.0
    changes._candidates = [LoadCandidate(1.0, heavier, math.log(100.0), ahead=math.log(100.0))]
    assert changes.load.mass == pytest.approx((11.0 + 24.0) / 2.0, abs=0.1)
    assert changes.load.deviation == pytest.approx(math.hypot(1.5, 13.0 / 2.0), abs=0.1)
    changes._candidates = [LoadCandidate(1.0, heavier, ahead=-5.0)]
    assert changes.load.mass == pytest.approx(11.0, abs=0.1)
