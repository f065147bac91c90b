"""A weak effect on another joint than a stronger one, and bodies that both joints move."""

import numpy as np
import pytest
from unit.crane_identification.diagnosis.made import MASS, ROWS, normal, search

from crane_identification.diagnosis.decision.apart import shows_alone
from crane_identification.diagnosis.decision.form import of_one_form
from crane_identification.diagnosis.decision.judgement import marginal
from crane_identification.diagnosis.fit.evidence import Evidence
from crane_identification.diagnosis.search.candidates import Candidate, ShapedCandidate
from crane_identification.diagnosis.search.search import Search
from crane_identification.diagnosis.search.selection import solve
from crane_identification.thresholds import load_thresholds
from crane_model.model_file import Model
from crane_model.terms import REGISTRY, Setting, single_axis

THRESHOLDS = load_thresholds()
CHANCE = 20.0  # score that chance gives to the best effect
MODEL = Model("two axes", Setting({"a": "m", "b": "m"}, None), (single_axis.Inertia(joint="a"),))
ON_A, ON_B = normal(1), normal(2)  # columns of the strong effect, and of the weak one
MASS_A, MASS_B = normal(3), normal(4)  # columns of one mass, which both joints move


def channels(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """What two joints have while they move (n,) each; no row is close to a reversal."""
    return np.stack([a, b, np.zeros(ROWS), np.zeros(ROWS)], axis=1)


def candidate(kind: str, joint: str, column: np.ndarray, also: float = 0.0) -> ShapedCandidate:
    """An effect of a joint that is felt on the other one, too, by that share."""
    own, other = column, also * column
    there = channels(*((own, other) if joint == "a" else (other, own)))[:, :, np.newaxis]
    one = Candidate(REGISTRY[kind], joint)
    return ShapedCandidate(one, {}, one.at({}), there, np.array([False]))


def searched(on_a: np.ndarray, on_b: np.ndarray, *candidates: ShapedCandidate) -> Search:
    """Both joints lack something beside the mass that they share; recordings of 100 rows."""
    moving = channels(np.ones(ROWS), np.ones(ROWS)) > 0.0
    run = np.arange(ROWS) // 100
    force = channels(MASS * MASS_A + on_a + normal(5), MASS * MASS_B + on_b + normal(6))
    base = channels(MASS_A, MASS_B)[:, :, np.newaxis]
    time = 0.1 * np.arange(ROWS)
    return search(Evidence(MODEL, (), time, run, run, force, base, moving), candidates)


def weighed(made: Search) -> tuple[bool, bool]:
    """Whether the second effect shows alone, and whether the set is of one form."""
    subset = solve(made.projection, (0, 1))
    assert subset is not None
    gains = marginal(made, subset)
    assert CHANCE < gains[1] < THRESHOLDS.method.elsewhere_share * gains[0]
    alone = shows_alone(made, subset, gains, 1, CHANCE, THRESHOLDS)
    return alone, of_one_form(made, subset, CHANCE, THRESHOLDS)


def test_a_weak_effect_shows_beside_bodies_of_its_own_joint() -> None:
    made = searched(
        10.0 * ON_A,
        0.5 * ON_B,
        candidate("hose_stiffness", "a", ON_A),
        candidate("actuator_inertia", "b", ON_B),
    )
    assert weighed(made) == (True, False)


def test_what_a_law_leaves_through_a_mass_that_joints_share_does_not() -> None:
    """The force on the first joint asks for a larger mass than that on the second one."""
    like_mass = MASS_B + 0.2 * ON_B
    made = searched(
        10.0 * ON_A + 1.5 * MASS_A,
        np.zeros(ROWS),
        candidate("hose_stiffness", "a", ON_A),
        candidate("actuator_inertia", "b", like_mass),
    )
    assert weighed(made) == (False, True)


@pytest.mark.parametrize(
    ("joint", "also"),
    [
        ("a", 0.0),  # on the joint of the strong effect
        ("b", 0.5),  # felt on both
    ],
)
def test_only_an_effect_of_one_joint_that_no_stronger_law_is_on(joint: str, also: float) -> None:
    weak = candidate("actuator_inertia", joint, ON_B, also)
    missing = 0.5 * weak.columns[:, :2, 0]
    made = searched(
        10.0 * ON_A + missing[:, 0],
        missing[:, 1],
        candidate("hose_stiffness", "a", ON_A),
        weak,
    )
    assert weighed(made)[0] is False
