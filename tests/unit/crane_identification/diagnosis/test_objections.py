"""Why effects that passed in training are no names, on facts made up for the purpose."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from unit.crane_identification.diagnosis.test_verdict import BEFORE, THRESHOLDS, effect, gap, trial

from crane_identification.diagnosis.decision.judgement import Judged
from crane_identification.diagnosis.proof import proof
from crane_identification.diagnosis.proof.gap import Gap
from crane_identification.diagnosis.proof.proof import objection, resemblance, unmoved


@pytest.mark.parametrize(
    ("energy", "share", "left", "resembles"),
    [(3000.0, 0.9, 0.6, True), (3000.0, 0.9, 0.4, False), (2000.0, 0.9, 0.6, False)]
    + [(3000.0, 0.0, 0.6, False)],
)
def test_an_effect_that_leaves_most_of_a_law_is_no_name(
    energy: float, share: float, left: float, resembles: bool
) -> None:
    """Of 5000, of which a learner is sure of a share of the rest."""
    said = resemblance(trial(effect(), energy=energy, share=share, left=left), BEFORE, THRESHOLDS)
    assert bool(said) is resembles
    assert not resembles or "it explains 43% of what can be explained and leaves 60%" in said


@pytest.mark.parametrize(
    ("seen", "closes"),
    [
        (gap(0.0113, 0.0006), True),
        (gap(0.0113, 0.004), True),  # 88 % of the energy
        (gap(0.0113, 0.0088), False),  # 40 %
        (gap(0.0014, 0.0009), True),  # what is left may be noise
        (gap(0.0005, 0.0005), True),  # there is no gap
        (gap(0.0005, 0.0006), False),
        (gap(0.2632, 0.2633, floor=np.nan), False),  # far from noise, and it closes nothing
    ],
)
def test_a_name_closes_the_gap_on_held_out_recordings(seen: Gap, closes: bool) -> None:
    shaped = effect("stribeck", shape={"speed": 0.1, "exponent": 1.0})
    assert (objection(shaped, seen, THRESHOLDS) == "") is closes


@pytest.mark.parametrize(
    ("one", "closes"),
    [
        (effect(), True),
        (effect("stribeck", shape={"speed": 0.1, "exponent": 1.0}), True),
        (replace(effect("stribeck", shape={"speed": 0.1, "exponent": 1.0}), margin=400.0), False),
        (effect(indistinct=("seal_friction",)), False),
        (replace(effect(), held_out=np.array([1.0, 1.0, -1.0, 1.0])), False),
    ],
)
def test_half_of_the_gap_is_enough_for_what_nothing_resembles(one: Judged, closes: bool) -> None:
    """Bent by its shape, it explains 1000, and the next one 100 or 600."""
    assert (objection(one, gap(0.0113, 0.007), THRESHOLDS) == "") is closes


def test_an_effect_that_widens_the_gap_is_said_to() -> None:
    """In place of a share that is negative."""
    said = objection(effect(), gap(0.0113, 0.0124), THRESHOLDS)
    assert said.startswith("with it, the held-out error of outer_boom rises from 1.13% to 1.24%")
    none = objection(effect(), gap(0.0005, 0.0006), THRESHOLDS)
    assert none == "with it, the held-out error of outer_boom rises from 0.05% to 0.06%"
    assert "it closes 3" in objection(effect(), gap(0.0113, 0.0094), THRESHOLDS)


@pytest.mark.parametrize(("after", "names"), [(0.0010, True), (0.00125, True), (0.00130, False)])
def test_a_further_effect_leaves_less_where_it_acts(after: float, names: bool) -> None:
    """13 % less of the energy, and 6 %."""
    nothing: Any = None  # no scale
    said = unmoved(nothing, nothing, nothing, effect(), gap(0.00134, after), THRESHOLDS)
    assert (said == "") is names
    if said:
        assert said.startswith("with it, the held-out error of outer_boom stays at 0.13%")


@pytest.mark.parametrize(("without", "names"), [(0.0006, True), (0.00051, False)])
def test_a_scale_counts_where_it_moves_the_same_bodies(
    monkeypatch: pytest.MonkeyPatch, without: float, names: bool
) -> None:
    """It leaves as much on its own joint, and 0.05 % on the telescope, with it."""
    monkeypatch.setattr(proof, "held_out_error", lambda *_: np.array([0.0005, 0.001, without]))
    trial: Any = SimpleNamespace(effects=())
    nothing: Any = None
    seen = gap(0.001, 0.001)
    for kind in ("linkage_scale", "load_friction"):
        said = unmoved(nothing, nothing, trial, effect(kind), seen, THRESHOLDS)
        assert (said == "") is (names and kind == "linkage_scale")
