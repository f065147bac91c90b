"""Windows around rows: which instants they hold, and that both sides are averaged alike."""

import numpy as np
import pytest

from crane_identification.online.estimator import Row, Window
from crane_identification.online.streams import Smoothed

STEP, HALF, EVERY = 10_000_000, 8, 4
START = 1_700_000_000_000_000_000
NOTHING = np.zeros(1)


def sides(instants: list[Smoothed]) -> np.ndarray:
    """A column that is quadratic in the velocity, and twice that as force."""
    columns = np.array([instant.velocity**2 for instant in instants])[:, :, np.newaxis]
    return np.concatenate([columns, 2.0 * columns], axis=2)


def rows(velocity: np.ndarray, run: np.ndarray | None = None) -> list[Row]:
    window = Window(sides, HALF, EVERY, STEP)
    out = []
    for k, v in enumerate(velocity):
        number = 0 if run is None else int(run[k])
        at = Smoothed(START + k * STEP, number, NOTHING, np.array([v]), NOTHING, NOTHING, 1.0)
        if (row := window.add(at)) is not None:
            out.append(row)
    return out


def test_rows_are_on_the_grid_of_the_clock_and_their_windows_are_whole() -> None:
    found = rows(np.ones(100))
    assert [(row.stamp - START) // STEP for row in found] == list(range(8, 92, EVERY))
    assert all(row.stamp % (EVERY * STEP) == 0 for row in found)
    assert all(row.stamp - row.begin == HALF * STEP for row in found)


def test_what_is_constant_stays_and_both_sides_are_averaged_alike() -> None:
    for row in rows(np.full(50, 3.0)):
        assert row.columns[0, 0] == pytest.approx(9.0)
    for row in rows(np.random.default_rng(0).standard_normal(200)):
        assert row.force[0] == pytest.approx(2.0 * row.columns[0, 0], rel=1e-12)


def test_columns_are_averaged_and_not_the_motion() -> None:
    """A swing within the window has no mean velocity, but a mean square."""
    swing = np.sqrt(2.0) * np.sin(2 * np.pi * np.arange(200) / 5)
    for row in rows(swing):
        assert row.columns[0, 0] == pytest.approx(1.0, abs=0.02)


def test_a_new_run_knows_nothing_of_the_old_one() -> None:
    velocity = np.repeat([1.0, 5.0], 50)
    found = rows(velocity, np.repeat([0, 1], 50))
    assert {row.run for row in found} == {0, 1}
    for row in found:
        assert row.columns[0, 0] == pytest.approx(1.0 if row.run == 0 else 25.0)
    assert min(row.begin for row in found if row.run == 1) >= START + 50 * STEP
