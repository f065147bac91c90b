"""Information matrices hold what the rows hold, add up, and find dependent columns."""

import numpy as np
import pytest
from unit.crane_identification.online.online_crane import crane, motion

from crane_identification.estimation.least_squares import least_squares
from crane_identification.estimation.regression import Rows, balancing, solve_weighted
from crane_identification.scale.summed import Information
from crane_model import DataError, Model, Record

SCALES = np.array([40.0, 15.0, 25.0])  # of the noise


def measured(samples: int, start: float = 0.0, seed: int = 0) -> Record:
    """The crane in motion, with the force that its model predicts and noise."""
    model = crane()
    time = start + 0.01 * np.arange(samples)
    record = Record(model.joints, time, *motion(time))
    noise = np.random.default_rng(seed).normal(size=(samples, 3)) * SCALES
    force = model.regressor(record) @ np.linspace(900.0, 20.0, len(model.parameters)) + noise
    return Record(model.joints, time, *motion(time), force=force)


def rows_of(model: Model, record: Record, used: np.ndarray | None = None) -> Rows:
    assert record.force is not None
    return Rows(
        joints=model.joints,
        names=tuple(p.name for p in model.parameters),
        units=tuple(p.unit for p in model.parameters),
        time=record.time,
        run=np.zeros(len(record), dtype=int),
        matrix=model.regressor(record),
        force=record.force,
        used=np.ones((len(record), 3), dtype=bool) if used is None else used,
    )


def test_estimate_is_that_of_the_rows() -> None:
    used = np.random.default_rng(1).random((3000, 3)) < 0.7
    rows = rows_of(crane(), measured(3000), used)
    information = Information.of(rows)
    assert information.rows.tolist() == used.sum(axis=0).tolist()
    weights = information.balancing()
    np.testing.assert_allclose(weights, balancing(rows), rtol=1e-9)
    found, expected = information.solve(weights), solve_weighted(rows, weights)
    np.testing.assert_allclose(found.values, expected.values, rtol=1e-9)
    np.testing.assert_allclose(found.bread, expected.bread, rtol=1e-7)
    np.testing.assert_allclose(found.values, least_squares(rows).values, rtol=1e-9)
    residual = rows.rms(rows.residual(found.values))
    np.testing.assert_allclose(information.rms(found.values), residual, rtol=1e-9)


def test_it_adds_up() -> None:
    first, second = measured(500), measured(800, start=30.0, seed=2)
    parts = [rows_of(crane(), record) for record in (first, second)]
    apart = Information.of(parts[0]) + Information.of(parts[1])
    together = Information.of(Rows.stack(parts))
    np.testing.assert_allclose(apart.matrix, together.matrix, rtol=1e-12)
    assert apart.rows.tolist() == [1300] * 3


def test_dependent_columns_are_found() -> None:
    rows = rows_of(crane(), measured(900))
    rows.matrix[:, :, 4] = 2.0 * rows.matrix[:, :, 1] - rows.matrix[:, :, 2]
    found = Information.of(rows).solve(np.ones(3))
    expected = solve_weighted(rows, np.ones(3))
    assert found.determined.tolist() == expected.determined.tolist()
    assert not found.determined.all()
    assert np.isinf(found.condition)


def test_what_does_not_belong_together_is_refused() -> None:
    of_crane = Information.of(rows_of(crane(), measured(100)))
    renamed = Information(
        of_crane.joints, of_crane.names[::-1], of_crane.units, of_crane.matrix, of_crane.rows
    )
    with pytest.raises(DataError, match="different models"):
        of_crane + renamed
