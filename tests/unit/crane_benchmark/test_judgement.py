"""Whether an answer is right."""

import pytest

from crane_benchmark.cases.case import Kind
from crane_benchmark.leave_one_out import Left, became
from crane_benchmark.scores.judgement import Answer, Outcome, judge

STRIBECK, LOAD = ("stribeck", "telescope"), ("load_friction", "telescope")
"""Two effects."""
CYCLIC, LINEAR = ("cyclic_friction", "telescope"), ("position_friction", "telescope")
"""Two laws of one effect."""


def answer(verdict: str, *findings: tuple[tuple[str, str], ...]) -> Answer:
    return Answer(verdict, findings)


@pytest.mark.parametrize(
    ("kind", "hidden", "given", "outcome"),
    [
        (Kind.NOTHING, [], answer("none"), Outcome.RIGHT),
        (Kind.NOTHING, [], answer("insufficient_data"), Outcome.REFUSED),
        (Kind.NOTHING, [], answer("unknown"), Outcome.FALSE_ALARM),
        (Kind.NOTHING, [], answer("named", (STRIBECK,)), Outcome.FALSE_ALARM),
        (Kind.OUTSIDE, [("detent", "telescope")], answer("unknown"), Outcome.RIGHT),
        (
            Kind.OUTSIDE,
            [("detent", "telescope")],
            answer("named", (STRIBECK,)),
            Outcome.WRONG_NAME,
        ),
        (Kind.OUTSIDE, [("detent", "telescope")], answer("none"), Outcome.MISSED),
        (Kind.SINGLE, [STRIBECK], answer("named", (STRIBECK,)), Outcome.RIGHT),
        (
            Kind.SINGLE,
            [STRIBECK],
            answer("named", (("stribeck", "inner_boom"),)),
            Outcome.WRONG_NAME,
        ),
        (
            Kind.SINGLE,
            [STRIBECK],
            answer("named", (STRIBECK,), (LOAD,)),
            Outcome.WRONG_NAME,
        ),
        (Kind.SINGLE, [CYCLIC], answer("named", (LINEAR,)), Outcome.RIGHT),
        (Kind.SINGLE, [CYCLIC], answer("class", (CYCLIC, LINEAR)), Outcome.RIGHT),
        (Kind.SINGLE, [CYCLIC], answer("named", (LINEAR,), (CYCLIC,)), Outcome.RIGHT),
        (Kind.PAIR, [CYCLIC, LOAD], answer("named", (LINEAR,), (CYCLIC,)), Outcome.PARTLY),
        (
            Kind.SINGLE,
            [CYCLIC],
            answer("named", (("position_friction", "inner_boom"),)),
            Outcome.WRONG_NAME,
        ),
        (Kind.SINGLE, [STRIBECK], answer("class", (LOAD, STRIBECK)), Outcome.TOO_WIDE),
        (Kind.SINGLE, [STRIBECK], answer("unknown"), Outcome.NOT_NAMED),
        (Kind.SINGLE, [STRIBECK], answer("crash"), Outcome.CRASH),
        (Kind.PAIR, [STRIBECK, LOAD], answer("named", (LOAD,), (STRIBECK,)), Outcome.RIGHT),
        (Kind.PAIR, [STRIBECK, LOAD], answer("named", (LOAD,)), Outcome.PARTLY),
        (Kind.PAIR, [STRIBECK, LOAD], answer("named_and_more", (LOAD,)), Outcome.PARTLY),
        (Kind.SINGLE, [STRIBECK], answer("named_and_more", (STRIBECK,)), Outcome.RIGHT),
        (Kind.SINGLE, [STRIBECK], answer("named_and_more", (LOAD,)), Outcome.WRONG_NAME),
        (
            Kind.OUTSIDE,
            [("detent", "telescope")],
            answer("named_and_more", (STRIBECK,)),
            Outcome.WRONG_NAME,
        ),
        (Kind.NOTHING, [], answer("named_and_more", (STRIBECK,)), Outcome.FALSE_ALARM),
        (Kind.INSUFFICIENT, [STRIBECK], answer("insufficient_data"), Outcome.RIGHT),
        (Kind.INSUFFICIENT, [STRIBECK], answer("none"), Outcome.MISSED),
        (Kind.INSUFFICIENT, [STRIBECK], answer("class", (LOAD, STRIBECK)), Outcome.RIGHT),
        (Kind.INSUFFICIENT, [STRIBECK], answer("named", (LOAD,)), Outcome.WRONG_NAME),
        (
            Kind.CLASS,
            [],
            answer("class", (("offset", "telescope"), ("coulomb_asymmetry", "telescope"))),
            Outcome.RIGHT,
        ),
        (Kind.CLASS, [], answer("named", (("offset", "telescope"),)), Outcome.WRONG_NAME),
    ],
)
def test_answers_are_judged(kind, hidden, given, outcome):
    assert judge(kind, hidden, given, lambda number, other: False) is outcome


def test_a_class_of_effects_that_explain_as_well_is_right():
    given = answer("class", (LOAD, STRIBECK))
    assert judge(Kind.SINGLE, [STRIBECK], given, lambda _, other: other == LOAD) is Outcome.RIGHT


def test_findings_are_read_with_their_classes():
    finding = {"effect": "a", "joint": "j", "class_members": [{"effect": "b", "joint": "all"}]}
    given = Answer.of_diagnosis({"verdict": "class", "findings": [finding]})
    assert given == answer("class", (("a", "j"), ("b", "all")))
    assert given.headline == "a"


@pytest.mark.parametrize(
    ("given", "left"),
    [
        (answer("unknown"), Left.UNKNOWN),
        (answer("none"), Left.SILENT),
        (answer("named", (("presliding", "telescope"),)), Left.DECLARED),
        (answer("named_and_more", (("presliding", "telescope"),)), Left.DECLARED),
        (answer("named_and_more", (("hose_mass", "all"),)), Left.WRONG),
        (answer("class", (LOAD, ("presliding", "telescope"))), Left.DECLARED_CLASS),
        (answer("named", (("presliding", "inner_boom"),)), Left.WRONG),
        (answer("named", (("presliding", "telescope"),), (("hose_mass", "all"),)), Left.WRONG),
    ],
)
def test_what_becomes_of_an_effect_whose_entry_is_left_out(given, left):
    assert became(STRIBECK, given) is left


def test_what_tilts_the_base_may_be_taken_for_zeros_of_the_encoders_of_several_joints():
    zeros = (("encoder_offset", "outer_boom"), ("encoder_offset", "inner_boom"))
    assert became(("base_tilt", "all"), answer("class", zeros)) is Left.DECLARED_CLASS
    assert became(("base_tilt", "all"), answer("named", (STRIBECK,))) is Left.WRONG
