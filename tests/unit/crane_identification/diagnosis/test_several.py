"""Physics that several joints lack at once: three joints at least, one kind or two, no alias."""

from collections.abc import Mapping

import numpy as np
import pytest
from unit.crane_identification.diagnosis.made import MASS, ROWS, evidence, normal, search

from crane_identification.diagnosis.candidates import Candidate, ShapedCandidate
from crane_identification.diagnosis.decision import decide
from crane_identification.diagnosis.judgement import by_chance
from crane_identification.diagnosis.projection import NOTHING
from crane_identification.diagnosis.search import Search
from crane_identification.diagnosis.selection import ForwardSelection
from crane_identification.diagnosis.several import on_several_joints
from crane_identification.thresholds import load_thresholds
from crane_model.terms import REGISTRY

THRESHOLDS = load_thresholds()
JOINTS = "abcd"
Columns = Mapping[tuple[str, str], np.ndarray]
COULOMB: Columns = {("coulomb", joint): normal(10 + i) for i, joint in enumerate(JOINTS)}
VISCOUS: Columns = {("viscous", joint): normal(20 + i) for i, joint in enumerate(JOINTS)}


def asked(columns: Columns, missing: np.ndarray) -> Search:
    """Candidates on four joints, whose columns stand side by side in the rows of one axis."""
    base = normal(99)
    force = MASS * base + missing + normal(100)
    candidates = []
    for (kind, joint), column in columns.items():
        candidate = Candidate(REGISTRY[kind], joint)
        there = np.stack([column, np.zeros(ROWS)], axis=1)[:, :, np.newaxis]
        candidates.append(ShapedCandidate(candidate, {}, candidate.at({}), there, np.array([True])))
    return search(evidence(force, base[:, np.newaxis]), candidates)


def lacking(made: Search) -> set[str]:
    threshold = by_chance(made, NOTHING)
    found = on_several_joints(made, threshold)
    return {made.projection.candidates[number].candidate.label for number in found.numbers}


def named(made: Search) -> dict[str, int]:
    """What a decision names, and how many others cannot be told from it."""
    found = decide(ForwardSelection(made)).passed
    return {one.shaped.candidate.label: len(one.indistinct) for one in found}


def total(columns: Columns, sizes: Mapping[tuple[str, str], float]) -> np.ndarray:
    return np.sum([size * columns[one] for one, size in sizes.items()], axis=0)


def sizes(kind: str, *values: float) -> dict[tuple[str, str], float]:
    return {(kind, joint): value for joint, value in zip(JOINTS, values, strict=False)}


def test_a_kind_that_all_joints_lack_is_found_on_all() -> None:
    columns = {**COULOMB, **VISCOUS}
    missing = total(columns, sizes("coulomb", 3.0, 2.0, 1.0, 0.5))
    assert lacking(asked(columns, missing)) == {f"Coulomb friction ({joint})" for joint in JOINTS}


def test_a_joint_that_lacks_little_is_found_beside_others_that_lack_much() -> None:
    """The weakest explains less than a thousandth of what the strongest does."""
    missing = total(COULOMB, sizes("coulomb", 30.0, 20.0, 10.0, 0.6))
    assert set(named(asked(COULOMB, missing))) == {f"Coulomb friction ({one})" for one in JOINTS}


def test_two_kinds_at_once_are_both_found_where_they_are() -> None:
    """More effects than a selection of single ones goes through; one joint lacks one of them."""
    columns = {**COULOMB, **VISCOUS}
    missing = total(columns, sizes("coulomb", 3, 2, 2, 1) | sizes("viscous", 2, 2, 1, 0))
    assert named(asked(columns, missing)) == {
        **{f"Coulomb friction ({joint})": 0 for joint in "abcd"},
        **{f"viscous friction ({joint})": 0 for joint in "abc"},
    }


@pytest.mark.parametrize("count", [1, 2])
def test_fewer_than_three_joints_are_for_the_race(count: int) -> None:
    made = asked(COULOMB, total(COULOMB, sizes("coulomb", *([2.0] * count))))
    assert not lacking(made)
    assert set(named(made)) == {f"Coulomb friction ({joint})" for joint in JOINTS[:count]}


def test_what_any_machine_has_a_little_of_is_no_kind_that_all_joints_lack() -> None:
    """Gains of all transducers come near to lengths that are off."""
    gains = {("chamber_gain", joint): column for (_, joint), column in COULOMB.items()}
    assert not lacking(asked(gains, total(gains, sizes("chamber_gain", 3.0, 2.0, 1.0, 1.0))))


def test_one_effect_is_not_taken_for_what_several_joints_would_lack() -> None:
    """Shared bodies let friction of three joints together stand for most of one other effect."""
    one = np.sum([COULOMB["coulomb", joint] for joint in "abc"], axis=0) / np.sqrt(3.0)
    columns = {**COULOMB, ("hose_stiffness", "d"): one + 0.1 * normal(30)}
    made = asked(columns, 4.0 * columns["hose_stiffness", "d"])
    assert len(lacking(made)) == 3
    assert set(named(made)) == {"hose stiffness (d)"}


@pytest.mark.parametrize(("joints", "classes"), [("a", 0), ("abcd", 1)])
def test_a_rival_has_to_stand_in_on_all_joints(joints: str, classes: int) -> None:
    """What one joint alone does not tell apart, the others do."""
    alike = {
        ("hose_stiffness", joint): 0.9999 * COULOMB["coulomb", joint] + 0.01 * normal(40 + i)
        for i, joint in enumerate(joints)
    }
    columns = {**COULOMB, **alike}
    found = named(asked(columns, total(columns, sizes("coulomb", 1.0, 1.0, 1.0, 1.0))))
    assert [label[-2] for label in sorted(found)] == list(JOINTS)
    assert set(found.values()) == {classes}


def test_a_joint_is_asked_on_held_out_rows_together_with_its_kind() -> None:
    """What friction of one joint gains in a third of the time is turned: it alone would fail."""
    turned = np.where(np.arange(ROWS) < ROWS // 3, -0.5, 1.0)
    missing = total(COULOMB, sizes("coulomb", 2.0, 2.0, 2.0))
    missing = missing + turned * COULOMB["coulomb", "d"]
    assert set(named(asked(COULOMB, missing))) == {f"Coulomb friction ({one})" for one in JOINTS}
    alone = {("coulomb", "d"): COULOMB["coulomb", "d"]}
    assert not named(asked(alone, turned * alone["coulomb", "d"]))
