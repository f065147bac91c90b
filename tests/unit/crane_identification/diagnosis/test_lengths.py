"""Links of other lengths than in the file, on logs of a machine that was built so."""

from collections.abc import Mapping
from dataclasses import replace
from unittest.mock import Mock

import numpy as np
import pytest
from laboratory_crane import with_linkage
from unit.crane_identification.synthetic import crane_log, crane_model

from crane_identification.diagnosis.decision.decision import decide
from crane_identification.diagnosis.decision.judgement import Judged
from crane_identification.diagnosis.decision.of_lengths import without_those_of_lengths
from crane_identification.diagnosis.fit.evidence import gather
from crane_identification.diagnosis.search.candidates import candidates_of
from crane_identification.diagnosis.search.energy import unexplained
from crane_identification.diagnosis.search.lengths import beside_lengths, columns_of_lengths
from crane_identification.diagnosis.search.race import Race
from crane_identification.diagnosis.search.search import Search, search
from crane_identification.diagnosis.search.selection import NOTHING, extended
from crane_identification.options import Options
from crane_identification.preparation.prepare import prepare
from crane_identification.thresholds import load_thresholds
from crane_model.machine import Machine
from crane_model.terms.elasticity import BoomFlexibility

ASKED = ("linkage_scale", "pressure_gain", "boom_flexibility", "load_friction", "encoder_offset")
SEEDS = range(5)  # of recordings
FACTOR = 20
THRESHOLDS = load_thresholds()


def with_link(machine: Machine, joint: str, factor: float) -> Machine:
    content = machine.model_dump(by_alias=True)
    (row,) = (one["dh"] for one in content["joints"] if one["name"] == joint)
    row["a"] *= factor
    return Machine.model_validate(content)


def built(
    links: Mapping[str, float], linkages: Mapping[str, float], bending: float = 0.0
) -> Search:
    """The search of the file's model in recordings of a machine with lengths times these, and with
    an inertia `bending` [kg m2] that takes part where its inner boom bends.
    """
    model = crane_model()
    machine = model.machine
    for joint, factor in links.items():
        machine = with_link(machine, joint, factor)
    for joint, factor in linkages.items():
        machine = with_linkage(machine, joint, factor)
    actual = replace(model, setting=model.setting._replace(machine=machine))
    if bending:
        bend = BoomFlexibility(joint="inner_boom", frequency=3.0, damping=0.1)
        actual = replace(actual.with_term(bend), values=np.append(model.theta, bending))
    recordings = [
        one
        for seed in SEEDS
        for one in prepare(
            model, replace(crane_log(seed, 1, actual), source=str(seed)), Options(average=False)
        )
    ]
    evidence = gather(model, recordings, FACTOR)
    return search(evidence, [one for one in candidates_of(model, evidence) if one.type in ASKED])


def judged(made: Search, kind: str, score: float) -> Judged:
    """The effect of this kind that explains most, with a score made up for the purpose."""
    own = [
        one
        for one in extended(made.projection, NOTHING)
        if made.projection.candidates[one.numbers[0]].candidate.type == kind
    ]
    best = max(own, key=lambda one: one.gain)
    effect: Judged = Mock(shaped=made.projection.candidates[best.numbers[0]], score=score)
    return effect


@pytest.fixture(scope="module")
def longer() -> Search:
    return built({"inner_boom": 1.03, "outer_boom": 0.97}, {})


def test_what_links_of_other_lengths_make_is_taken_out(longer: Search) -> None:
    left, beside = (unexplained(one, NOTHING).sum() for one in (longer, beside_lengths(longer)))
    assert left > 1000.0 and beside < 0.02 * left


def test_a_machine_of_its_file_loses_no_candidate_beside_lengths() -> None:
    made = built({}, {})
    beside = beside_lengths(made)
    assert columns_of_lengths(made.evidence).shape[2] == 2  # of two booms
    assert beside.projection.candidates == made.projection.candidates
    assert np.median(beside.projection.visibility / made.projection.visibility) > 0.5


def test_a_weaker_effect_that_lengths_explain_is_none(longer: Search) -> None:
    """A boom that bends slowly resembles what links leave; alone, it may be what it seems."""
    strong = judged(longer, "load_friction", 9e9)
    weak = judged(longer, "boom_flexibility", 9.0)
    assert without_those_of_lengths(longer, (strong, weak), THRESHOLDS) == (strong,)
    assert without_those_of_lengths(longer, (weak,), THRESHOLDS) == (weak,)


def test_a_weaker_effect_stays_that_lengths_do_not_explain() -> None:
    bending = built({}, {}, bending=30.0)
    pair = tuple(
        judged(bending, kind, score)
        for kind, score in (("load_friction", 9e9), ("boom_flexibility", 9.0))
    )
    assert without_those_of_lengths(bending, pair, THRESHOLDS) == pair


def test_lengths_that_are_off_are_no_other_effect() -> None:
    """Links leave what a boom that bends slowly, or friction, would explain."""
    made = built({"inner_boom": 1.03, "outer_boom": 0.97}, {"inner_boom": 1.03, "outer_boom": 0.98})
    found = decide(Race(made), THRESHOLDS).passed
    kinds = {one.shaped.candidate.type for one in found}
    assert kinds and kinds <= {"linkage_scale", "pressure_gain"}
