"""When a further effect is but the form of another one."""

import numpy as np
import pytest

from crane_identification.discrepancy.rivals import slight
from crane_identification.discrepancy.thresholds import load_thresholds

ONE, OTHER, BOTH = np.array([0, 3]), np.array([1, 4]), np.array([0, 1, 3, 4])
"""Channels of two joints, and of an effect of the whole machine."""


@pytest.mark.parametrize(
    ("channels", "gains", "expected"),
    [
        ((ONE,), (100.0,), False),
        ((ONE, ONE), (1000.0, 60.0), False),
        ((ONE, ONE), (1000.0, 40.0), True),  # less than a twentieth of the other on its joint
        ((ONE, OTHER), (1000.0, 40.0), False),
        ((ONE, OTHER), (1000.0, 15.0), True),  # less than a fiftieth of the other elsewhere
        ((ONE, BOTH), (1000.0, 40.0), True),
        ((ONE, OTHER, OTHER), (1000.0, 600.0, 25.0), True),
    ],
)
def test_further_effects_gain_more_on_a_joint_that_has_one(channels, gains, expected):
    assert slight(channels, gains, load_thresholds()) is expected
