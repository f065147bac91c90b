"""Hypotheses side by side: loads that friction could be, and what comes after them tells."""

import math

import numpy as np
import pytest
from unit.crane_observer.payload.made_windows import BY_MASS, HOP, MOVING, STANDING, window

from crane_observer.payload.filter import MASS, Balanced, LoadFilter, ModelDoubt
from crane_observer.payload.hypotheses import (
    AHEAD,
    MOST_HYPOTHESES,
    NEW_WINDOWS,
    UNLIKELY,
    LoadCandidate,
    LoadHypotheses,
    LoadHypothesis,
)

REST = [0.0] * STANDING
UP, DOWN = REST + [1.0] * MOVING, REST + [-1.0] * MOVING


def work(
    changes: LoadHypothesis | LoadHypotheses,
    carried: float,
    moves: list[tuple[float, list[float]]],
    seed: int,
) -> tuple[list[float], int]:
    """Of a crane that carries so many kg itself: what is told after each move with a load, and how
    many changes were noticed. Friction is that of the model.
    """
    rng, time, told, noticed = np.random.default_rng(seed), 0.0, [], 0
    for load, directions in moves:
        for direction in directions:
            time += HOP
            balanced = window(load, direction, 0.0, rng)
            carried_force = carried * BY_MASS
            balance = balanced.balance._replace(
                force=balanced.balance.force + carried_force, asked=carried_force
            )
            noticed += changes.add(time, balanced._replace(balance=balance))
        told.append(changes.load.mass)
    return told, noticed


def history(
    mass: float, deviation: float, evidence: float = 0.0, since: float = 0.0
) -> LoadHypothesis:
    """One in which that hangs there."""
    hypothesis = LoadHypothesis(ModelDoubt(), 3)
    hypothesis.filter, hypothesis.evidence, hypothesis.since = (
        filter_of(mass, deviation),
        evidence,
        since,
    )
    return hypothesis


def filter_of(mass: float, deviation: float) -> LoadFilter:
    """One that knows a load."""
    known = LoadFilter(ModelDoubt(), 3)
    known.x[MASS], known.P[MASS, MASS] = mass, deviation**2
    return known


def blind() -> Balanced:
    """A window that tells nothing: its pressures are noise."""
    return window(0.0, 0.0, 0.0, np.random.default_rng(1))._replace(noise=np.full(3, 1e12))


def side_by_side(*hypotheses: LoadHypothesis) -> LoadHypotheses:
    """The first is believed."""
    histories = LoadHypotheses(ModelDoubt(), 3)
    histories._hypotheses = list(hypotheses)
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
    told, noticed = work(LoadHypotheses(ModelDoubt(), 3), carried, moves, seed)
    assert told == pytest.approx(loads, abs=3.0)
    assert noticed == len(loads) - 1
    alone, _ = work(LoadHypothesis(ModelDoubt(), 3), carried, moves, seed)
    assert abs(alone[-1] - loads[-1]) > 5.0


@pytest.mark.parametrize("seed", range(5))
def test_what_one_history_weighs_well_several_do(seed: int) -> None:
    rng = np.random.default_rng(seed)
    loads = [0.0, *rng.uniform(20.0, 150.0, 2), 0.0, float(rng.uniform(20.0, 150.0))]
    moves = [(load, UP + DOWN) for load in loads]
    told, noticed = work(LoadHypotheses(ModelDoubt(), 3), 100.0, moves, seed)
    assert told == pytest.approx(loads, abs=3.0)
    assert noticed == len(loads) - 1


def test_the_mean_over_all_histories_is_told() -> None:
    """By Bayes: of two that predicted as well, neither is told as sure; of one that predicted a
    thousand times worse, little.
    """
    even = side_by_side(history(20.0, 1.0), history(40.0, 1.0)).load
    assert even.mass == pytest.approx(30.0, abs=0.1)
    assert even.deviation == pytest.approx(math.hypot(1.0, 10.0), abs=0.1)
    odd = side_by_side(history(20.0, 1.0), history(40.0, 1.0, -math.log(1000.0))).load
    assert odd.mass == pytest.approx(20.0 + 20.0 / 1001.0, abs=0.01)


def test_a_load_is_as_likely_as_all_moments_at_which_it_may_have_come() -> None:
    hypothesis = history(10.0, 1.0)
    hypothesis._candidates = [
        LoadCandidate(float(k), filter_of(30.0, 4.0), math.log(50.0), NEW_WINDOWS + 1, ahead=1.0)
        for k in range(4)
    ]
    later = LoadCandidate(9.0, filter_of(60.0, 4.0), math.log(50.0), NEW_WINDOWS + 1, ahead=-9.0)
    hypothesis._candidates.append(later)
    fork = hypothesis.fork([hypothesis.same], -4.0)
    assert fork is not None
    assert fork.likelihood == pytest.approx(math.log(4.0) + 1.0 - math.log(50.0), abs=0.01)
    assert fork.same.mass == pytest.approx(30.0, abs=0.1)
    assert hypothesis._candidates == [later]  # none is counted twice


@pytest.mark.parametrize(
    ("mass", "windows", "least"),
    [(30.0, NEW_WINDOWS, -4.0), (30.0, NEW_WINDOWS + 1, -2.0), (16.0, NEW_WINDOWS + 1, -4.0)],
)
def test_what_is_new_or_unlikely_or_the_same_load_makes_no_history(
    mass: float, windows: int, least: float
) -> None:
    hypothesis = history(10.0, 1.0)
    hypothesis._candidates = [
        LoadCandidate(1.0, filter_of(mass, 4.0), math.log(50.0), windows, ahead=1.0)
    ]
    assert hypothesis.fork([hypothesis.same], least) is None
    assert len(hypothesis._candidates) == 1


def test_a_load_that_went_has_to_have_been_one() -> None:
    """A history that had the tip pulling upwards stays unlikely when the next load comes."""
    hypothesis = history(-40.0, 5.0)
    hypothesis.add(1.0, blind())
    (candidate,) = hypothesis._candidates
    candidate.filter, candidate.windows = filter_of(30.0, 4.0), NEW_WINDOWS + 1
    candidate.ahead = 20.0
    fork = hypothesis.fork([hypothesis.same], -1e9)
    assert fork is not None
    # 30 kg less than what may be missing, which is 6 standard deviations
    ahead = fork.evidence - hypothesis.evidence
    assert ahead == pytest.approx(20.0 + math.log(1e-9) - math.log(50.0), abs=0.2)


@pytest.mark.parametrize(("behind", "kept"), [(UNLIKELY - 1.0, 2), (UNLIKELY + 1.0, 1)])
def test_a_history_that_has_become_unlikely_is_given_up(behind: float, kept: int) -> None:
    histories = side_by_side(history(20.0, 1.0), history(40.0, 1.0, -behind))
    assert not histories.add(1.0, blind())
    assert len(histories._hypotheses) == kept


@pytest.mark.parametrize(("ahead", "changed"), [(AHEAD - 1.0, False), (AHEAD + 1.0, True)])
def test_one_that_is_far_likelier_is_believed_and_the_change_is_told(
    ahead: float, changed: bool
) -> None:
    histories = side_by_side(history(20.0, 1.0), history(40.0, 1.0, ahead, since=7.0))
    assert histories.add(8.0, blind()) is changed
    assert histories.believed.since == (7.0 if changed else 0.0)


@pytest.mark.parametrize(("since", "kept"), [(1.0, 1), (5.0, 2)])
def test_the_same_load_in_two_histories_is_counted_once(since: float, kept: int) -> None:
    histories = side_by_side(history(20.0, 1.0), history(20.5, 1.0, since=since))
    histories.add(6.0, blind())
    assert len(histories._hypotheses) == kept


@pytest.mark.parametrize(("direction", "windows"), [(0.0, 50.0), (1.0, 200.0)])
def test_loads_come_more_often_to_a_crane_that_stands(direction: float, windows: float) -> None:
    hypothesis = history(10.0, 1.0)
    hypothesis.add(1.0, window(10.0, direction, 0.0, np.random.default_rng(1)))
    assert hypothesis._candidates[-1].seldom == pytest.approx(math.log(windows))


def test_histories_stay_few_over_work_that_leaves_much_open() -> None:
    """Always in one direction, so that friction and load are told apart badly."""
    rng, histories, most, time = np.random.default_rng(5), LoadHypotheses(ModelDoubt(), 3), 0, 0.0
    carried_force = 300.0 * BY_MASS
    for _ in range(30):
        load = float(rng.choice([0.0, 15.0, 30.0, 60.0]))
        for direction in UP if rng.uniform() < 0.5 else DOWN:
            time += HOP
            balanced = window(load, direction, rng.uniform(-0.5, 0.5), rng)
            balance = balanced.balance._replace(
                force=balanced.balance.force + carried_force, asked=carried_force
            )
            histories.add(time, balanced._replace(balance=balance))
            most = max(most, len(histories._hypotheses))
            best = max(hypothesis.likelihood for hypothesis in histories._hypotheses)
            rest = [hypothesis.likelihood for hypothesis in histories._hypotheses[1:]]
            assert all(likelihood > best - UNLIKELY for likelihood in rest)
    assert 1 < most <= MOST_HYPOTHESES
