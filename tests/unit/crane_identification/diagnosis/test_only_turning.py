"""No shape is drawn over a joint that never moves but close to its reversals, of any effect."""

from dataclasses import replace

import pytest
from unit.crane_identification.synthetic import crane_log, crane_model

from crane_identification import Options
from crane_identification.diagnosis.candidates import Candidate
from crane_identification.diagnosis.evidence import Evidence, gather
from crane_identification.diagnosis.search import Shapes
from crane_identification.preparation.prepare import prepare
from crane_model.terms import REGISTRY
from crane_model.terms.nonparametric import NONPARAMETRIC_TERMS

FACTOR = 20
FOLLOWING = sorted(kind for kind, cls in NONPARAMETRIC_TERMS.items() if cls.variable != "lead")


@pytest.fixture(scope="module")
def evidence() -> Evidence:
    """Of a telescope that turns before it is fast."""
    model = crane_model()
    moving = gather(model, prepare(model, crane_log(3, 1), Options(average=False)), FACTOR)
    used = moving.used.copy()
    used[:, moving.joints.index("telescope")] = False  # of the first zone
    return replace(moving, used=used)


@pytest.mark.parametrize("kind", FOLLOWING)
def test_nothing_is_drawn_over_a_joint_that_only_turns(evidence: Evidence, kind: str) -> None:
    assert Shapes(evidence).of(Candidate(REGISTRY[kind], "telescope")) is None


@pytest.mark.parametrize("kind", ["stribeck", "warm_up"])
def test_another_joint_is_drawn_all_the_same(evidence: Evidence, kind: str) -> None:
    assert Shapes(evidence).of(Candidate(REGISTRY[kind], "outer_boom")) is not None
