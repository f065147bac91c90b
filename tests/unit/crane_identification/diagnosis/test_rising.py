"""Forces over the position that no hose makes, on columns made up for the purpose."""

from collections.abc import Callable

import numpy as np
import pytest
from unit.crane_identification.diagnosis import made
from unit.crane_identification.diagnosis.test_drawing import OTHER, THRESHOLDS, Q, searched

from crane_identification.diagnosis.decision.decision import decide
from crane_identification.diagnosis.decision.signatures import falls
from crane_identification.diagnosis.search.selection import ForwardSelection

Law = Callable[[np.ndarray], np.ndarray]


@pytest.mark.parametrize(
    ("law", "falling"),
    [
        (lambda q: 9.0 * np.tanh(q), False),
        (lambda q: 3.0 * np.sinh(q / 1.5), False),
        (lambda q: 9.0 * np.maximum(q + 1.0, 0.0), False),  # slack, but taut
        (lambda q: 3.0 * q * (q**2 / 4.0 - 1.0), True),  # over its centre
        (lambda q: 9.0 * (np.tanh(2.0 * q) - q / 2.0), True),
    ],
)
@pytest.mark.parametrize("beside", [0.0, 5.0])
def test_a_shape_that_falls_is_no_hose(law: Law, falling: bool, beside: float) -> None:
    """Beside another effect as well."""
    found = searched(law(Q) + beside * OTHER, OTHER)
    shape = found.shapes.of(found.projection.candidates[0].candidate)
    assert shape is not None
    rest = [found.projection.candidates[1].columns] if beside else []
    assert falls(found, shape, rest, THRESHOLDS) is falling


def test_what_falls_by_chance_is_a_hose() -> None:
    """A shape of noise alone falls somewhere."""
    found = searched(made.normal(7), OTHER)
    shape = found.shapes.of(found.projection.candidates[0].candidate)
    assert shape is not None
    assert not falls(found, shape, [], THRESHOLDS)


@pytest.mark.parametrize(("steepness", "named"), [(0.0, True), (16.0, False)])
def test_a_spring_that_snaps_is_of_no_effect(steepness: float, named: bool) -> None:
    """It holds back about its centre, and pushes beyond."""
    force = 9.0 * np.tanh(Q) + steepness * np.sin(1.5 * Q)
    found = decide(ForwardSelection(searched(force, OTHER)), THRESHOLDS)
    assert bool(found.passed) is named
    assert any(one.falls for one in found.beyond) is not named
