"""Friction (10)-(16): columns against the report's law, and the convention at standstill."""

import numpy as np
import pytest
from laboratory_crane import PLANAR_JOINTS

from crane_model import DataError, Model, Record

RESOLUTION = np.array([0.01, 0.01, 0.02])


def record(velocity: np.ndarray, **more) -> Record:
    zeros = np.zeros_like(velocity)
    return Record(PLANAR_JOINTS, np.arange(len(velocity)) * 0.01, zeros, velocity, zeros, **more)


def friction_columns(crane: Model, record: Record) -> np.ndarray:
    """(n, 3, 12): phi^f of (15), the part of the model behind the eight inertial columns."""
    return crane.regressor(record)[:, :, 8:]


@pytest.fixture(scope="module")
def velocity() -> np.ndarray:
    return np.random.default_rng(9).standard_normal((200, 3))


def test_friction_is_equations_10_to_12_put_together(crane: Model, velocity: np.ndarray) -> None:
    """With f_c and f_v that depend on the direction, (11)-(12) in (10)."""
    theta = np.random.default_rng(10).standard_normal((3, 4))
    tau = friction_columns(crane, record(velocity)) @ theta.ravel()
    for n, row in enumerate(velocity):
        for i, v in enumerate(row):
            sgn = 1.0 if v > 0 else -1.0
            f_c = theta[i, 0] + theta[i, 1] * sgn
            f_v = theta[i, 2] + theta[i, 3] * sgn
            assert tau[n, i] == pytest.approx(f_c * sgn + f_v * v, rel=1e-12)


def test_columns_are_block_diagonal(crane: Model, velocity: np.ndarray) -> None:
    """(14)-(15): [sgn, 1, v, |v|] of each joint in its own block, zeros elsewhere."""
    columns = friction_columns(crane, record(velocity))
    expected = np.zeros((len(velocity), 3, 12))
    for i in range(3):
        v = velocity[:, i]
        block = np.stack([np.sign(v), np.ones_like(v), v, np.abs(v)], axis=1)
        expected[:, i, 4 * i : 4 * i + 4] = block
    np.testing.assert_array_equal(columns, expected)


def test_names_and_units_follow_the_columns(crane: Model) -> None:
    names = [
        f"{symbol}.{joint}" for joint in PLANAR_JOINTS for symbol in ("f_c", "df_c", "f_v", "df_v")
    ]
    assert [p.name for p in crane.parameters[8:]] == names
    units = {p.name: p.unit for p in crane.parameters}
    assert units["f_c.outer_boom"] == "N m"
    assert units["f_c.telescope"] == "N"
    assert units["f_v.inner_boom"] == "N m s/rad"
    assert units["df_v.telescope"] == "N s/m"


def test_mean_values_cannot_be_negative_but_their_differences_can(crane: Model) -> None:
    for parameter in crane.parameters[8:]:
        assert parameter.minimum == (None if parameter.name.startswith("d") else 0.0)


@pytest.mark.parametrize(
    ("speed", "direction"),
    [(0.0, 0.0), (0.0099, 0.0), (-0.0099, 0.0), (0.01, 1.0), (-0.01, -1.0), (1.0, 1.0)],
)
def test_below_the_resolution_of_the_encoder_the_direction_is_zero(
    crane: Model, speed: float, direction: float
) -> None:
    sample = record(np.array([[speed, 0.0, 0.0]]), velocity_resolution=RESOLUTION)
    assert sample.direction[0, 0] == direction
    (row,) = friction_columns(crane, sample)[:, 0]
    np.testing.assert_array_equal(row, [direction, 1.0, speed, abs(speed)] + [0.0] * 8)


def test_each_joint_has_its_own_resolution() -> None:
    sample = record(np.full((1, 3), 0.015), velocity_resolution=RESOLUTION)
    np.testing.assert_array_equal(sample.direction, [[1.0, 1.0, 0.0]])


def test_without_a_resolution_only_zero_has_no_direction() -> None:
    sample = record(np.array([[1e-300, 0.0, -1e-300]]))
    np.testing.assert_array_equal(sample.direction, [[1.0, 0.0, -1.0]])


def test_a_known_direction_is_taken_as_it_is(crane: Model) -> None:
    """A joint that is held can have any share of Coulomb friction."""
    known = np.array([[0.3, -1.0, 1.0]])
    sample = record(np.zeros((1, 3)), velocity_resolution=RESOLUTION, direction_known=known)
    np.testing.assert_array_equal(
        friction_columns(crane, sample)[0, [0, 1, 2], [0, 4, 8]], known[0]
    )


def test_at_rest_keeps_the_place_and_drops_the_motion(velocity: np.ndarray) -> None:
    place = velocity + 1.0
    moving = Record(
        PLANAR_JOINTS,
        np.arange(len(place)),
        place,
        velocity,
        velocity,
        direction_known=np.ones_like(place),
    )
    still = moving.at_rest()
    np.testing.assert_array_equal(still.position, place)
    assert not still.velocity.any()
    assert not still.acceleration.any()
    assert not still.direction.any()


def test_shapes_that_do_not_fit_are_named() -> None:
    with pytest.raises(DataError, match=r"position has shape \(5, 2\).*3 joints.*telescope"):
        record(np.zeros((5, 2)))
    with pytest.raises(DataError, match=r"force has shape \(4, 3\), position has \(5, 3\)"):
        record(np.zeros((5, 3)), force=np.zeros((4, 3)))


def test_absent_joint_is_named() -> None:
    with pytest.raises(DataError, match=r"no joint 'slew'; it has inner_boom, outer_boom"):
        record(np.zeros((1, 3))).column("slew")
