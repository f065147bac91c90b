"""The smoother against conditional Gaussians, by its responses to each noise, and at work."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import pytest
from unit.crane_observer.observed import at_work, known, recording

from crane_model.array import Array
from crane_observer import PositionEstimator
from crane_observer.position.replay import CHAPTER, EstimatedCourse, KnownLater, replay_smoothed
from crane_observer.position.state import Gaussian, KeptGaussian

SIZE, MOVED, SEEN, TIMES = 5, 2, 2, 12
ALL = np.ones(3, dtype=bool)


@dataclass
class LinearCase:
    """x' = S D x + noise, z = H x + noise, of TIMES steps."""

    root: Array  # of the covariance at the start
    decay: Array
    added: Array
    slopes: Array
    noise: Array
    H: Array
    variance: Array

    @classmethod
    def drawn(cls, seed: int = 5) -> "LinearCase":
        rng = np.random.default_rng(seed)
        slopes = np.zeros((TIMES, MOVED, SIZE))
        slopes[:, :, MOVED:] = rng.normal(size=(TIMES, MOVED, SIZE - MOVED))
        slopes[:, range(MOVED), range(MOVED)] = rng.uniform(0.8, 1.2, (TIMES, MOVED))
        decay = rng.uniform(0.9, 1.0, (TIMES, SIZE))
        decay[TIMES // 2, 3] = 0.0  # drawn anew
        return cls(
            rng.normal(size=(SIZE, SIZE)),
            decay,
            rng.uniform(0.0, 0.1, (TIMES, SIZE)),
            slopes,
            rng.uniform(0.0, 0.1, (TIMES, MOVED)),
            rng.normal(size=(TIMES, SEEN, SIZE)),
            rng.uniform(0.1, 1.0, (TIMES, SEEN)),
        )

    def transition(self, k: int) -> Array:
        moved = np.eye(SIZE)
        moved[:MOVED] = self.slopes[k]
        return np.asarray(moved @ np.diag(self.decay[k]))

    def process(self, k: int) -> Array:
        moved = np.eye(SIZE)
        moved[:MOVED] = self.slopes[k]
        whole = moved @ np.diag(self.added[k]) @ moved.T
        whole[range(MOVED), range(MOVED)] += self.noise[k]
        return np.asarray(whole)

    def step(self, state: KeptGaussian, k: int, z: Array) -> None:
        """The filter's, with the measurement z (SEEN,)."""
        state.relax(self.decay[k], self.added[k])
        way = self.slopes[k] @ state.x - state.x[:MOVED]
        state.move(way, self.slopes[k], self.noise[k])
        state.correct(self.H[k], z - self.H[k] @ state.x, self.variance[k])

    def smoothed(self, mean: Array, z: Array, estimated: int) -> list[Gaussian]:
        """After the start and each step, by the smoother."""
        state = KeptGaussian(Gaussian(mean.copy(), self.root @ self.root.T, estimated))
        marks = [(0, state.now())]
        for k in range(TIMES):
            self.step(state, k, z[k])
            marks.append((len(state.steps), state.now()))
        later, found = KnownLater(SIZE), []
        for count, then in reversed(marks):
            while len(state.steps) > count:
                later.back(state.steps.pop())
            found.append(later.of(then))
        return found[::-1]


def test_a_linear_case_is_conditioned_on_all_measurements() -> None:
    case, rng = LinearCase.drawn(), np.random.default_rng(6)
    mean, z = rng.normal(size=SIZE), rng.normal(size=(TIMES, SEEN))
    # all states stacked: prior mean and covariance, then conditioned at once
    maps, spread = [np.eye(SIZE)], np.zeros(((TIMES + 1) * SIZE,) * 2)
    blocks = [case.root @ case.root.T]
    for k in range(TIMES):
        maps.append(case.transition(k) @ maps[-1])
        F = case.transition(k)
        blocks.append(F @ blocks[-1] @ F.T + case.process(k))
    for i in range(TIMES + 1):
        across = np.eye(SIZE)
        for k in range(i, TIMES + 1):
            rows, columns = (slice(n * SIZE, (n + 1) * SIZE) for n in (k, i))
            spread[rows, columns] = across @ blocks[i]
            spread[columns, rows] = spread[rows, columns].T
            across = case.transition(k) @ across if k < TIMES else across
    H = np.zeros((TIMES * SEEN, len(spread)))
    for k in range(TIMES):
        H[k * SEEN : (k + 1) * SEEN, (k + 1) * SIZE : (k + 2) * SIZE] = case.H[k]
    prior = np.concatenate([matrix @ mean for matrix in maps])
    gain = np.linalg.solve(H @ spread @ H.T + np.diag(case.variance.ravel()), H @ spread).T
    wanted, left = prior + gain @ (z.ravel() - H @ prior), spread - gain @ H @ spread
    for k, state in enumerate(case.smoothed(mean, z, SIZE)):
        rows = slice(k * SIZE, (k + 1) * SIZE)
        np.testing.assert_allclose(state.x, wanted[rows], rtol=1e-6, atol=1e-8)
        np.testing.assert_allclose(state.P, left[rows, rows], rtol=1e-6, atol=1e-8)


@pytest.mark.parametrize("estimated", [SIZE, SIZE - 2])
def test_covariances_are_the_sum_of_all_responses(estimated: int) -> None:
    """The error is linear in the start and in all noise: one after the other, with states that are
    considered and not estimated too.
    """
    case = LinearCase.drawn()
    total = np.zeros((TIMES + 1, SIZE, SIZE))
    for true, z in responses(case):
        found = case.smoothed(np.zeros(SIZE), z, estimated)
        error = np.array([state.x for state in found]) - true
        total += error[:, :, np.newaxis] * error[:, np.newaxis]
    for wanted, state in zip(total, found, strict=True):
        np.testing.assert_allclose(state.P, wanted, rtol=1e-6, atol=1e-8)
        np.testing.assert_array_equal(state.x[estimated:], 0.0)


@pytest.mark.parametrize("considered", [1, 2])
def test_hindsight_makes_no_state_less_sure(considered: int) -> None:
    """Though nothing is learnt of states that are considered."""
    for seed in range(20):
        case, estimated = LinearCase.drawn(seed), SIZE - considered
        state = KeptGaussian(Gaussian(np.zeros(SIZE), case.root @ case.root.T, estimated))
        z, known_then = np.zeros((TIMES, SEEN)), [state.now()]
        for k in range(TIMES):
            case.step(state, k, z[k])
            known_then.append(state.now())
        for then, later in zip(
            known_then, case.smoothed(np.zeros(SIZE), z, estimated), strict=True
        ):
            variances = np.diag(later.P)[:estimated] / np.diag(then.P)[:estimated]
            assert (variances < 1.0 + 1e-6).all()


def responses(case: LinearCase) -> Iterator[tuple[Array, Array]]:
    """True states (TIMES + 1, SIZE) and measurements for each noise of one standard deviation."""
    for column in case.root.T:
        yield course(case, column, np.zeros((TIMES, SIZE)), np.zeros((TIMES, SEEN)))
    for k in range(TIMES):
        for column in np.linalg.cholesky(case.process(k) + 1e-14 * np.eye(SIZE)).T:
            driven = np.zeros((TIMES, SIZE))
            driven[k] = column
            yield course(case, np.zeros(SIZE), driven, np.zeros((TIMES, SEEN)))
        for r in range(SEEN):
            seen = np.zeros((TIMES, SEEN))
            seen[k, r] = np.sqrt(case.variance[k, r])
            yield course(case, np.zeros(SIZE), np.zeros((TIMES, SIZE)), seen)


def course(case: LinearCase, start: Array, driven: Array, seen: Array) -> tuple[Array, Array]:
    states = [start]
    for k in range(TIMES):
        states.append(case.transition(k) @ states[-1] + driven[k])
    z = np.array([case.H[k] @ states[k + 1] for k in range(TIMES)]) + seen
    return np.array(states), z


def smoothed(start: Array, deviation: float, hidden: Array) -> tuple[EstimatedCourse, ...]:
    return replay_smoothed(PositionEstimator(known(), start, deviation), recording(), hidden)


def true(course: EstimatedCourse) -> Array:
    made, _ = at_work()
    time = made.time - made.time[0]
    joints = [np.interp(course.time, time, made.truth.position[:, 1 + j]) for j in range(3)]
    return np.stack(joints, axis=1)


def test_the_end_is_that_of_the_filter_and_the_rest_is_surer() -> None:
    online, later = smoothed(recording().encoders[0], 1e-3, ALL)
    assert len(online.time) > CHAPTER  # more than what is gone through at once
    np.testing.assert_allclose(later.position[-1], online.position[-1])
    np.testing.assert_allclose(later.covariance[-1], online.covariance[-1])
    assert (later.deviation[:, :3] <= 1.001 * online.deviation[:, :3]).all()
    away = np.abs(later.position - true(later))
    assert (away < 2.5 * later.deviation).mean() > 0.95
    speeds = np.gradient(true(later), later.time, axis=0)
    assert np.sqrt(np.mean((later.velocity - speeds) ** 2)) < 0.01


def test_a_start_that_was_wrong_is_known_in_hindsight() -> None:
    online, later = smoothed(recording().encoders[0] + 0.2, 0.2, ALL)
    error = [np.sqrt(np.mean((run.position - true(run)) ** 2)) for run in (online, later)]
    assert error[1] < 0.6 * error[0]
    assert (np.abs(later.position - true(later)) < 2.5 * later.deviation).mean() > 0.95


def test_a_start_that_nobody_knew_is_known_from_the_first_moment() -> None:
    start = recording().encoders[0].copy()
    start[0] = np.nan
    online, later = smoothed(start, 1e-3, np.array([True, False, False]))
    assert online.deviation[0, 0] > 0.1
    assert later.deviation[0, 0] < 0.01
    assert abs(later.position[0, 0] - true(later)[0, 0]) < 2.5 * later.deviation[0, 0]
    assert abs(later.position[0, 0] - true(later)[0, 0]) < 0.01


def test_a_load_is_known_before_it_was_weighed() -> None:
    online, later = smoothed(recording().encoders[0], 1e-3, ~ALL)
    first = int(np.argmax(online.changed)) + 1
    made, load = at_work()
    carried = np.interp(later.time, made.time - made.time[0], load)
    soon = slice(first, first + 10)
    assert np.abs(online.load - carried)[soon].max() > 10.0
    assert np.abs(later.load - carried)[soon].max() < 1.0
    moving = slice(first + 20, first + 45)  # at rest friction hides as much as before
    assert (later.load_deviation < 0.8 * online.load_deviation)[moving].all()
