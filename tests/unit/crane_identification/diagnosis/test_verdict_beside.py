"""What flow, pulsation, too little data and uncertain values make of a verdict; and its limits."""

from dataclasses import replace

import numpy as np
import pytest
from unit.crane_identification.diagnosis.test_verdict import (
    ENOUGH,
    THRESHOLDS,
    answer,
    effect,
    gap,
    trial,
)

from crane_identification.diagnosis.answer import (
    Answer,
    judge,
    with_flow,
    with_pulsation,
    with_too_little,
)
from crane_identification.diagnosis.decision import Decision
from crane_identification.diagnosis.findings import Verdict
from crane_identification.diagnosis.flow import Flow, Gain, Quantity
from crane_identification.diagnosis.gap import Line, pulsations
from crane_identification.diagnosis.judgement import Reason, Rejection
from crane_identification.diagnosis.proof import Proof, objection

CLOSED = gap(0.0113, 0.0006)
USUAL = 0.005  # share of the flow that is left unexplained


def quantity(kind: str, share: float) -> Quantity:
    """Beyond the usual, by so much of the flow."""
    return Quantity(kind, 2.0, 0.1, 1.0, False, True, share, 1e4 * share, missing=True)


def flow(
    *found: Quantity, left: float = 0.8 * USUAL, correlation: float = 0.2, air: float = 0.0
) -> Flow:
    gains = (Gain("supply_a", 1.0, 0.01, determined=True),)
    method = THRESHOLDS.method
    return Flow("outer_boom", found, gains, left, USUAL, correlation, air, 60.0, 60.0, method)


@pytest.mark.parametrize(
    ("before", "expected"),
    [
        (Verdict.NONE, Verdict.NAMED),
        (Verdict.INSUFFICIENT, Verdict.NAMED),
        (Verdict.UNKNOWN, Verdict.AND_MORE),
        (Verdict.NAMED, Verdict.NAMED),
        (Verdict.AMBIGUOUS, Verdict.AMBIGUOUS),
        (Verdict.AND_MORE, Verdict.AND_MORE),
    ],
)
def test_what_is_beyond_the_usual_in_the_flow_is_a_name(before: Verdict, expected: Verdict) -> None:
    found = with_flow(Answer(before, "so"), [flow(quantity("internal_leakage", 0.02))])
    assert found.verdict is expected
    assert "of outer_boom is beyond what is usual" in found.reason


@pytest.mark.parametrize(
    ("before", "expected"),
    [
        (Verdict.NONE, Verdict.UNKNOWN),
        (Verdict.NAMED, Verdict.AND_MORE),
        (Verdict.AMBIGUOUS, Verdict.AND_MORE),
        (Verdict.INSUFFICIENT, Verdict.UNKNOWN),
        (Verdict.UNKNOWN, Verdict.UNKNOWN),
    ],
)
def test_a_law_of_the_flow_that_has_no_name_is_something_more(
    before: Verdict, expected: Verdict
) -> None:
    found = with_flow(Answer(before, "so"), [flow(left=0.05, correlation=0.6)])
    assert found.verdict is expected
    assert "5.0% of the flow of outer_boom is systematic" in found.reason


@pytest.mark.parametrize(
    ("left", "correlation", "air", "named", "unknown"),
    [
        (0.05, 0.41, 0.0, 0.0, True),
        (0.05, 0.39, 0.69, 0.0, False),  # it is noise
        (0.05, 0.1, 0.71, 0.0, True),  # in moments that do not last
        (0.9 * USUAL, 0.6, 0.9, 0.0, False),  # it is no more than usual
        (0.05, 0.6, 0.0, 0.074, True),  # less than 70 % of the energy has a name
        (0.05, 0.6, 0.0, 0.079, False),
    ],
)
def test_what_is_left_of_the_flow_is_unknown_where_it_is_a_law(
    left: float, correlation: float, air: float, named: float, unknown: bool
) -> None:
    found = flow(quantity("internal_leakage", named), left=left, correlation=correlation, air=air)
    assert found.unknown is unknown
    assert bool(found.missing) is not unknown


@pytest.mark.parametrize(("share", "count"), [(0.22, 1), (0.23, 2)])
def test_what_a_law_takes_along_in_the_flow_has_no_name(share: float, count: int) -> None:
    """A further one makes up a twentieth of the energy of the strongest."""
    found = flow(quantity("valve_hysteresis", 0.04 * share), quantity("internal_leakage", 0.04))
    assert len(found.missing) == count
    assert found.missing[0].type == "internal_leakage"


def test_a_pulsation_is_a_line_that_is_clear_enough() -> None:
    least = THRESHOLDS.gates.pulsation_clearness
    weak, clear = (Line("outer_boom", 2.7, 0.01, times * least) for times in (1.0, 1.01))
    assert pulsations([weak, clear], THRESHOLDS) == (clear,)
    assert with_pulsation(Answer(Verdict.NONE, "x"), ()).verdict is Verdict.NONE


@pytest.mark.parametrize(
    ("reach", "expected", "said"),
    [
        (ENOUGH._replace(testable=0.5), Verdict.NONE, "on: 0.30% on inner_boom, 1.20% on outer"),
        (ENOUGH._replace(testable=0.49), Verdict.INSUFFICIENT, "only 49% of the effects"),
        (ENOUGH._replace(least=0.01), Verdict.NONE, "0.20% on telescope"),
        (ENOUGH._replace(least=0.0101), Verdict.INSUFFICIENT, "one would not show at 1.0%"),
    ],
)
def test_finding_nothing_says_something_where_much_would_have_shown(reach, expected, said) -> None:
    found = answer(reach=reach)
    assert found.verdict is expected and said in found.reason


@pytest.mark.parametrize(("score", "said"), [(60.0, True), (40.0, False)])
def test_what_is_more_than_chance_but_too_little_is_said_beside_none(
    score: float, said: bool
) -> None:
    """The threshold is 50."""
    weak = replace(effect(), score=score)
    decision = Decision((), 50.0, (weak,), (Rejection(Reason.STRENGTH, 0.00059, 0.0006),), ())
    none = answer()
    found = with_too_little(none, decision)
    assert found.verdict is Verdict.NONE
    more = "; load-dependent joint friction (outer_boom) comes nearest, but it is 0.00059 of the"
    assert (more in found.reason) is said and (found == none) is not said


@pytest.mark.parametrize(
    ("p_value", "strength", "law"),
    [(0.004, 0.01, True), (0.006, 0.01, False), (0.004, 0.0003, False)],
)
def test_a_learner_is_sure_beyond_chance_and_beyond_the_processing(
    p_value: float, strength: float, law: bool
) -> None:
    """Half of the false alarms are for it, shared by three joints."""
    learnt = trial().learnt
    ones = np.array([1.0, 0.0, 1.0])
    found = replace(learnt, p_value=np.fmax(ones, p_value), strength=np.full(3, strength))
    assert found.follows_law(THRESHOLDS).tolist() == [False, law, False]


@pytest.mark.parametrize(("energy", "expected"), [(4100.0, Verdict.AND_MORE), (2500.0, None)])
def test_names_carry_most_of_what_can_be_explained(energy: float, expected) -> None:
    """Of 5000, what is left after: 5 % of it may be a law."""
    share = 0.05
    after = trial(effect(), energy=energy, share=share)
    carried = (5000.0 - energy) / (5000.0 - energy + share * energy)
    assert (carried < THRESHOLDS.method.explained_share) is (expected is Verdict.AND_MORE)
    assert answer(after, CLOSED).verdict is (expected or Verdict.NAMED)


@pytest.mark.parametrize(("left", "expected"), [(0.29, Verdict.NAMED), (0.31, Verdict.AND_MORE)])
def test_names_leave_little_energy_where_they_act(left: float, expected: Verdict) -> None:
    found = answer(trial(effect(), energy=500.0, left=left), CLOSED)
    assert found.verdict is expected
    assert ("of the energy beyond noise where they act" in found.reason) is (left > 0.3)


@pytest.mark.parametrize(("times", "expected"), [(2.4, Verdict.NONE), (2.6, Verdict.UNKNOWN)])
def test_errors_count_from_a_multiple_of_the_scatter(times: float, expected: Verdict) -> None:
    assert answer(seen=gap(times * 0.001, floor=0.001)).verdict is expected


@pytest.mark.parametrize(("doubt", "expected"), [(0.015, Verdict.UNKNOWN), (0.016, Verdict.NONE)])
def test_errors_that_values_which_are_kept_allow_are_nothing(
    doubt: float, expected: Verdict
) -> None:
    """They count as the scatter does, by the same factor."""
    found = answer(seen=replace(gap(0.039), uncertain=np.full(3, doubt)))
    assert found.verdict is expected


@pytest.mark.parametrize(("after", "closes"), [(0.00104, True), (0.00106, False)])
def test_where_there_is_no_gap_a_name_must_not_open_one(after: float, closes: bool) -> None:
    """By 5 %, beyond twice the noise floor."""
    seen = gap(0.001, after)
    assert np.isnan(seen.closed[1])
    assert (objection(effect(), seen) is None) is closes


def test_a_name_is_held_to_where_training_went() -> None:
    """Beyond, an end that nobody visited before leaves an error that no law can close."""
    everywhere, there = gap(0.03, 0.026), gap(0.0003, 0.00035, floor=0.001)
    assert objection(effect(), everywhere)
    seen = replace(everywhere, trained=there)
    assert seen.held_to is there and everywhere.held_to is everywhere
    assert objection(effect(), seen) is None


@pytest.mark.parametrize(("before", "open_"), [(0.001025, False), (0.00103, True)])
def test_a_gap_is_more_than_a_twentieth_of_the_energy(before: float, open_: bool) -> None:
    """Of an error of which 0.1 % are the least that some model reaches."""
    seen = gap(before, 0.001)
    assert bool(np.isfinite(seen.closed[1])) is open_


def test_the_share_of_a_gap_is_of_the_energy_that_can_be_explained() -> None:
    seen = gap(0.005, 0.003)
    assert seen.closed[1] == pytest.approx((25.0 - 9.0) / (25.0 - 1.0))


def test_a_law_that_only_the_learner_finds_is_unknown() -> None:
    before = trial(energy=5000.0, share=0.3)
    found = judge(Proof(before, before, gap(0.0006)), ENOUGH)
    assert found.verdict is Verdict.UNKNOWN
    assert found.reason == (
        "the residual of outer_boom is systematic, but no effect of the catalogue explains it"
    )
