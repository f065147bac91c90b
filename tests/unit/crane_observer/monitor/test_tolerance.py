"""How far sums of residuals may go."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from crane_observer import learn
from crane_observer.monitor.blocks import BLOCK
from crane_observer.monitor.tolerance import RESERVE, TERMS, Sums, between, taken

COUNT = 50
LATE, CREEP, EDGE = 0.01, 0.03, 0.5  # s, m/s, of the play


@given(
    arrays(float, (COUNT, 2), elements=st.floats(0.0, 1.0)),
    st.lists(st.tuples(st.integers(0, COUNT - 1), st.integers(0, COUNT - 1)), min_size=1),
)
def test_a_late_command_counts_by_all_changes_of_speed(
    changes: np.ndarray, spans: list[tuple[int, int]]
) -> None:
    turned = np.cumsum(changes, axis=0)
    zeros = np.zeros_like(turned)
    sums = Sums(
        BLOCK * np.arange(COUNT),
        *[zeros] * 3,
        turned,
        2.0 * turned,
        np.zeros((*zeros.shape, TERMS)),
    )
    begin, end = np.array(spans).T
    _, may = between(np.array([1.0, 0.0, 0.0, CREEP, LATE, EDGE]), sums, begin, end)
    for (first, last), found in zip(spans, may, strict=True):
        inside = changes[min(first, last) + 1 : max(first, last) + 1].sum(axis=0)
        np.testing.assert_allclose(
            found, 1.0 + CREEP * BLOCK * abs(last - first) + (LATE + 2.0 * EDGE) * inside
        )


def made(residual: np.ndarray, way: np.ndarray, turned: np.ndarray) -> Sums:
    """Of the two chambers of a joint and of a supply that has no residual."""
    zeros = np.zeros_like(way)
    time = BLOCK * np.arange(len(way))
    return Sums(time, residual, way, zeros, turned, zeros, np.zeros((*way.shape, TERMS)))


def test_tolerances_hold_what_was_seen_and_little_more() -> None:
    """Of residuals that follow the way alone, a share is learnt, and no more than their largest."""
    rng = np.random.default_rng(2)
    way = np.cumsum(np.abs(rng.standard_normal((3000, 3))) * 1e-3, axis=0)
    sums = made(5e-3 * way, way, np.zeros_like(way))
    learnt = learn(("boom",), [sums], "made").rows
    begin = np.arange(2000)
    moved, may = between(learnt, sums, begin, begin + 500)
    assert (RESERVE * moved[:, :2] <= may[:, :2] * 1.0001).all()
    assert (may[:, :2] < 1.2 * RESERVE * moved[:, :2]).all()


def test_a_joint_that_hunts_longer_than_it_ever_did_is_no_alarm() -> None:
    """Each reversal adds to the sums; the longest hunting of the recordings lasted 3 s."""

    def hunting(seconds: float) -> Sums:
        time = BLOCK * np.arange(2400)
        speed = np.where((time > 20.0) & (time < 20.0 + seconds), 0.04, 0.0)
        speed = speed * np.sin(2.0 * np.pi * 2.5 * time)
        turned = np.cumsum(np.abs(np.diff(speed, prepend=0.0)))
        way = BLOCK * np.cumsum(np.abs(speed))
        columns = np.stack([turned, turned, np.zeros_like(turned)], axis=1)
        return made(4e-3 * columns, np.stack([way, way, 0.0 * way], axis=1), columns)

    tolerance = learn(("boom",), [hunting(3.0)], "made")
    assert taken(tolerance.rows, hunting(30.0)).max() < tolerance.level
    drifting = hunting(30.0)
    drifting.residual[:, :2] += 1e-3 * drifting.time[:, None]
    assert taken(tolerance.rows, drifting).max() > tolerance.level


def test_what_is_rare_makes_alarms_rarer() -> None:
    """One part that errs twice as much as all others: the next may err more still."""
    rng = np.random.default_rng(6)

    def work(error: float) -> Sums:
        steps = np.abs(rng.standard_normal((4000, 3))) * 1e-3
        way = np.cumsum(steps, axis=0)
        wrong = error * np.repeat(rng.uniform(-1.0, 1.0, 40), 100)[:, None] * steps
        return made(np.cumsum(wrong, axis=0), way, np.zeros_like(way))

    alike = learn(("boom",), [work(0.05) for _ in range(3)], "made")
    one_worse = learn(("boom",), [work(0.05), work(0.05), work(0.1)], "made")
    assert one_worse.level > 1.2 * alike.level
