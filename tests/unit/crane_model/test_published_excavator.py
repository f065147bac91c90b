"""The excavator beside what was published of it: its file names the sources.

Strokes and angles are those that the publication of the pins computes by formulas of its own
(eXactMPC, MATLAB/excavatorModel.m); depth and forces at the teeth are those of the manufacturer.
"""

import numpy as np
import pytest

from crane_model import Machine, load_machine, tip_position

LBF = 4.4482  # N
FOOT = 0.3048  # m

# joint: (length of the cylinder [m], angle [rad]) at both ends of the stroke
PUBLISHED = {
    "boom": ((0.905, -0.4737), (1.305, 1.0923)),
    "stick": ((1.046, -0.5103), (1.556, -2.5848)),
    "bucket": ((0.84, 0.7839), (1.26, -2.8659)),
}


@pytest.fixture(scope="module")
def excavator() -> Machine:
    return load_machine("excavator")


@pytest.mark.parametrize("joint", PUBLISHED)
def test_cylinders_are_as_long_as_published(excavator: Machine, joint: str) -> None:
    lengths, angles = np.array(PUBLISHED[joint]).T
    np.testing.assert_allclose(excavator.cylinder(joint, angles)[:, 0], lengths, atol=5e-5)


def test_it_digs_as_deep_as_published(excavator: Machine) -> None:
    """9 ft, in whole feet, with a bucket that is not named."""
    low = {joint: limits.position_min for joint, limits in excavator.limits.items()}
    stretched = excavator.limits["stick"].position_max
    bucket = np.linspace(low["bucket"], 0.0, 201)
    poses = np.array([[0.0, low["boom"], stretched, one] for one in bucket])
    depth = -tip_position(excavator, poses)[:, 2].min()
    assert depth == pytest.approx(9 * FOOT, rel=0.1)


def largest_lever(machine: Machine, joint: str) -> float:
    limits = machine.limits[joint]
    q = np.linspace(limits.position_min, limits.position_max, 501)
    return float(np.abs(machine.cylinder(joint, q)[:, 1]).max())


def test_the_bores_make_the_published_forces(excavator: Machine) -> None:
    """At relief, on the side that curls in: breakout by the bucket, tearout by the stick."""
    pressure = excavator.hydraulics.relief_pressure
    stick, bucket = (excavator.joints[excavator.index(one)] for one in ("stick", "bucket"))
    breakout = pressure * bucket.actuator.area_a * largest_lever(excavator, "bucket")
    assert breakout / bucket.dh.a == pytest.approx(5020 * LBF, rel=0.02)
    tearout = pressure * stick.actuator.area_a * largest_lever(excavator, "stick")
    assert tearout / (stick.dh.a + bucket.dh.a) == pytest.approx((8453 - 4554) * LBF, rel=0.02)
