"""Linkages of another size than in the file, on logs of a machine that was built so."""

from collections.abc import Mapping
from dataclasses import replace
from typing import cast
from unittest.mock import Mock

import numpy as np
import pytest
from laboratory_crane import with_linkage
from unit.crane_identification.diagnosis import made as made_up
from unit.crane_identification.synthetic import crane_log, crane_model

from crane_identification import Options
from crane_identification.diagnosis.candidates import candidates_of
from crane_identification.diagnosis.decision import decide, left_by_forms
from crane_identification.diagnosis.evidence import gather
from crane_identification.diagnosis.judgement import Judged
from crane_identification.diagnosis.lookalikes import slight
from crane_identification.diagnosis.projection import Subset, solve
from crane_identification.diagnosis.proof import Value, differs
from crane_identification.diagnosis.search import Search, search
from crane_identification.diagnosis.selection import ForwardSelection
from crane_identification.diagnosis.several import smallest
from crane_identification.preparation.prepare import prepare
from crane_identification.thresholds import load_thresholds

THRESHOLDS = load_thresholds()
RIVALS = ("linkage_scale", "pressure_gain", "chamber_gain", "load_friction", "encoder_offset")
SEEDS = range(5)  # of recordings
FACTOR = 20


def built(larger: Mapping[str, float]) -> Search:
    """The search of the file's model in recordings of a machine whose linkages are `larger`."""
    model = crane_model()
    machine = model.machine
    for joint, factor in larger.items():
        machine = with_linkage(machine, joint, factor)
    actual = replace(model, setting=model.setting._replace(machine=machine))
    recordings = [
        prepare(
            model, replace(crane_log(seed, 1, actual), source=str(seed)), Options(average=False)
        )
        for seed in SEEDS
    ]
    evidence = gather(model, [one for several in recordings for one in several], FACTOR)
    return search(
        evidence, [one for one in candidates_of(model, evidence) if one.type in RIVALS], THRESHOLDS
    )


def named(made: Search) -> list[set[tuple[str, str]]]:
    """What a decision names, each with what cannot be told from it."""
    found = decide(ForwardSelection(made)).passed
    several = [(one.shaped.candidate, *one.indistinct) for one in found]
    return [{(one.type, one.where) for one in members} for members in several]


@pytest.fixture(scope="module")
def both() -> Search:
    return built({"inner_boom": 1.02, "outer_boom": 0.98})


def test_a_linkage_is_named_in_one_class_with_the_gain_of_its_transducers() -> None:
    made = built({"outer_boom": 1.025})
    (members,) = named(made)
    assert members == {("linkage_scale", "outer_boom"), ("pressure_gain", "outer_boom")}


def test_two_linkages_are_found_at_their_sizes(both: Search) -> None:
    selection = ForwardSelection(both)
    decide(selection)
    subset = smallest(selection.search, selection.sets(2)[0], 10.0)
    sizes = values(selection.search, subset)
    assert sizes[("linkage_scale", "inner_boom")] == pytest.approx(1.0 - 1.0 / 1.02, abs=2e-3)
    assert sizes[("linkage_scale", "outer_boom")] == pytest.approx(1.0 - 1.0 / 0.98, abs=2e-3)


def test_of_factors_that_come_to_the_same_the_smallest_are_taken(both: Search) -> None:
    """The telescope's force, too small, and the outer boom's, twice as much so, explain as much."""
    projection = both.projection
    number = {
        (one.candidate.type, one.candidate.where): i for i, one in enumerate(projection.candidates)
    }
    large = solve(
        projection, (number["pressure_gain", "telescope"], number["linkage_scale", "outer_boom"])
    )
    assert large is not None
    small = smallest(both, large, 10.0)
    assert set(values(both, small)) == {
        ("linkage_scale", "inner_boom"), ("linkage_scale", "outer_boom"),
    }  # fmt: skip
    assert small.gain == pytest.approx(large.gain, rel=1e-3)


def values(made: Search, subset: Subset) -> dict[tuple[str, str], float]:
    projection = made.projection
    columns = [int(c) for number in subset.numbers for c in projection.columns_of[number]]
    candidates = [projection.candidates[number].candidate for number in subset.numbers]
    sizes = subset.values / projection.scale[columns]
    return {(one.type, one.where): float(size) for one, size in zip(candidates, sizes, strict=True)}


def test_what_a_survey_leaves_is_usual() -> None:
    made = built({"inner_boom": 1.002, "outer_boom": 0.998})
    why = {(one.type, one.where): said for one, said in made.untestable.items()}
    for joint in ("inner_boom", "outer_boom"):
        assert "does not exceed the usual 0.5%" in why["linkage_scale", joint]
    assert not named(made)


@pytest.mark.parametrize(("formless", "is_slight"), [((), True), ((0,), False)])
def test_beside_what_has_no_form_a_further_effect_is_not_slight(
    formless: tuple[int, ...], is_slight: bool
) -> None:
    places, share = [np.array([0]), np.array([0])], THRESHOLDS.method.further_share
    found = [slight(places, [1000.0, 10.0], share, place, formless) for place in (0, 1)]
    assert found == [False, is_slight]


def test_a_further_effect_gains_a_fiftieth_of_the_strongest_that_has_a_form() -> None:
    law, scale = (
        cast(Judged, Mock(score=score, shaped=made_up.shaped(kind, made_up.normal(1)[:, None])))
        for kind, score in (("coulomb", 1000.0), ("pressure_gain", 5000.0))
    )
    assert left_by_forms([law, scale], THRESHOLDS) == pytest.approx(20.0)
    assert left_by_forms([scale], THRESHOLDS) == 0.0


@pytest.mark.parametrize(("gain", "is_one"), [(0.0045, False), (-0.0045, False), (0.006, True)])
def test_the_gain_of_one_transducer_within_its_class_is_no_finding(
    gain: float, is_one: bool
) -> None:
    """Half a percent, however sure it is."""
    one = cast(Judged, Mock(shaped=made_up.shaped("chamber_gain", made_up.normal(1)[:, None])))
    assert differs(one, [Value("gain_B", gain, 1e-5, "1")], 2.0) is is_one
