"""Windows made by the filter's own equation: the outer boom moves, the other joints stand."""

import numpy as np

from crane_observer.payload.filter import Balanced, TipBalance

HOP = 0.15  # s
DRY = np.array([800.0, 520.0, 720.0])  # N m, N
BY_MASS = np.array([45.0, 25.0, -4.0])  # N m/kg, N/kg
STANDING, MOVING = 8, 20  # windows


def window(load: float, direction: float, held: float, rng: np.random.Generator) -> Balanced:
    """The outer boom moves in a direction, or stands (0); joints that stand are held by a share of
    their friction.
    """
    directions = np.array([0.0, direction, 0.0])
    away = np.where(directions, directions, held)
    force = BY_MASS * load + DRY * away + rng.normal(0.0, 15.0, 3)
    zero, still = np.zeros(3), directions == 0.0
    balance = TipBalance(
        force=force, asked=zero, up=DRY, down=-DRY, viscous=zero, inertial=zero,
        inertia=np.zeros((3, 3)), inertia_of_load=np.zeros((2, 3, 3)),
        mass=BY_MASS, moment=0.1 * BY_MASS, by_pressure=np.diag([1e-3, 1e-3, 5e-3]),
    )  # fmt: skip
    return Balanced(
        HOP, balance, ~still, still, directions > 0.0, zero, np.zeros((3, 3)), still & False, zero,
        np.zeros((3, 3)),
    )  # fmt: skip


def shaken(load: float, deviation: float, rng: np.random.Generator) -> Balanced:
    """The outer boom moves at constant speed, and its encoder shows accelerations [rad/s2]."""
    steady, boom = window(load, 1.0, 0.0, rng), np.diag([0.0, 1.0, 0.0])
    shown = boom @ rng.normal(0.0, deviation, 3)
    inertia, by_load = 4000.0 * boom, 20.0 * boom  # kg m2, kg m2 for each kg
    balance = steady.balance._replace(
        asked=inertia @ shown, inertial=inertia @ shown, inertia=inertia,
        inertia_of_load=np.stack([by_load, np.zeros((3, 3))]), mass=BY_MASS + by_load @ shown,
    )  # fmt: skip
    return steady._replace(balance=balance, shaken=deviation**2 * boom)
