"""Whether an answer is right."""

import pytest

from crane_benchmark import BlindAnswer, CaseKind, Judgement, judge
from crane_benchmark.answers.answer_cases import CaseAnswer
from crane_benchmark.leave_one_out import Left, became
from crane_identification.diagnosis.findings import FindingEntry, Findings, FoundEffect

STRIBECK, LOAD = ("stribeck", "telescope"), ("load_friction", "telescope")
"""Two effects."""
CYCLIC, LINEAR = ("cyclic_friction", "telescope"), ("position_friction", "telescope")
"""Two laws of one effect."""
GAIN, LINKAGE = ("pressure_gain", "inner_boom"), ("linkage_scale", "inner_boom")
"""What scales the whole force of a joint."""


def answer(verdict: str, *findings: tuple[tuple[str, str], ...]) -> BlindAnswer:
    return BlindAnswer(verdict=verdict, findings=findings)


@pytest.mark.parametrize(
    ("kind", "hidden", "given", "outcome"),
    [
        (CaseKind.NOTHING, [], answer("none"), Judgement.RIGHT),
        (CaseKind.NOTHING, [], answer("insufficient_data"), Judgement.REFUSED),
        (CaseKind.NOTHING, [], answer("unknown"), Judgement.FALSE_ALARM),
        (CaseKind.NOTHING, [], answer("named", (STRIBECK,)), Judgement.FALSE_ALARM),
        (CaseKind.OUTSIDE, [("detent", "telescope")], answer("unknown"), Judgement.RIGHT),
        (
            CaseKind.OUTSIDE,
            [("detent", "telescope")],
            answer("named", (STRIBECK,)),
            Judgement.WRONG_NAME,
        ),
        (CaseKind.OUTSIDE, [("detent", "telescope")], answer("none"), Judgement.MISSED),
        (CaseKind.NOTHING, [], answer("ambiguous", (LINKAGE, GAIN)), Judgement.FALSE_ALARM),
        (CaseKind.SINGLE, [STRIBECK], answer("ambiguous", (LINKAGE, GAIN)), Judgement.WRONG_NAME),
        (CaseKind.SINGLE, [STRIBECK], answer("named", (STRIBECK,)), Judgement.RIGHT),
        (
            CaseKind.SINGLE,
            [STRIBECK],
            answer("named", (("stribeck", "inner_boom"),)),
            Judgement.WRONG_NAME,
        ),
        (
            CaseKind.SINGLE,
            [STRIBECK],
            answer("named", (STRIBECK,), (LOAD,)),
            Judgement.WRONG_NAME,
        ),
        (CaseKind.SINGLE, [CYCLIC], answer("named", (LINEAR,)), Judgement.RIGHT),
        (CaseKind.SINGLE, [CYCLIC], answer("ambiguous", (CYCLIC, LINEAR)), Judgement.RIGHT),
        (CaseKind.SINGLE, [CYCLIC], answer("named", (LINEAR,), (CYCLIC,)), Judgement.RIGHT),
        (CaseKind.PAIR, [CYCLIC, LOAD], answer("named", (LINEAR,), (CYCLIC,)), Judgement.PARTLY),
        (
            CaseKind.SINGLE,
            [CYCLIC],
            answer("named", (("position_friction", "inner_boom"),)),
            Judgement.WRONG_NAME,
        ),
        (CaseKind.SINGLE, [STRIBECK], answer("ambiguous", (LOAD, STRIBECK)), Judgement.TOO_WIDE),
        (CaseKind.SINGLE, [STRIBECK], answer("unknown"), Judgement.NOT_NAMED),
        (CaseKind.SINGLE, [STRIBECK], answer("crash"), Judgement.CRASH),
        (CaseKind.PAIR, [STRIBECK, LOAD], answer("named", (LOAD,), (STRIBECK,)), Judgement.RIGHT),
        (CaseKind.PAIR, [STRIBECK, LOAD], answer("named", (LOAD,)), Judgement.PARTLY),
        (CaseKind.PAIR, [STRIBECK, LOAD], answer("named_and_more", (LOAD,)), Judgement.PARTLY),
        (CaseKind.SINGLE, [STRIBECK], answer("named_and_more", (STRIBECK,)), Judgement.RIGHT),
        (CaseKind.SINGLE, [STRIBECK], answer("named_and_more", (LOAD,)), Judgement.WRONG_NAME),
        (
            CaseKind.OUTSIDE,
            [("detent", "telescope")],
            answer("named_and_more", (STRIBECK,)),
            Judgement.WRONG_NAME,
        ),
        (CaseKind.NOTHING, [], answer("named_and_more", (STRIBECK,)), Judgement.FALSE_ALARM),
        (CaseKind.INSUFFICIENT, [STRIBECK], answer("insufficient_data"), Judgement.RIGHT),
        (CaseKind.INSUFFICIENT, [STRIBECK], answer("none"), Judgement.MISSED),
        (CaseKind.INSUFFICIENT, [STRIBECK], answer("ambiguous", (LOAD, STRIBECK)), Judgement.RIGHT),
        (CaseKind.INSUFFICIENT, [STRIBECK], answer("named", (LOAD,)), Judgement.WRONG_NAME),
        (
            CaseKind.AMBIGUOUS,
            [],
            answer("ambiguous", (("offset", "telescope"), ("coulomb_asymmetry", "telescope"))),
            Judgement.RIGHT,
        ),
        (CaseKind.AMBIGUOUS, [], answer("named", (("offset", "telescope"),)), Judgement.WRONG_NAME),
    ],
)
def test_answers_are_judged(kind, hidden, given, outcome):
    assert judge(kind, hidden, given, lambda number, rival: False) is outcome


@pytest.mark.parametrize(
    ("kind", "hidden", "given", "outcome"),
    [
        (CaseKind.LENGTHS, [], answer("unknown"), Judgement.RIGHT),
        (CaseKind.LENGTHS, [], answer("none"), Judgement.MISSED),
        (CaseKind.LENGTHS, [], answer("named", (STRIBECK,)), Judgement.WRONG_NAME),
        (CaseKind.LENGTHS, [], answer("named", (GAIN,)), Judgement.RIGHT),
        (CaseKind.LENGTHS, [], answer("ambiguous", (LINKAGE, GAIN)), Judgement.RIGHT),
        (CaseKind.LENGTHS, [], answer("ambiguous", (LINKAGE, STRIBECK)), Judgement.TOO_WIDE),
        (CaseKind.LENGTHS, [], answer("named", (LINKAGE,), (LOAD,)), Judgement.WRONG_NAME),
        (CaseKind.SINGLE, [LOAD], answer("ambiguous", (LINKAGE, GAIN), (LOAD,)), Judgement.RIGHT),
        (CaseKind.SINGLE, [LOAD], answer("ambiguous", (LINKAGE, GAIN)), Judgement.MISSED),
        (CaseKind.SINGLE, [LOAD], answer("named_and_more", (LINKAGE,)), Judgement.NOT_NAMED),
        (CaseKind.SINGLE, [LOAD], answer("named", (LINKAGE,), (STRIBECK,)), Judgement.WRONG_NAME),
        (CaseKind.SINGLE, [LOAD], answer("ambiguous", (LOAD, LINKAGE)), Judgement.TOO_WIDE),
        (
            CaseKind.SINGLE,
            [LOAD],
            answer("named", (LINKAGE, STRIBECK), (LOAD,)),
            Judgement.TOO_WIDE,
        ),
        (CaseKind.PAIR, [LOAD, STRIBECK], answer("named", (LINKAGE,), (LOAD,)), Judgement.PARTLY),
        (CaseKind.OUTSIDE, [("detent", "j")], answer("named_and_more", (GAIN,)), Judgement.RIGHT),
        (CaseKind.OUTSIDE, [("detent", "j")], answer("named", (GAIN,)), Judgement.MISSED),
    ],
)
def test_answers_on_machines_of_other_lengths(kind, hidden, given, outcome):
    assert judge(kind, hidden, given, lambda number, rival: False, off=True) is outcome


def test_lengths_that_do_not_show_need_not_be_found():
    for said, outcome in (("none", Judgement.RIGHT), ("unknown", Judgement.RIGHT)):
        found = judge(CaseKind.LENGTHS, [], answer(said), lambda *_: False, above_noise=False)
        assert found is outcome
    found = judge(CaseKind.SINGLE, [LOAD], answer("none"), lambda *_: False, above_noise=False)
    assert found is Judgement.MISSED


def test_a_class_of_effects_that_explain_as_well_is_right():
    given = answer("ambiguous", (LOAD, STRIBECK))
    assert (
        judge(CaseKind.SINGLE, [STRIBECK], given, lambda _, rival: rival == LOAD) is Judgement.RIGHT
    )


def test_twins_may_have_a_further_one_that_explains_as_well():
    gain = ("chamber_gain", "telescope")
    given = answer("ambiguous", (("offset", "telescope"), ("coulomb_asymmetry", "telescope"), gain))
    assert judge(CaseKind.AMBIGUOUS, [], given, lambda _, rival: rival == gain) is Judgement.RIGHT
    assert judge(CaseKind.AMBIGUOUS, [], given, lambda *_: False) is Judgement.TOO_WIDE


def test_twins_may_have_a_further_law_of_what_is_hidden():
    class_ = (("offset", "telescope"), ("pressure_offset", "telescope"))
    hidden = [("pressure_offset", "telescope")]
    drift, gain = ("pressure_drift", "telescope"), ("chamber_gain_drift", "telescope")
    for further, outcome in (
        ((drift,), Judgement.RIGHT),
        ((drift, gain), Judgement.TOO_WIDE),
        ((gain,), Judgement.WRONG_NAME),
        ((LOAD,), Judgement.WRONG_NAME),
        ((("pressure_drift", "inner_boom"),), Judgement.WRONG_NAME),
    ):
        given = answer("ambiguous", further, class_)
        assert judge(CaseKind.AMBIGUOUS, hidden, given, lambda *_: False) is outcome
    given = answer("named", (drift,))
    assert judge(CaseKind.AMBIGUOUS, hidden, given, lambda *_: False) is Judgement.WRONG_NAME


def test_findings_are_read_with_their_classes():
    second = FoundEffect.model_construct(effect="b", joint="all")
    finding = FindingEntry.model_construct(effect="a", joint="j", ambiguity_group=[second])
    found = Findings.model_construct(findings=[finding])
    said = CaseAnswer.model_construct(verdict="ambiguous", reason="made up", findings=found)
    given = BlindAnswer.of_diagnosis(said)
    assert given == answer("ambiguous", (("a", "j"), ("b", "all")))
    assert given.headline == "a"


@pytest.mark.parametrize(
    ("given", "left"),
    [
        (answer("unknown"), Left.UNKNOWN),
        (answer("none"), Left.SILENT),
        (answer("named", (("presliding", "telescope"),)), Left.DECLARED),
        (answer("named_and_more", (("presliding", "telescope"),)), Left.DECLARED),
        (answer("named_and_more", (("hose_mass", "all"),)), Left.WRONG),
        (answer("ambiguous", (LOAD, ("presliding", "telescope"))), Left.DECLARED_CLASS),
        (answer("named", (("presliding", "inner_boom"),)), Left.WRONG),
        (answer("named", (("presliding", "telescope"),), (("hose_mass", "all"),)), Left.WRONG),
    ],
)
def test_what_becomes_of_an_effect_whose_entry_is_left_out(given, left):
    assert became(STRIBECK, given) is left


SCALE = (("linkage_scale", "outer_boom"), ("pressure_gain", "outer_boom"))


@pytest.mark.parametrize(
    ("given", "left"),
    [
        (answer("ambiguous", SCALE), Left.SILENT),
        (answer("named_and_more", SCALE), Left.UNKNOWN),
        (answer("ambiguous", SCALE, (("presliding", "telescope"),)), Left.DECLARED_CLASS),
        (answer("ambiguous", SCALE, (("hose_mass", "all"),)), Left.WRONG),
    ],
)
def test_what_is_said_of_lengths_that_are_off_is_no_name_of_an_effect_left_out(given, left):
    assert became(STRIBECK, given, off=True) is left
    assert became(STRIBECK, given) is Left.WRONG


def test_what_tilts_the_base_may_be_taken_for_zeros_of_the_encoders_of_several_joints():
    zeros = (("encoder_offset", "outer_boom"), ("encoder_offset", "inner_boom"))
    assert became(("base_tilt", "all"), answer("ambiguous", zeros)) is Left.DECLARED_CLASS
    assert became(("base_tilt", "all"), answer("named", (STRIBECK,))) is Left.WRONG
