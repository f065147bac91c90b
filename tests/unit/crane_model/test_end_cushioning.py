"""Cushions of either end: what they ask for, which ends a term knows, and files of the old law."""

import numpy as np
import pytest
from unit.crane_model.test_term_registry import SETTING

from crane_model import Record
from crane_model.terms.single_axis import EndCushioning

LOW, HIGH, ZONE = 0.0, 1.55, 0.2  # m, of the telescope


def at(q: float, v: float) -> Record:
    position, velocity = np.zeros((2, 1, 3))
    position[0, 2], velocity[0, 2] = q, v
    return Record(tuple(SETTING.units), np.zeros(1), position, velocity, np.zeros((1, 3)))


@pytest.mark.parametrize(
    ("q", "v", "expected"),
    [
        (LOW + 0.05, -0.3, 0.75 * (-0.3 * 100.0 - 0.09 * 1000.0)),  # three quarters deep
        (HIGH - 0.1, -0.3, 0.5 * (-0.3 * 20.0 - 0.09 * 7000.0)),  # out of the other one
        (HIGH - 0.1, 0.3, 0.5 * (0.3 * 20.0 + 0.09 * 7000.0)),
        (0.8, 0.3, 0.0),
    ],
)
def test_each_end_resists_with_the_speed_and_with_its_square(
    q: float, v: float, expected: float
) -> None:
    term = EndCushioning(joint="telescope", zone=ZONE)
    names = [p.name for p in term.parameters(SETTING)]
    assert names == [f"{one}.telescope" for one in ("f_lower", "h_lower", "f_upper", "h_upper")]
    force = term.columns(at(q, v), SETTING)[0, 2] @ [100.0, 1000.0, 20.0, 7000.0]
    assert force == pytest.approx(expected)


def test_an_end_that_nobody_visited_has_no_parameter() -> None:
    term = EndCushioning(joint="telescope", zone=ZONE)
    upper = term.showing(np.array([False, False, True, True]))
    assert upper.ends == ("upper",)
    assert [p.name for p in upper.parameters(SETTING)] == ["f_upper.telescope", "h_upper.telescope"]
    for q in (LOW + 0.05, HIGH - 0.05):
        np.testing.assert_array_equal(
            upper.columns(at(q, 0.1), SETTING), term.columns(at(q, 0.1), SETTING)[..., 2:]
        )
    assert term.showing(np.zeros(4, dtype=bool)) == term
