"""What (3)-(7) must satisfy for any physical crane: M > 0, M' - 2C skew, energy balance."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from unit.crane_model.lagrangian import (
    coriolis_matrix,
    energy,
    gravity_vector,
    inverse_dynamics,
    mass_matrix,
)

from crane_model import load_machine
from crane_model.base_parameters import lagrangian_from_standard
from crane_model.dynamics import Geometry

GEOMETRY = Geometry.of(load_machine())

mass = st.floats(1.0, 500.0)
place = st.floats(-2.0, 2.0)
gyration = st.floats(0.01, 1.0)  # radius about the centre of mass, m
bodies = st.tuples(*[st.tuples(mass, place, place, gyration)] * 3)
angle = st.floats(-np.pi, np.pi)
extension = st.floats(-1.0, 3.0)
speed = st.floats(-3.0, 3.0)
coordinates = st.tuples(angle, angle, extension).map(np.array)
velocities = st.tuples(speed, speed, speed).map(np.array)


def nine(bodies: tuple[tuple[float, float, float, float], ...]) -> np.ndarray:
    """The parameters of dynamics from mass, centre of mass and radius of gyration of each body."""
    standard = [(m, m * x, m * y, m * (x * x + y * y + r * r)) for m, x, y, r in bodies]
    return lagrangian_from_standard(GEOMETRY) @ np.ravel(standard)


def slope_of_mass(parameters: np.ndarray, q: np.ndarray, v: np.ndarray) -> np.ndarray:
    """dM/dt along v by a central difference of sixth order."""
    step = 1e-2
    total = np.zeros((3, 3))
    for k, weight in ((1, 45.0), (2, -9.0), (3, 1.0)):
        ahead, behind = mass_matrix(
            GEOMETRY, parameters, np.stack([q + k * step * v, q - k * step * v])
        )
        total += weight / 60.0 * (ahead - behind)
    return total / step


@given(bodies, coordinates)
def test_mass_matrix_is_symmetric_and_positive_definite(bodies, q) -> None:
    (m,) = mass_matrix(GEOMETRY, nine(bodies), q[None])
    np.testing.assert_array_equal(m, m.T)
    scale = 1.0 / np.sqrt(np.diag(m))
    assert np.linalg.eigvalsh(scale[:, None] * m * scale).min() > 0.0


@given(bodies, coordinates, velocities)
def test_slope_of_mass_minus_twice_coriolis_is_skew(bodies, q, v) -> None:
    parameters = nine(bodies)
    (c,) = coriolis_matrix(GEOMETRY, parameters, q[None], v[None])
    rest = slope_of_mass(parameters, q, v) - 2.0 * c
    (m,) = mass_matrix(GEOMETRY, parameters, q[None])
    assert np.abs(rest + rest.T).max() <= 1e-8 * np.abs(m).max() * max(1.0, np.abs(v).max())


@given(bodies, coordinates)
def test_gravity_is_the_slope_of_the_potential(bodies, q) -> None:
    parameters, step = nine(bodies), 1e-5
    (gravity,) = gravity_vector(GEOMETRY, parameters, q[None])
    moved = step * np.eye(3)
    still = np.zeros((3, 3))
    ahead = energy(GEOMETRY, parameters, q + moved, still)[1]
    behind = energy(GEOMETRY, parameters, q - moved, still)[1]
    scale = np.abs(parameters).max() * GEOMETRY.gravity
    np.testing.assert_allclose(gravity, (ahead - behind) / (2 * step), atol=1e-8 * scale)


@given(bodies, coordinates, velocities, velocities)
@settings(max_examples=50)
def test_power_of_the_generalized_forces_is_the_rate_of_energy(bodies, q, v, a) -> None:
    """dE/dt = v . tau along q(t) = q + v t + a t^2 / 2, whose derivatives at t = 0 are v and a."""
    parameters, step = nine(bodies), 1e-3
    (tau,) = inverse_dynamics(GEOMETRY, parameters, q[None], v[None], a[None])
    rate = 0.0
    for k, weight in ((1, 45.0), (2, -9.0), (3, 1.0)):
        t = k * step * np.array([[1.0], [-1.0]])
        kinetic, potential = energy(GEOMETRY, parameters, q + v * t + 0.5 * a * t * t, v + a * t)
        ahead, behind = kinetic + potential
        rate += weight / (60.0 * step) * (ahead - behind)
    scale = np.abs(parameters).max() * 100.0
    assert abs(rate - v @ tau) <= 1e-9 * scale
