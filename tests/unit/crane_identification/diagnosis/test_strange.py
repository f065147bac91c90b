"""Transducers of no catalogue on logs of a crane: bent ones, and one that hears another joint."""

from collections.abc import Callable
from dataclasses import replace
from typing import cast
from unittest.mock import Mock

import numpy as np
import pytest
from laboratory_crane import with_linkage
from unit.crane_identification.diagnosis import made
from unit.crane_identification.diagnosis.test_lengths import with_link
from unit.crane_identification.synthetic import crane_log, crane_model

from crane_identification import Options
from crane_identification.diagnosis.candidates import Candidate, candidates_of
from crane_identification.diagnosis.decision import Decision, decide
from crane_identification.diagnosis.evidence import gather
from crane_identification.diagnosis.judgement import Judged
from crane_identification.diagnosis.lookalikes import (
    is_of_lengths,
    suspected,
    with_strange,
)
from crane_identification.diagnosis.search import (
    ForceSignature,
    Search,
    Shapes,
    search,
)
from crane_identification.diagnosis.selection import ForwardSelection
from crane_identification.diagnosis.several import factors
from crane_identification.preparation.prepare import prepare
from crane_identification.thresholds import load_thresholds
from crane_model import Machine
from crane_model.terms import REGISTRY

THRESHOLDS = load_thresholds()
ASKED = ("pressure_offset", "chamber_gain", "linkage_scale", "pressure_gain", "time_skew")
SEEDS = range(5)  # of recordings
FACTOR = 20
INNER, OUTER = range(2)

Shown = Callable[[np.ndarray], np.ndarray]


def searched(joint: int, shown: Shown, machine: Machine | None = None) -> Search:
    """What chamber A of a joint shows is that of the pressures (n, 3) of all three; the `machine`
    is another one than in its file.
    """
    model = crane_model()
    actual = replace(model, setting=model.setting._replace(machine=machine or model.machine))
    recordings = []
    for seed in SEEDS:
        log = crane_log(seed, 1, actual)
        assert log.pressure_a is not None
        pressure = log.pressure_a.value.copy()
        pressure[:, joint] = shown(log.pressure_a.value)
        wrong = replace(log, source=str(seed), pressure_a=replace(log.pressure_a, value=pressure))
        recordings += prepare(model, wrong, Options(average=False))
    evidence = gather(model, recordings, FACTOR)
    asked = [one for one in candidates_of(model, evidence) if one.type in ASKED]
    return search(evidence, asked, THRESHOLDS)


def decided(joint: int, shown: Shown, machine: Machine | None = None) -> Decision:
    return decide(ForwardSelection(searched(joint, shown, machine)))


def larger(**factors: float) -> Machine:
    """A machine whose linkages are larger than in its file."""
    machine = crane_model().machine
    for joint, factor in factors.items():
        machine = with_linkage(machine, joint, factor)
    return machine


@pytest.mark.parametrize(("share", "knee"), [(0.02, 5e6), (0.15, 6e6)])
def test_a_transducer_that_gives_way_is_no_gain(share: float, knee: float) -> None:
    """Less steep beyond some pressure: no parabola, so that its own law is not what finds it."""
    found = decided(INNER, lambda p: p[:, INNER] - share * np.maximum(p[:, INNER] - knee, 0.0))
    (one,) = found.beyond
    assert one.joint == "inner_boom"
    assert one.signature.startswith("a force that bends with the pressure")
    assert not found.passed


def test_what_a_transducer_hears_of_another_joint_is_no_offset() -> None:
    found = decided(OUTER, lambda p: p[:, OUTER] + 0.05 * p[:, INNER])
    assert found.beyond[0].joint == "outer_boom"
    assert "a force that follows the pressures of another" in found.beyond[0].signature
    assert not found.passed


def test_a_bent_transducer_shows_beside_linkages_of_another_size() -> None:
    """The scale of its own joint is found because of it, as that explains little beside it."""
    machine = larger(inner_boom=1.02, outer_boom=0.98)
    found = decided(INNER, lambda p: p[:, INNER] - 2.0 * p[:, INNER] ** 3 / 1e15, machine)
    assert found.beyond[0].joint == "inner_boom"
    assert "a force that bends with the pressure" in found.beyond[0].signature
    assert "inner_boom" not in {one.shaped.candidate.joint for one in found.passed}


def test_linkages_of_another_size_alone_are_not_strange() -> None:
    found = decided(INNER, lambda p: p[:, INNER], larger(inner_boom=1.02, outer_boom=0.98))
    assert len(found.passed) == 2
    assert not found.beyond


def bends(made: Search, known: list[np.ndarray]) -> bool:
    """Whether lengths leave what bends most with pressures of the inner boom, beside the known."""
    bending = [one for one in made.shapes.unlisted_signatures("inner_boom") if "bends" in one.said]
    leads = [made.gained(known, one.columns) for one in bending]
    lead = max(leads)
    one = bending[leads.index(lead)]
    assert lead > 100.0
    return is_of_lengths(made, known, one.columns)


def test_what_lengths_that_are_off_leave_bends_with_a_pressure() -> None:
    machine = crane_model().machine
    for joint, factor in {"inner_boom": 1.03, "outer_boom": 0.97}.items():
        machine = with_linkage(with_link(machine, joint, factor), joint, factor)
    assert bends(searched(INNER, lambda p: p[:, INNER], machine), [])


def test_lengths_leave_nothing_like_a_transducer_that_gives_way() -> None:
    """Beside the gain that stands for most of it."""
    made = searched(INNER, lambda p: p[:, INNER] - 0.1 * np.maximum(p[:, INNER] - 6e6, 0.0))
    scale = made.projection.candidates[factors(made)[0]]
    assert scale.candidate.label.endswith("(inner_boom)")
    assert not bends(made, [scale.columns])


@pytest.mark.parametrize("joint", [INNER, OUTER])
def test_a_gain_is_not_strange(joint: int) -> None:
    found = decided(joint, lambda p: 1.03 * p[:, joint])
    assert not found.beyond
    assert [one.shaped.candidate.joint for one in found.passed] == [crane_model().joints[joint]]


def test_nothing_is_strange_where_nothing_is_missing() -> None:
    found = decided(OUTER, lambda p: p[:, OUTER])
    assert not found.beyond
    assert not found.passed


@pytest.mark.parametrize(
    ("found", "sensors"),
    [
        ([("linkage_scale", "inner_boom")], True),
        ([("linkage_scale", "inner_boom"), ("pressure_gain", "telescope")], False),
        ([("chamber_gain", "inner_boom"), ("pressure_gain", "telescope")], True),
        ([("coulomb", "inner_boom"), ("pressure_gain", "telescope")], False),
    ],
)
def test_lengths_that_are_off_suspect_no_transducer(
    found: list[tuple[str, str]], sensors: bool
) -> None:
    """One may be that of a bent transducer; of two joints at once, they are of the file."""
    candidates = [Candidate(REGISTRY[kind], joint) for kind, joint in found]
    several = [cast(Judged, Mock(shaped=Mock(candidate=one))) for one in candidates]
    assert suspected(several, "inner_boom") is sensors


@pytest.mark.parametrize(("law", "kept"), [(1e3, True), (1e5, False)])
def test_little_of_a_strong_effect_is_the_form_of_its_law(law: float, kept: bool) -> None:
    """A force that no effect makes gains some hundreds beside one of that score on its joint."""
    made_up = made.searched({"hose_stiffness": made.normal(1)}, 3.0 * made.normal(2))
    term = REGISTRY["relaxing_force"].model_validate({"type": "relaxing_force", "joint": "axis"})
    columns = np.stack([made.normal(2), np.zeros(made.ROWS)], axis=1)[:, :, np.newaxis]
    strange = ForceSignature("it fades", (), term, columns)
    known = replace(made_up, shapes=Shapes(made_up.evidence, strange={"axis": (strange,)}))
    shaped = known.projection.candidates[0]
    found = cast(Judged, Mock(shaped=shaped, score=law))
    beyond = with_strange(known, [found], 50.0)[1]
    assert bool(beyond) is kept
