"""When effects are alike, and when a further effect is but the form of another one."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from crane_identification.diagnosis.candidates import Candidate, ShapedCandidate
from crane_identification.diagnosis.judgement import likeness
from crane_identification.diagnosis.lookalikes import slight
from crane_identification.diagnosis.projection import Projection
from crane_identification.thresholds import load_thresholds
from crane_model.terms import REGISTRY, Term

ONE, OTHER, BOTH = np.array([0, 3]), np.array([1, 4]), np.array([0, 1, 3, 4])
"""Channels of two joints, and of an effect of the whole machine."""
ROWS = 400
A, B, C = np.linalg.qr(np.random.default_rng(1).standard_normal((ROWS, 3)))[0].T
THRESHOLDS = load_thresholds()


@pytest.mark.parametrize(
    ("channels", "gains", "expected"),
    [
        ((ONE,), (100.0,), False),
        ((ONE, ONE), (1000.0, 60.0), False),
        ((ONE, ONE), (1000.0, 40.0), True),  # less than a twentieth of the other on its joint
        ((ONE, OTHER), (1000.0, 40.0), False),
        ((ONE, OTHER), (1000.0, 15.0), False),
        ((ONE, BOTH), (1000.0, 40.0), True),
        ((ONE, OTHER, OTHER), (1000.0, 600.0, 25.0), True),
    ],
)
def test_further_effects_gain_more_on_a_joint_that_has_one(channels, gains, expected):
    share, every = THRESHOLDS.method.further_share, range(len(gains))
    assert any(slight(channels, gains, share, place) for place in every) is expected


def search_over(*candidates: tuple[Term, list[np.ndarray], bool]) -> Any:
    """Candidates of these columns, whose parameters must not be negative where so said."""
    counts = [len(columns) for _, columns, _ in candidates]
    made = tuple(
        ShapedCandidate(
            Candidate(type(term), "axis"), {}, term, np.zeros((0, 1, n)), np.full(n, positive)
        )
        for (term, _, positive), n in zip(candidates, counts, strict=True)
    )
    stacked = np.stack([values for _, columns, _ in candidates for values in columns], axis=1)
    projection = Projection(
        candidates=made,
        columns=stacked / np.linalg.norm(stacked, axis=0),
        residual=np.zeros(ROWS),
        owner=np.repeat(np.arange(len(made)), counts),
        positive=np.concatenate([one.positive for one in made]),
        scale=np.ones(sum(counts)),
        visibility=np.ones(len(made)),
    )
    return SimpleNamespace(projection=projection)


def term(kind: str, **shape: float) -> Term:
    return REGISTRY[kind].model_validate({"type": kind, "joint": "axis", **shape})


@pytest.mark.parametrize(
    ("one", "other", "signed", "expected"),
    [
        ([A], [A + 0.1 * B], False, 0.995),
        ([A], [-A], False, 1.0),
        ([A], [-A], True, 0.0),
        ([A - B], [A, B], False, 1.0),
        ([A - B], [A, B], True, np.sqrt(0.5)),  # friction by load, and by the pressures
        ([A + B], [A, B], True, 1.0),
        ([A, B], [A, C], False, 0.0),
        ([A, B], [A, A + C], True, 0.0),
    ],
)
def test_likeness_respects_signs(one, other, signed: bool, expected: float) -> None:
    made = search_over((term("load_friction"), one, signed), (term("seal_friction"), other, signed))
    assert likeness(made, 0, [1])[0] == pytest.approx(expected, abs=1e-3)
    assert likeness(made, 1, [0])[0] == pytest.approx(expected, abs=1e-3)
