"""Actuators of every type: lever arm by differences, areas, and classes of one's own."""

from collections.abc import Iterator
from typing import Any, Literal

import numpy as np
import pytest

from crane_model import Machine, linkages
from crane_model.actuators import (
    ACTUATOR_TYPES,
    Actuator,
    CylinderActuator,
    HydraulicActuator,
    actuator_from_mapping,
)
from crane_model.array import Array

CYLINDER = {"area_a": 2e-3, "area_b": 1e-3, "pressure_sensors": True}
RANGE = {"length_min": -10.0, "length_max": 10.0}
FOUR_BAR = {
    "s22": 0.2,
    "s23": 0.18,
    "c1": 0.3,
    "c2": 0.32,
    "s31": 1.2,
    "s32": 1.022,
    "beta_1": 1.25,
    "gamma_25": 0.18,
    "pin_rise": 0.1,
}
TRIANGLE = {"j1": 0.28, "j2": 0.8, "phi_3": 0.05, "phi_4": 0.37}
TYPES: dict[str, tuple[dict[str, Any], float | None]] = {  # constants, and dx/dq at q = 0.5
    "triangle": ({"type": "triangle_cylinder", **TRIANGLE, **CYLINDER, **RANGE}, 0.24661),
    "triangle behind": (
        {"type": "triangle_cylinder", **TRIANGLE, "phi_3": -2.5, **CYLINDER, **RANGE},
        -0.25198,
    ),
    "four bars mirrored": (
        {"type": "four_bar_cylinder", **FOUR_BAR, "mirrored": True, **CYLINDER, **RANGE},
        None,
    ),
    "telescope": ({"type": "direct_cylinder", **CYLINDER, **RANGE}, 1.0),
    "double telescope": ({"type": "direct_cylinder", "ratio": 0.5, **CYLINDER, **RANGE}, 0.5),
    "rack": ({"type": "rack_and_pinion", "rack_radius": 0.08, **CYLINDER, **RANGE}, 0.08),
    "motor": (
        {"type": "rotary_motor", "displacement": 1e-5, "gear_ratio": 30, "pressure_sensors": True},
        30.0,
    ),
    "electric": ({"type": "electric_drive", "gear_ratio": -120.0}, -120.0),
    "passive": ({"type": "passive"}, 1.0),
}


@pytest.mark.parametrize("name", TYPES)
def test_lever_arm_and_its_derivative(name: str) -> None:
    constants, at_half = TYPES[name]
    actuator, step = actuator_from_mapping(constants), 1e-5
    q = np.linspace(0.3, 1.3, 50)
    _, lever, slope = actuator.motion(q).T
    ahead, behind = actuator.motion(q + step).T, actuator.motion(q - step).T
    np.testing.assert_allclose(lever, (ahead[0] - behind[0]) / (2 * step), atol=1e-9)
    np.testing.assert_allclose(slope, (ahead[1] - behind[1]) / (2 * step), atol=1e-9)
    if at_half is not None:
        assert actuator.motion(np.array([0.5]))[0, 1] == pytest.approx(at_half, abs=1e-5)
    found = actuator.linkage(0.3, 1.3)
    np.testing.assert_array_equal(linkages.samples(*found, q), actuator.motion(q))


def test_the_four_bars_are_mirrored() -> None:
    constants = TYPES["four bars mirrored"][0]
    mirrored = actuator_from_mapping(constants)
    plain = actuator_from_mapping({**constants, "mirrored": False})
    q = np.linspace(0.2, 2.0, 20)
    np.testing.assert_array_equal(mirrored.motion(q)[:, 0], plain.motion(-q)[:, 0])


def test_parallel_cylinders_add_their_areas() -> None:
    pair = actuator_from_mapping({**TYPES["triangle"][0], "count": 2})
    assert (pair.area_a, pair.area_b) == (4e-3, 2e-3)
    assert actuator_from_mapping(pair.model_dump()) == pair


def test_a_motor_turns_by_its_displacement() -> None:
    motor = actuator_from_mapping(TYPES["motor"][0])
    torque = motor.area_a * 100e5 - motor.area_b * 20e5
    assert torque * motor.motion(np.zeros(1))[0, 1] == pytest.approx(1e-5 * 80e5 * 30)


def test_the_chambers_of_a_cylinder_fill_and_those_of_a_motor_do_not() -> None:
    cylinder, motor = (actuator_from_mapping(TYPES[one][0]) for one in ("triangle", "motor"))
    assert isinstance(cylinder, HydraulicActuator) and isinstance(motor, HydraulicActuator)
    x = np.array([cylinder.length_min, 0.9])
    filled_a, filled_b = cylinder.chambers.swept(x)
    stroke = cylinder.length_max - cylinder.length_min
    np.testing.assert_allclose(filled_a, [0.0, 2e-3 * (0.9 - cylinder.length_min)])
    np.testing.assert_allclose(filled_b, [1e-3 * stroke, 1e-3 * (cylinder.length_max - 0.9)])
    assert cylinder.chambers.grow and not motor.chambers.grow
    np.testing.assert_array_equal(motor.chambers.swept(x), np.zeros((2, 2)))


@pytest.fixture
def as_it_was() -> Iterator[None]:
    registered = dict(ACTUATOR_TYPES)
    yield
    ACTUATOR_TYPES.clear()
    ACTUATOR_TYPES.update(registered)


def test_an_actuator_of_ones_own(as_it_was: None, machine: Machine) -> None:
    """It is registered by being defined, and a table of it serves compiled code."""

    class Crank(CylinderActuator):
        type: Literal["crank"] = "crank"
        radius: float

        def motion(self, q: Array) -> Array:
            sin, cos = np.sin(q), np.cos(q)
            return np.stack([-cos, sin, cos], axis=1) * self.radius

    crank = actuator_from_mapping({"type": "crank", "radius": 0.4, **CYLINDER, **RANGE})
    assert isinstance(crank, Crank)
    q = np.random.default_rng(1).uniform(0.3, 2.0, 200)
    kind, constants = crank.linkage(0.3, 2.0)
    assert kind == linkages.TABLE
    np.testing.assert_allclose(linkages.samples(kind, constants, q), crank.motion(q), atol=1e-9)


def test_every_type_is_listed_for_an_unknown_one() -> None:
    with pytest.raises(ValueError, match="direct_cylinder, electric_drive, four_bar_cylinder, "):
        actuator_from_mapping({"type": "spring"})
    assert all(issubclass(one, Actuator) for one in ACTUATOR_TYPES.values())
