"""Why effects that passed in training are no names, on facts made up for the purpose."""

from dataclasses import replace

import numpy as np
import pytest
from unit.crane_identification.diagnosis.test_verdict import effect, gap

from crane_identification.diagnosis.answer import objection_told
from crane_identification.diagnosis.gap import Gap
from crane_identification.diagnosis.judgement import Judged, Rejection
from crane_identification.diagnosis.proof import objection


def told(why: Rejection | None) -> str:
    assert why is not None
    return objection_told([why])


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
    assert (objection(shaped, seen) is None) is closes


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
    assert (objection(one, gap(0.0113, 0.007)) is None) is closes


def test_an_effect_that_widens_the_gap_is_said_to() -> None:
    """In place of a share that is negative."""
    said = told(objection(effect(), gap(0.0113, 0.0124)))
    assert said.startswith("with it, the held-out error of outer_boom rises from 1.13% to 1.24%")
    none = told(objection(effect(), gap(0.0005, 0.0006)))
    assert none == "with it, the held-out error of outer_boom rises from 0.05% to 0.06%"
    assert "it removes 3" in told(objection(effect(), gap(0.0113, 0.0094)))
