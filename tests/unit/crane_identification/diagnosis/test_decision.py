"""Which effects are findings, on columns made up for the purpose with known answers."""

from dataclasses import FrozenInstanceError

import numpy as np
import pytest
from unit.crane_identification.diagnosis.made import ROWS, normal, searched

from crane_identification.diagnosis.decision import Decision, decide
from crane_identification.diagnosis.judgement import Reason, Rejection, null_gains
from crane_identification.diagnosis.search import Search
from crane_identification.diagnosis.selection import ForwardSelection
from crane_identification.thresholds import load_thresholds

A, B, C, D = np.linalg.qr(normal(1, ROWS, 4))[0].T * np.sqrt(ROWS)
"""Columns that have nothing in common; of 1 in the force, each gains as many as there are rows."""
THRESHOLDS = load_thresholds()


def decided(found: Search) -> Decision:
    return decide(ForwardSelection(found))


def names(decision: Decision) -> list[str]:
    return [one.shaped.candidate.type for one in decision.passed]


def mixed(correlation: float, one: np.ndarray, rest: np.ndarray) -> np.ndarray:
    """A column of this correlation with another one."""
    return correlation * one + np.sqrt(1.0 - correlation**2) * rest


def test_noise_is_no_finding_and_the_best_of_it_says_what_it_lacks() -> None:
    found = decided(searched({"offset": A, "hose_stiffness": B}, np.zeros(ROWS)))
    assert found.passed == ()
    (nearest,) = found.nearest
    assert nearest.score < found.threshold
    assert found.rejections == (Rejection(Reason.SCORE, nearest.score, found.threshold),)


def test_the_search_grows_in_the_race_alone() -> None:
    """What a selection began with stays as it was, and what it ends with cannot change."""
    found = searched({"offset": A, "hose_stiffness": B}, 0.5 * B)
    selection = ForwardSelection(found)
    decide(selection)
    assert len(found.sets) == 1 < len(selection.search.sets)
    with pytest.raises(FrozenInstanceError):
        selection.search.projection = found.projection  # type: ignore[misc]


def test_what_is_missing_is_found_with_the_gain_that_it_has() -> None:
    found = decided(searched({"offset": A, "hose_stiffness": B}, 0.5 * B))
    (one,) = found.passed
    assert one.shaped.candidate.type == "hose_stiffness"
    assert one.score == pytest.approx(0.25 * ROWS, rel=0.2)
    assert one.strength == pytest.approx(0.5 / np.sqrt(5.0**2 + 0.5**2 + 1.0), rel=0.1)
    assert one.indistinct == () and one.runner_up is None
    assert found.nearest == (one,) and not found.rejections


def test_the_threshold_is_the_factor_times_the_quantile_of_chance() -> None:
    search = searched({"offset": A, "hose_stiffness": B}, 0.5 * B)
    found = decided(search)
    (one,) = found.passed
    null = null_gains(search.projection, ())
    rate, factor = THRESHOLDS.method.false_alarm_rate, THRESHOLDS.gates.score_factor
    assert (null > one.threshold / factor).mean() == pytest.approx(rate / 2.0, abs=0.003)
    assert one.threshold == found.threshold


def test_all_that_is_missing_is_found_strongest_first() -> None:
    assert names(decided(searched({"offset": A, "hose_stiffness": B}, 0.5 * A + B))) == [
        "hose_stiffness",
        "offset",
    ]


@pytest.mark.parametrize(
    ("share", "rest", "expected"), [(0.01, 0.0, 1), (0.03, 0.0, 2), (0.03, 1.0, 1), (0.08, 1.0, 2)]
)
def test_a_further_effect_gains_a_share_of_the_first_one(
    share: float, rest: float, expected: int
) -> None:
    """Five percent where the first one leaves a `rest` that follows no law, as its form does; two
    percent where the further effect is all that is left.
    """
    missing = 3.0 * (A + np.sqrt(share) * B) - rest * C
    candidates = {"offset": A, "hose_stiffness": B, "load_friction": C}
    found = decided(searched(candidates, missing, positive=("load_friction",)))
    assert len(names(found)) == expected


def test_an_effect_below_the_errors_of_the_processing_is_none() -> None:
    """Beside a force of which it is the five thousandth part."""
    found = decided(searched({"offset": A}, 0.5 * A, mass=2500.0))
    assert not found.passed
    (rejection,) = found.rejections
    assert rejection.reason is Reason.STRENGTH
    assert rejection.measured < rejection.limit == THRESHOLDS.gates.smallest_strength


def test_an_effect_in_a_third_of_the_time_alone_is_none() -> None:
    """It is not the same in all blocks of time: two of six are better predicted without."""
    turned = np.where(np.arange(ROWS) < ROWS // 3, -1.0, 1.0)
    found = decided(searched({"offset": A}, 2.0 * turned * A))
    assert not found.passed
    assert found.rejections == (Rejection(Reason.HELD_OUT, 4, 6),)


def test_an_effect_that_is_refused_blocks_no_other() -> None:
    """It leads, but in a third of the time it is the other way round."""
    turned = np.where(np.arange(ROWS) < ROWS // 3, -1.0, 1.0)
    found = decided(searched({"offset": A, "hose_stiffness": B}, 6.0 * turned * A + 1.5 * B))
    assert names(found) == ["hose_stiffness"]
    (nearest,) = found.nearest
    assert nearest.shaped.candidate.type == "offset"
    assert nearest.score > found.passed[0].score
    assert ("constant force (axis)",) in [one.effects for one in found.beyond]


@pytest.mark.parametrize(("size", "mass", "shows"), [(2.0, 5.0, True), (2.0, 1e4, False)])
@pytest.mark.parametrize("turned", [True, False])
def test_what_a_test_refuses_though_it_is_no_chance_is_not_nothing(
    size: float, mass: float, shows: bool, turned: bool
) -> None:
    """But what is less than the errors of the processing is, and what is named needs no doubt."""
    sign = np.where(np.arange(ROWS) < ROWS // 3, -1.0, 1.0) if turned else 1.0
    found = decided(searched({"offset": A}, size * sign * A, mass=mass))
    assert bool(found.beyond) is (shows and turned)
    assert not shows or bool(found.passed) is not turned
    expected = ("constant force (axis)",), found.rejections
    assert all((one.effects, one.rejections) == expected for one in found.beyond)


@pytest.mark.parametrize(("size", "indistinct"), [(0.4, ["hose_stiffness"]), (3.0, [])])
def test_what_recordings_do_not_tell_apart_is_a_class(size: float, indistinct: list[str]) -> None:
    """Columns of a correlation of 0.95 differ by a tenth of the score."""
    like = mixed(0.95, A, B)
    (one,) = decided(searched({"offset": A, "hose_stiffness": like}, size * A)).passed
    assert [member.type for member in one.indistinct] == indistinct
    assert one.runner_up is not None and one.runner_up.type == "hose_stiffness"
    assert one.correlation == pytest.approx(0.95, abs=0.01)
    assert one.margin == pytest.approx((1.0 - 0.95**2) * one.score, rel=0.4)


@pytest.mark.parametrize(("correlation", "indistinct"), [(0.9965, 1), (0.98, 0)])
def test_columns_that_are_nearly_the_same_are_one_class_at_any_strength(
    correlation: float, indistinct: int
) -> None:
    """A score of 60,000 is 420 ahead of the one, 2,400 of the other; of both, 600 are asked for."""
    like = mixed(correlation, A, B)
    (one,) = decided(searched({"offset": A, "hose_stiffness": like}, 10.0 * A)).passed
    assert len(one.indistinct) == indistinct


@pytest.mark.parametrize(("correlation", "swaps"), [(0.1, 0), (0.3, 1)])
def test_what_explains_something_else_is_no_rival(correlation: float, swaps: int) -> None:
    like = mixed(correlation, A, B)
    (one,) = decided(searched({"offset": A, "hose_stiffness": like}, 3.0 * A)).passed
    assert (one.runner_up is not None) == bool(swaps)


def test_what_the_best_leaves_unexplained_is_asked_of_its_lead() -> None:
    """The rest is no noise: it has the form of a candidate, with a sign that this cannot have."""
    like, lead = mixed(0.9, A, B), (1.0 - 0.9**2) * 9.0 * ROWS
    for rest, indistinct in ((2.0, 0), (3.5, 1)):
        candidates = {"offset": A, "hose_stiffness": like, "load_friction": C}
        found = searched(candidates, 3.0 * A - rest * C, positive=("load_friction",))
        (one,) = decided(found).passed
        assert len(one.indistinct) == indistinct
        assert one.needed == pytest.approx(0.25 * rest**2 * ROWS, rel=0.2)
        assert one.margin == pytest.approx(lead, rel=0.25)


def test_of_laws_that_gain_alike_the_one_with_less_freedom_is_taken() -> None:
    """The other one, with a column more, always gains a little more."""
    wider = 100.0 * np.stack([A + 0.1 * C, A - 0.1 * C], axis=1)  # of pressure
    found = searched({"chamber_gain": wider, "offset": A}, 2.0 * A)
    first = found.projection.candidates[ForwardSelection(found).sets(1)[0].numbers[0]]
    assert first.candidate.type == "chamber_gain"
    (one,) = decided(found).passed
    assert one.shaped.candidate.type == "offset"
    assert [member.type for member in one.indistinct] == ["chamber_gain"]


def test_a_law_with_more_freedom_that_needs_it_is_taken() -> None:
    wider = 100.0 * np.stack([A + 0.1 * C, A - 0.1 * C], axis=1)  # of pressure
    found = searched({"chamber_gain": wider, "offset": A}, 2.0 * A + C)
    assert names(decided(found)) == ["chamber_gain"]


def test_a_further_effect_that_several_explain_as_well_is_what_a_form_leaves() -> None:
    """Where the first one has a form that lies between the others."""
    candidates = {"offset": A, "hose_stiffness": mixed(0.8, B, C), "position_friction": B}
    several = {**candidates, "position_friction": mixed(0.8, B, -C)}
    missing = 2.0 * A + 0.8 * B
    assert names(decided(searched(candidates, missing))) == ["offset", "position_friction"]
    assert names(decided(searched(several, missing))) == ["offset"]
