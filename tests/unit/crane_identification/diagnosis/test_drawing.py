"""A weak effect beside a stronger one whose law fits, or whose shape is drawn."""

from dataclasses import replace

import numpy as np
import pytest
from unit.crane_identification.diagnosis import made

from crane_identification.diagnosis.decision import decide
from crane_identification.diagnosis.judgement import all_judged, marginal
from crane_identification.diagnosis.lookalikes import stands_apart
from crane_identification.diagnosis.projection import solve
from crane_identification.diagnosis.search import Drawn, Search, Shapes
from crane_identification.diagnosis.selection import ForwardSelection
from crane_identification.diagnosis.signatures import judged_beside
from crane_identification.thresholds import load_thresholds
from crane_model.terms.nonparametric import NonparametricPositionForce, hats

THRESHOLDS = load_thresholds()
KNOTS = tuple(np.linspace(-3.0, 3.0, 9).tolist())
Q, OTHER = made.normal(1), made.normal(2)
LIKE_SHAPE = np.tanh(2.0 * Q)  # a force that the shape of a spring has


def searched(missing: np.ndarray, second: np.ndarray) -> Search:
    """A spring `k q`, of which the shape can be drawn, and a `second` effect."""
    found = made.searched({"hose_stiffness": Q, "actuator_inertia": second}, missing)
    laws = [one.candidate for one in found.projection.candidates]
    spring = laws[0]
    shape = replace(
        made.shaped("hose_stiffness", hats(Q, KNOTS)[:, 1:]),
        candidate=Drawn(spring.term, "axis", (("knots", KNOTS),), by=NonparametricPositionForce),
    )
    drawn = {law: shape if law is spring else None for law in laws}
    return replace(found, shapes=Shapes(drawn={**drawn, shape.candidate: shape}))


@pytest.mark.parametrize("size", [0.0, 1.0])
def test_a_weak_effect_is_found_beside_a_shape_that_was_drawn(size: float) -> None:
    """It gains 4 % of what the spring does, and less than the law of the spring leaves."""
    found = decide(ForwardSelection(searched(9.0 * np.tanh(Q) + size * OTHER, OTHER)))
    names = [one.shaped.candidate.effect.name for one in found.passed]
    assert names[0] == "hose stiffness, shape as drawn"
    assert (names[1:] == ["inertia of the actuator"]) is (size > 0.0)


def test_an_effect_that_made_way_for_another_is_in_no_set_twice() -> None:
    """As of the scales of several joints, that come to the same, another one is taken."""
    found = searched(9.0 * np.tanh(Q) + OTHER, OTHER)
    selection = ForwardSelection(found)
    shape = found.shapes.of(found.projection.candidates[0].candidate)
    assert shape is not None
    number = selection.add(shape)
    before, after = (solve(selection.search.projection, one) for one in ((number, 0), (number, 1)))
    assert before is not None and after is not None
    selection.go_on_from(before)
    settled = all_judged(selection.search, before)
    judged = judged_beside(selection.search, after, settled)
    assert judged[0] is settled[0]
    assert judged[1].shaped is selection.search.projection.candidates[1]


@pytest.mark.parametrize(
    ("missing", "second", "expected"),
    [
        (9.0 * Q + OTHER, OTHER, True),
        (9.0 * np.tanh(Q) + OTHER, OTHER, False),  # the law leaves something of its own
        (9.0 * Q + LIKE_SHAPE, LIKE_SHAPE, False),  # as does another shape of the spring
    ],
)
def test_an_effect_stands_apart_where_the_law_of_the_stronger_one_fits(
    missing: np.ndarray, second: np.ndarray, expected: bool
) -> None:
    known = searched(missing, second)
    subset = solve(known.projection, (0, 1))
    assert subset is not None
    gains = marginal(known, subset)
    assert gains[0] > gains[1] > 60.0
    assert stands_apart(known, subset, gains, 1, 20.0) is expected
