"""Gains of held-out folds, on columns made up for the purpose with known answers."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from unit.crane_identification.diagnosis import made

from crane_identification.diagnosis.constants import TIME_BLOCKS
from crane_identification.diagnosis.evidence import leading
from crane_identification.diagnosis.judgement import (
    folds,
    gain,
    held_out_gains,
    helps,
)
from crane_identification.thresholds import load_thresholds

FOLDS, ROWS = 6, 200
FOLD = np.repeat(np.arange(FOLDS), ROWS)


def normal(seed: int, columns: int) -> np.ndarray:
    return np.random.default_rng(seed).standard_normal((FOLDS * ROWS, columns))


def beside(before: np.ndarray, added: np.ndarray, force: np.ndarray, out: np.ndarray) -> float:
    return gain(leading(before, before.shape[1]), added, force, out)


def gains(before: np.ndarray, added: np.ndarray, force: np.ndarray) -> np.ndarray:
    return np.array([beside(before, added, force, number == FOLD) for number in range(FOLDS)])


def test_gains_are_those_of_least_squares_on_the_other_folds() -> None:
    before, added, noise = normal(1, 3), normal(2, 2), normal(3, 1)[:, 0]
    force = before @ [1.0, -2.0, 0.5] + added @ [0.5, 0.2] + noise
    out = FOLD == 2
    costs = []
    for columns in (before, np.hstack([before, added])):
        values = np.linalg.lstsq(columns[~out], force[~out])[0]
        costs.append(((force[out] - columns[out] @ values) ** 2).sum())
    assert beside(before, added, force, out) == pytest.approx(costs[0] - costs[1])


@pytest.mark.parametrize("leak", [0.0, 1e-9, 1e-6, 1e-3])
def test_a_nuisance_of_one_recording_decides_nothing(leak: float) -> None:
    """Its coefficient is not known to the others, whatever trace of it filters leave in them."""
    before, added, noise = normal(4, 4), normal(5, 1), normal(6, 1)[:, 0]
    nuisance = np.where(FOLD == 3, 1.0, leak)[:, np.newaxis] * normal(7, 1)
    force = before[:, 0] + 0.5 * added[:, 0] + 50.0 * nuisance[:, 0] * (FOLD == 3) + noise
    found = gains(np.hstack([before, nuisance]), added, force)
    np.testing.assert_allclose(found, 0.25 * ROWS, rtol=0.6)


def test_a_fold_that_alone_holds_the_effect_is_not_asked() -> None:
    before, noise = normal(8, 3), normal(9, 1)[:, 0]
    added = np.where(FOLD == 1, 1.0, 1e-7)[:, np.newaxis] * normal(10, 1)
    found = gains(before, added, added[:, 0] + noise)
    assert np.isnan(found[1])
    assert (np.abs(found[[0, 2, 3, 4, 5]]) < 1.0).all()


def test_what_each_recording_has_of_its_own_helps_to_predict_the_others() -> None:
    """Loads that all differ: with its own taken out, a recording is predicted by a better model.

    All but the one from which they count, whose own the others together take for the model's.
    """
    before, noise = normal(16, 3), normal(17, 1)[:, 0]
    loads = [0.0, 3.0, 1.0, 7.0, 5.0, 2.0]
    column = (before * normal(18, 3)[FOLD]).sum(axis=1)  # no two recordings move alike
    each = np.where(FOLD[:, np.newaxis] == np.arange(1, FOLDS), column[:, np.newaxis], 0.0)
    shared = np.hstack([before, column[:, np.newaxis]])
    found = gains(shared, each, shared @ [1.0, 2.0, 0.5, 4.0] + each @ loads[1:] + noise)
    assert np.isnan(found[0])
    assert (found[1:] > 10.0).all()


def test_columns_within_those_before_are_not_asked_for() -> None:
    before, noise = normal(11, 3), normal(12, 1)[:, 0]
    assert np.isnan(gains(before, before[:, :1] + before[:, 1:2], noise)).all()


def test_what_is_not_there_helps_in_some_folds_at_most() -> None:
    before, added, noise = normal(13, 3), normal(14, 1), normal(15, 1)[:, 0]
    assert not helps(gains(before, added, noise), load_thresholds())


@pytest.mark.parametrize(
    ("found", "expected"),
    [
        ([10.0, 12.0, 9.0, 11.0, 8.0, -1.5e10], True),  # one that differs in something else
        ([10.0, 12.0, 9.0, 11.0, -1.0, -1.0], False),
        ([1e10, -1.0, -1.0, -1.0, -1.0, -1.0], False),  # nor does one that gains a lot
        ([10.0, 12.0, 9.0, -1.0], True),  # of four as well
        ([10.0, 12.0, -1.0], False),  # too few for one to differ
        ([10.0, 12.0, 9.0, np.nan, np.nan, np.nan], False),  # most are not asked
        ([10.0, 12.0, 9.0, 7.0, np.nan, np.nan], True),
    ],
)
def test_folds_are_counted(found: list[float], expected: bool) -> None:
    assert helps(np.array(found), load_thresholds()) is expected


@pytest.mark.parametrize(("bags", "expected"), [(3, TIME_BLOCKS), (4, 4)])
def test_folds_are_recordings_or_where_there_are_few_blocks_of_time(
    bags: int, expected: int
) -> None:
    bag = np.sort(np.arange(made.ROWS) % bags)
    names = [f"bag {number}" for number in range(bags)]
    runs = [SimpleNamespace(source=name) for name in names]
    given = replace(made.evidence(normal(1, 1)[: made.ROWS, 0], normal(1, 1)[: made.ROWS]), bag=bag)
    fold, said = folds(replace(given, runs=tuple(runs)))  # type: ignore[arg-type]
    assert len(said) == expected
    sizes = np.bincount(fold)
    assert (np.diff(fold) >= 0).all() and sizes.min() == sizes.max() == made.ROWS // expected
    assert (said == tuple(names)) is (expected == bags)


@pytest.mark.parametrize(("share", "asked"), [(0.1, False), (0.4, True)])
def test_a_fold_is_asked_where_the_others_hold_a_fifth_of_the_column(
    share: float, asked: bool
) -> None:
    """Else it would be predicted with their noise rather than with the effect."""
    out = FOLD == 3
    column = normal(20, 1)[:, 0]
    inside = share / np.sqrt(1.0 - share**2) * np.linalg.norm(column[out])
    column = np.where(out, column, column * inside / np.linalg.norm(column[~out]))
    found = beside(normal(21, 2), column[:, np.newaxis], column + normal(22, 1)[:, 0], out)
    assert bool(np.isfinite(found)) is asked


def test_gains_of_folds_are_of_whitened_rows() -> None:
    """An effect of 2 gains 4 in each of so many rows of variance one, whatever its unit is."""
    column = np.random.default_rng(23).standard_normal(made.ROWS)
    found = made.searched({"offset": 1e-3 * column}, 2.0 * column)
    shaped = found.projection.candidates[0]
    gains, said = held_out_gains(found, (), shaped.columns)
    assert len(gains) == len(said) == TIME_BLOCKS
    np.testing.assert_allclose(gains, 4.0 * made.ROWS / TIME_BLOCKS, rtol=0.5)
