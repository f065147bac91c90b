"""What a diagnosis leaves open."""

from types import SimpleNamespace

import numpy as np
import pytest

from crane_identification.diagnosis.candidates import Candidate, ShapedCandidate
from crane_identification.diagnosis.diagnosis import _open_questions
from crane_identification.diagnosis.findings import Verdict
from crane_identification.diagnosis.projection import Projection
from crane_identification.diagnosis.search import Search
from crane_identification.thresholds import load_thresholds
from crane_model.result_file import QuestionKind
from crane_model.terms import REGISTRY

A, B = np.eye(2)
COLUMNS = {"load_friction": B - 0.2 * A, "seal_friction": A - B, "hose_stiffness": A}


def candidate(kind: str) -> ShapedCandidate:
    term = REGISTRY[kind].model_validate({"type": kind, "joint": "axis"})
    return ShapedCandidate(
        Candidate(type(term), "axis"), {}, term, np.zeros((0, 1, 1)), np.array([True])
    )


def test_member_of_a_class_that_explains_it_without_the_other_effects() -> None:
    """Friction by load would be negative without seal friction: hoses stand there alone."""
    made = [candidate(kind) for kind in COLUMNS]
    norms = np.array([np.linalg.norm(column) for column in COLUMNS.values()])
    projection = Projection(
        candidates=tuple(made),
        columns=np.stack(list(COLUMNS.values()), axis=1) / norms,
        residual=A,
        owner=np.arange(len(made)),
        positive=np.ones(len(made), dtype=bool),
        scale=norms,
        visibility=np.ones(len(made)),
    )
    load, seal, hoses = made
    effects = [
        SimpleNamespace(shaped=load, indistinct=[], threshold=9.0),
        SimpleNamespace(shaped=seal, indistinct=[hoses.candidate], threshold=9.0),
    ]
    white = SimpleNamespace(noise=[None])
    diagnosis = SimpleNamespace(
        joints=("axis",),
        verdict=Verdict.NAMED,
        search=Search(None, load_thresholds(), white, None, projection, {}, {}),  # type: ignore[arg-type]
        proof=SimpleNamespace(trial=SimpleNamespace(effects=effects)),
        fit=SimpleNamespace(
            training=SimpleNamespace(recordings=[SimpleNamespace(step=0.001)], factor=10),
            left_out=[],
        ),
        training=None,
        before=SimpleNamespace(setting=None),
        decision=SimpleNamespace(threshold=9.0),
    )

    (question,) = _open_questions(diagnosis).questions  # type: ignore[arg-type]

    assert question.kind is QuestionKind.AMBIGUOUS
    assert [member.effect for member in question.members] == ["seal_friction", "hose_stiffness"]
    assert question.members[0].values == pytest.approx([1.25])
    assert question.members[1].values == pytest.approx([1.0])
    assert question.members[1].separation == pytest.approx(0.0, abs=1e-6)
