"""The shape that is drawn of an unknown force, where recordings do not reach all of its knots."""

from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest
from unit.crane_identification.diagnosis.made import ROWS, normal, searched

from crane_identification.diagnosis import residuals
from crane_model.terms import NonparametricCurve, Term

KNOTS, UNREACHED = 8, (3, 6)


@pytest.mark.parametrize("seed", range(8))
@pytest.mark.filterwarnings("error")
def test_what_no_recording_reaches_is_drawn_without_a_spread(seed: int) -> None:
    """Rounding must not turn its variance of zero negative."""
    columns = normal(seed, ROWS, KNOTS)
    columns[:, UNREACHED] = 0.0
    made = searched({"offset": normal(50)}, columns[:, 0])
    term = SimpleNamespace(
        only_joint="axis",
        parameters=lambda _: [SimpleNamespace(unit="N")] * KNOTS,
        curves=lambda values: (NonparametricCurve("position", tuple(range(KNOTS)), values, "1"),),
    )
    there = np.stack([columns, np.zeros_like(columns)], axis=1)
    best = residuals.solved(made, made.beside(there))
    (drawn,) = residuals.curves_of(made.evidence, cast(Term, term), best.values, best.std_devs)
    std_devs = np.asarray(drawn.std_devs)
    assert np.isfinite(std_devs).all()
    assert std_devs[list(UNREACHED)] == pytest.approx(0.0, abs=1e-9)
    assert (np.delete(std_devs, UNREACHED) > 0.0).all()
