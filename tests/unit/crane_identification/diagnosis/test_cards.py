"""Evidence cards: what their pictures say and how far their axes reach."""

import numpy as np
import pytest

from crane_identification.diagnosis.evidence import counted
from crane_identification.diagnosis.page import folds, span
from crane_identification.diagnosis.residuals import feature_unit, unit_of
from crane_model import load_model
from crane_model.machine_files import machine_file

FIVE_GOOD = np.array([310.0, 290.0, 305.0, 280.0, 315.0, -1.5e10])
BAGS = tuple(f"bag_{i}" for i in range(6))


def test_one_fold_that_explodes_does_not_stretch_the_axis() -> None:
    ends = span(FIVE_GOOD)
    assert ends is not None
    low, high = ends
    assert -2000.0 < low < -300.0 and high == 315.0
    axis = folds(1, BAGS, FIVE_GOOD, set(BAGS)).description["layout"]["yaxis"]
    assert axis["range"] == [low, high] and axis["autorange"] is False
    assert span(FIVE_GOOD[:5]) is None and span(np.full(3, np.nan)) is None


def test_an_axis_that_is_cut_says_so() -> None:
    picture = folds(1, BAGS, FIVE_GOOD, set(BAGS))
    assert "The axis is cut: 6 reaches −1.50·10¹⁰." in picture.caption


def test_folds_of_training_recordings_are_called_that() -> None:
    gains = np.array([1.0, 2.0, np.nan])
    picture = folds(1, BAGS[:3], gains, set(BAGS))
    assert "each training recording, left out of the fit in turn" in picture.caption
    assert "Not tested: 3" in picture.caption
    assert picture.words == "Gains: 1.00, 2.00, not tested."
    axis = picture.description["layout"]["xaxis"]["title"]["text"]
    assert axis == "training recording left out of the fit"
    blocks = folds(1, ("block 1 of 3", "block 2 of 3", "block 3 of 3"), gains, set(BAGS))
    assert "each part of the training data" in blocks.caption


@pytest.mark.parametrize(
    ("feature", "unit"),
    [
        ("position of telescope", "m"),
        ("velocity of outer_boom", "rad/s"),
        ("displacement of outer_boom since the reversal", "rad"),
        ("force of telescope", "N"),
        ("pressure sum of outer_boom", "Pa"),
        ("valve command of outer_boom", "1"),
        ("slew velocity", "rad/s"),
        ("temperature", "°C"),
        ("time", "s"),
    ],
)
def test_every_quantity_of_a_learner_has_a_unit(feature: str, unit: str) -> None:
    setting = load_model(machine_file("model.yaml")).setting
    assert feature_unit(feature, setting) == unit
    assert counted(unit) == (unit if unit in ("1", "s", "°C") else "counts")
    assert unit_of("rate of the force", "outer_boom", setting) == "N m/s"
