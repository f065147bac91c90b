"""Links of other lengths than in the file, on logs of a machine that was built so."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest
from laboratory_crane import with_linkage
from unit.crane_identification.synthetic import crane_log, crane_model

from crane_identification import Options
from crane_identification.diagnosis.candidates import candidates_of
from crane_identification.diagnosis.decision import decide
from crane_identification.diagnosis.evidence import gather
from crane_identification.diagnosis.projection import NOTHING
from crane_identification.diagnosis.search import (
    Search,
    columns_of_lengths,
    search,
)
from crane_identification.diagnosis.selection import ForwardSelection
from crane_identification.preparation.prepare import prepare
from crane_identification.thresholds import load_thresholds
from crane_model import Machine

ASKED = ("linkage_scale", "pressure_gain", "boom_flexibility", "load_friction", "encoder_offset")
SEEDS = range(5)  # of recordings
FACTOR = 20
THRESHOLDS = load_thresholds()


def with_link(machine: Machine, joint: str, factor: float) -> Machine:
    content = machine.model_dump(by_alias=True)
    (row,) = (one["dh"] for one in content["joints"] if one["name"] == joint)
    row["a"] *= factor
    return Machine.model_validate(content)


def built(links: Mapping[str, float], linkages: Mapping[str, float]) -> Search:
    """The search of the file's model in recordings of a machine with lengths times these."""
    model = crane_model()
    machine = model.machine
    for joint, factor in links.items():
        machine = with_link(machine, joint, factor)
    for joint, factor in linkages.items():
        machine = with_linkage(machine, joint, factor)
    actual = replace(model, setting=model.setting._replace(machine=machine))
    recordings = [
        one
        for seed in SEEDS
        for one in prepare(
            model, replace(crane_log(seed, 1, actual), source=str(seed)), Options(average=False)
        )
    ]
    evidence = gather(model, recordings, FACTOR)
    return search(
        evidence, [one for one in candidates_of(model, evidence) if one.type in ASKED], THRESHOLDS
    )


@pytest.fixture(scope="module")
def longer() -> Search:
    return built({"inner_boom": 1.03, "outer_boom": 0.97}, {})


def test_what_links_of_other_lengths_make_is_taken_out(longer: Search) -> None:
    left, beside = (one.unexplained(NOTHING).sum() for one in (longer, longer.beside_lengths()))
    assert left > 1000.0 and beside < 0.02 * left


def test_a_machine_of_its_file_loses_no_candidate_beside_lengths() -> None:
    made = built({}, {})
    beside = made.beside_lengths()
    assert columns_of_lengths(made.evidence).shape[2] == 2  # of two booms
    assert beside.projection.candidates == made.projection.candidates
    assert np.median(beside.projection.visibility / made.projection.visibility) > 0.5


def test_lengths_that_are_off_are_no_other_effect() -> None:
    """Links leave what a boom that bends slowly, or friction, would explain."""
    made = built({"inner_boom": 1.03, "outer_boom": 0.97}, {"inner_boom": 1.03, "outer_boom": 0.98})
    found = decide(ForwardSelection(made)).passed
    kinds = {one.shaped.candidate.type for one in found}
    assert kinds and kinds <= {"linkage_scale", "pressure_gain"}


@pytest.mark.parametrize("links", [{}, {"inner_boom": 1.01, "outer_boom": 0.995}])
def test_a_scale_that_lengths_explain_as_well_is_not_named_alone(links: dict[str, float]) -> None:
    """Two linkages that are 1 % larger scale the forces as a gain on the third joint does."""
    made = built(links, {"inner_boom": 1.01, "outer_boom": 1.01})
    found = decide(ForwardSelection(made)).passed
    groups = [{one.shaped.candidate, *one.indistinct} for one in found]
    assert groups
    for group in groups:
        assert any(member.type == "linkage_scale" for member in group)
