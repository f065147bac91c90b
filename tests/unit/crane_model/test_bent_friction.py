"""Families by which friction that falls is told from a loss, asked of laws off their grid."""

import numpy as np
import pytest

from crane_model.terms.nonparametric import NonparametricSpeedFriction

FASTEST = 0.45  # m/s
SPEED = np.array(NonparametricSpeedFriction.over(np.array([0.0, FASTEST])))
SPACE = np.gradient(SPEED)[1:-1]  # of the speeds, which count alike

LAWS = {
    "lorentz": ("stribeck", 1.0 / (1.0 + (SPEED / 0.04) ** 2)),
    "hill": ("stribeck", 1.0 / (1.0 + (SPEED / 0.1) ** 3.2)),
    "sech": ("stribeck", 1.0 / np.cosh(SPEED / 0.05)),
    "ramp": ("stribeck", np.maximum(1.0 - SPEED / 0.12, 0.0) ** 1.7),
    "blunt": ("viscous_quadratic", SPEED**3 / (SPEED + 0.1)),
    "rounded": ("viscous_quadratic", SPEED * np.hypot(SPEED, 0.02)),
    "late": ("viscous_quadratic", np.maximum(SPEED - 0.058, 0.0) ** 1.67),
}


def left(law: np.ndarray, family: str) -> float:
    """Share of the energy of a law beside Coulomb and viscous friction that no curve follows."""
    line = SPEED / FASTEST
    beside = (law - law[0] - line * (law[-1] - law[0]))[1:-1] * np.sqrt(SPACE)
    curves = NonparametricSpeedFriction.family_of(family, SPEED) * np.sqrt(SPACE)[:, np.newaxis]
    along = np.maximum(beside @ curves, 0.0) ** 2 / (curves**2).sum(axis=0)
    return float(1.0 - along.max() / (beside**2).sum())


@pytest.mark.parametrize("name", LAWS)
def test_a_law_is_followed_best_by_the_family_of_its_physics(name: str) -> None:
    family, law = LAWS[name]
    (other,) = NonparametricSpeedFriction.families.keys() - {family}
    assert left(law, family) < 0.5 * left(law, other)


def test_friction_that_falls_is_no_loss_of_less_than_nothing() -> None:
    assert left(-LAWS["blunt"][1], "viscous_quadratic") == 1.0
