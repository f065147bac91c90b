"""Rows become independent, of variance one, and what is sought stays in them."""

import numpy as np
import pytest
from unit.crane_identification.diagnosis.made import ROWS, evidence, normal

from crane_identification.diagnosis.evidence import Evidence, leading
from crane_identification.diagnosis.projection import whitener

PHI, SIZE = 0.7, 3.0  # of the noise: correlation of neighbours, deviation of what is new in each
RUN = np.repeat([0, 1, 2], ROWS // 3)
BASE = normal(1, ROWS, 1)
NONE = np.zeros((ROWS, 2, 1))


def coloured(seed: int) -> np.ndarray:
    """An autoregression of first order in each run."""
    noise = SIZE * normal(seed)
    for k in range(ROWS):
        fresh = k == 0 or RUN[k] != RUN[k - 1]
        noise[k] = noise[k] / np.sqrt(1.0 - PHI**2) if fresh else PHI * noise[k - 1] + noise[k]
    return noise


def given(force: np.ndarray, used: np.ndarray | None = None) -> Evidence:
    return evidence(5.0 * BASE[:, 0] + force, BASE, RUN, used=used)


def in_first_channel(values: np.ndarray) -> np.ndarray:
    return np.stack([values, np.zeros(ROWS)], axis=1)


def test_the_noise_is_found_beside_the_model() -> None:
    (noise, absent) = whitener(given(coloured(2)), NONE).noise
    assert noise is not None and absent is None  # no row is close to a reversal
    np.testing.assert_allclose(noise.polynomial, [1.0, -PHI], atol=0.08)
    assert noise.variance == pytest.approx(SIZE**2 / (1.0 - PHI**2), rel=0.15)


def test_whitened_noise_is_white() -> None:
    noise = coloured(2)
    rows = whitener(given(noise), NONE)(in_first_channel(noise))
    assert len(rows) == ROWS
    assert rows.std() == pytest.approx(1.0, abs=0.05)
    assert abs(rows[1:] @ rows[:-1]) / (rows @ rows) < 0.1


def test_a_row_is_what_its_predecessors_of_the_same_run_do_not_predict() -> None:
    used = np.ones(ROWS, dtype=bool)
    used[50] = False
    white = whitener(given(coloured(2), used), NONE)
    noise = white.noise[0]
    assert noise is not None
    phi, deviation = -noise.polynomial[1], np.sqrt(noise.variance)
    x = normal(3)
    rows = dict(zip(white.row.tolist(), white(in_first_channel(x)), strict=True))
    assert 50 not in rows and set(white.channel) == {0}
    for first in (0, 51, 200, 400):  # of a run, or after a row that is not used
        assert rows[first] == pytest.approx(x[first] / deviation)
    new = deviation * np.sqrt(1.0 - phi**2)
    for later in (1, 52, 201, 599):
        assert rows[later] == pytest.approx((x[later] - phi * x[later - 1]) / new)


def test_what_a_candidate_explains_is_no_noise() -> None:
    """Else whitening would remove the effect that is sought."""
    slow = np.sin(np.linspace(0.0, 20.0, ROWS))
    force = 30.0 * slow + SIZE * normal(4)
    column = in_first_channel(slow)[..., np.newaxis]
    known, unknown = (whitener(given(force), largest).noise[0] for largest in (column, NONE))
    assert known is not None and unknown is not None
    assert known.variance == pytest.approx(SIZE**2, rel=0.15)
    assert unknown.variance > 20.0 * SIZE**2


@pytest.mark.parametrize(("alike", "noise"), [(0.9999, True), (0.99, False)])
def test_a_column_that_is_the_measured_force_explains_no_noise(alike: float, noise: bool) -> None:
    """It would explain all of it; one that is much like it may be a law."""
    force = SIZE * normal(5)
    column = in_first_channel(force + np.sqrt(1.0 / alike**2 - 1.0) * SIZE * normal(6))
    found = whitener(given(force), column[..., np.newaxis]).noise[0]
    assert found is not None
    assert bool(found.variance > 0.5 * SIZE**2) is noise


@pytest.mark.parametrize(("rows", "told"), [(7, False), (8, True)])
def test_a_channel_with_few_rows_says_nothing(rows: int, told: bool) -> None:
    used = np.arange(ROWS) < rows
    white = whitener(given(coloured(2), used), NONE)
    assert (white.noise[0] is not None) is told
    assert sum(len(pick.rows) for pick in white.picks) == (rows if told else 0)


def test_leading_directions_are_orthonormal_and_span_the_columns() -> None:
    a, b = normal(7), normal(8)
    columns = np.stack([a, 1e6 * b, a + 1e-3 * b, np.zeros(ROWS)], axis=1)  # of any units
    found = leading(columns, 4)
    np.testing.assert_allclose(found.T @ found, np.eye(2), atol=1e-9)
    np.testing.assert_allclose(found @ (found.T @ columns), columns, rtol=1e-6, atol=1e-6)


def test_the_commonest_direction_comes_first() -> None:
    a, b = np.linalg.qr(normal(9, ROWS, 2))[0].T
    found = leading(np.stack([a, a + 0.1 * b, a - 0.1 * b, b], axis=1), 1)
    assert found.shape == (ROWS, 1)
    assert abs(found[:, 0] @ a) > 0.99


def test_columns_of_nothing_have_no_direction() -> None:
    assert leading(np.zeros((ROWS, 3)), 3).shape == (ROWS, 0)
