"""Where a residual sits, on residuals that sit somewhere."""

import numpy as np
import pytest
from unit.crane_identification.diagnosis.made import MODEL, normal

from crane_identification.diagnosis.evidence import Features
from crane_identification.diagnosis.residuals import region

ROWS = 2000
SPEED, TIME = np.random.default_rng(1).uniform(-1.0, 1.0, ROWS), np.arange(ROWS) / 10.0
KNOWN = Features(("velocity of axis", "time"), np.stack([SPEED, TIME], axis=1))
ALL = np.ones(ROWS, dtype=bool)
SETTING = MODEL.setting


def test_a_law_is_said_by_what_it_follows_and_where_it_is_large() -> None:
    """Between two tenths of the rows."""
    found = region(KNOWN, np.where(SPEED > 0.6, 5.0, 0.0) + 0.1 * normal(2, ROWS), ALL, SETTING)
    assert found is not None and found.variable == "velocity of axis"
    assert found.range[0] == pytest.approx(0.6, abs=0.03)
    assert found.range[1] == SPEED.max()
    assert found.share > 0.95


def test_the_range_is_the_narrowest_with_half_of_the_energy() -> None:
    """Of four bins alike, two; of one that has more than the others, itself."""
    four = region(KNOWN, np.where(SPEED > 0.2, 5.0, 0.0), ALL, SETTING)
    one = region(
        KNOWN, np.where(SPEED > 0.2, 5.0, 0.0) + np.where(SPEED > 0.8, 6.0, 0.0), ALL, SETTING
    )
    assert four is not None and one is not None
    assert four.range[1] - four.range[0] == pytest.approx(0.4, abs=0.05)
    assert one.range[0] == pytest.approx(0.8, abs=0.03)
    assert one.share == pytest.approx(121.0 / (121.0 + 75.0), abs=0.05)


def test_a_residual_of_changing_sign_follows_what_its_sign_follows() -> None:
    """The mean within bins counts, and not the energy, which is the same in all of them."""
    found = region(KNOWN, np.sign(TIME - 100.0), ALL, SETTING)
    assert found is not None and found.variable == "time"


def test_rows_that_are_not_used_say_nothing() -> None:
    used = SPEED < 0.0
    found = region(
        KNOWN, np.where(SPEED > 0.0, 100.0, np.where(SPEED < -0.8, 1.0, 0.0)), used, SETTING
    )
    assert found is not None
    assert found.range[1] < -0.75


@pytest.mark.parametrize(("rows", "told"), [(49, False), (50, True)])
def test_few_rows_tell_nothing(rows: int, told: bool) -> None:
    assert (region(KNOWN, SPEED, np.arange(ROWS) < rows, SETTING) is not None) is told


def test_a_quantity_that_does_not_change_tells_nothing() -> None:
    still = Features(("temperature", "time"), np.stack([np.full(ROWS, 40.0), TIME], axis=1))
    found = region(still, normal(3, ROWS), ALL, SETTING)
    assert found is not None and found.variable == "time"
