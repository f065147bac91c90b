"""What is said of a joint on which none of the named effects acts, on logs of a crane."""

from dataclasses import replace
from typing import cast
from unittest.mock import Mock

import numpy as np
from unit.crane_identification.diagnosis.test_verdict import AFTER, gap
from unit.crane_identification.diagnosis.test_verdict import answer as answered
from unit.crane_identification.synthetic import crane_log, crane_model

from crane_identification import Options
from crane_identification.diagnosis.answer import with_left
from crane_identification.diagnosis.candidates import candidates_of
from crane_identification.diagnosis.evidence import gather
from crane_identification.diagnosis.findings import NearbySignature, UnknownPlace, Verdict
from crane_identification.diagnosis.judgement import Judged
from crane_identification.diagnosis.residuals import left_elsewhere
from crane_identification.diagnosis.search import search
from crane_identification.diagnosis.words import unknown_title
from crane_identification.preparation.prepare import prepare
from crane_identification.thresholds import load_thresholds

THRESHOLDS = load_thresholds()
ASKED = ("pressure_offset", "hose_stiffness")
THRESHOLD = 50.0  # of the best of the catalogue
FACTOR = 20
OUTER, TELESCOPE = 1, 2


OFFSET = ("pressure_offset", "outer_boom")


def left(of_spring: float, named: tuple[str, str] = OFFSET) -> list[UnknownPlace]:
    """Chamber A of the outer boom reads too much, and the telescope bends a hose to so much [Pa];
    one effect is `named`.
    """
    model = crane_model()
    recordings = []
    for seed in range(5):
        log = crane_log(seed, 1)
        assert log.pressure_a is not None
        pressure = log.pressure_a.value.copy()
        pressure[:, OUTER] += 3e5
        q = np.interp(log.pressure_a.time, log.position.time, log.position.value[:, TELESCOPE])
        pressure[:, TELESCOPE] += of_spring * (q - q.mean()) / q.std()
        wrong = replace(log, source=str(seed), pressure_a=replace(log.pressure_a, value=pressure))
        recordings += prepare(model, wrong, Options(average=False))
    evidence = gather(model, recordings, FACTOR)
    asked = [one for one in candidates_of(model, evidence) if one.type in ASKED]
    made = search(evidence, asked, THRESHOLDS)
    of = [
        one
        for one in made.projection.candidates
        if (one.candidate.type, one.candidate.joint) == named
    ]
    return left_elsewhere(made, [cast(Judged, Mock(shaped=of[0]))], THRESHOLD)


def test_what_is_left_elsewhere_has_its_joint_size_and_signature() -> None:
    (one,) = left(2e5)
    assert one.joint == "telescope"
    assert one.signatures[0].effects == ["hose_stiffness"]
    assert (one.signatures[0].explained_share or 0.0) > 0.9
    (half,) = left(1e5)
    assert 0.01 < half.relative_magnitude < one.relative_magnitude


def test_nothing_is_left_where_named_effects_are_all() -> None:
    assert left(0.0) == []
    assert [one.joint for one in left(0.0, ("hose_stiffness", "telescope"))] == ["outer_boom"]


def test_what_is_left_elsewhere_is_said_beside_the_names() -> None:
    found = answered(AFTER, gap(0.0113, 0.004))
    assert found.verdict is Verdict.AND_MORE and with_left(found, ()) == found
    signature = NearbySignature.model_construct(signature="a force over the position")
    force = UnknownPlace(
        joint="telescope",
        relative_magnitude=0.0123,
        signatures=[signature],
        recordings={},
        difference=None,
    )
    said = with_left(found, (force,))
    assert said.verdict is Verdict.AND_MORE and said.unknown == force
    assert said.reason.endswith(
        "where none of the effects acts, 1.23% of the drive force of telescope are left, most like "
        "a force over the position"
    )
    place = {"joint": "telescope", "relative_magnitude": 0.0123}
    assert unknown_title({"unknown": place, "findings": [{}]}).startswith(
        "What the remaining error may depend"
    )
