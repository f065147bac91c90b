"""Whether the parameters of an effect differ from zero, one by one and together."""

from typing import cast
from unittest.mock import Mock

import numpy as np
import pytest
from unit.crane_identification.diagnosis.made import ROWS, normal, searched

from crane_identification.diagnosis.decision.judgement import Judged
from crane_identification.diagnosis.proof.extension import Value
from crane_identification.diagnosis.proof.trial import differ_together, differs

SIGMAS, QUANTILE = 2.0, 6.18  # of chi-square with two degrees of freedom, where one has 2 squared
A, B, C = np.linalg.qr(normal(1, ROWS, 3))[0].T


@pytest.mark.parametrize(
    ("alike", "first", "second", "sure"),
    [
        (0.9, 1.5, 1.5, True),
        (0.9, 1.5, -1.5, False),
        (0.0, 1.5, 1.5, False),
        (-0.9, 1.5, -1.5, True),
    ],
)
def test_parameters_of_columns_that_are_alike_are_asked_together(
    alike: float, first: float, second: float, sure: bool
) -> None:
    """Against the closed form of two: estimates are correlated as their columns are, reversed."""
    like = alike * A + np.sqrt(1.0 - alike**2) * B
    made = searched({"seal_friction": np.stack([A, like], axis=1), "hose_stiffness": C}, 9.0 * A)
    own, other = (cast(Judged, Mock(shaped=shaped)) for shaped in made.projection.candidates)
    values = [Value("mu", 1e-3 * sigmas, 1e-3, "1") for sigmas in (first, second)]
    r = -made.projection.gram[0, 1]
    together = (first**2 + second**2 - 2.0 * r * first * second) / (1.0 - r**2)
    assert not differs(own, values, SIGMAS)
    assert differ_together(made, [own, other], own, values, SIGMAS) is sure
    assert bool(together > QUANTILE) is sure
