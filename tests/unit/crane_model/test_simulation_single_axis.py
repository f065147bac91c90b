"""Forward simulation of one block on a surface, where the motion is known in closed form."""

import math
from typing import ClassVar, Literal

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from crane_model import Model, RangeError, Record, simulate
from crane_model.hydraulics.stepping import with_dry_friction
from crane_model.terms import REGISTRY, JointTerm, Parameter, friction, presliding, single_axis
from crane_model.terms.term import Family, Setting

MASS, COULOMB, VISCOUS, SLOPE = 12.0, 30.0, 8.0, 21.0


def block(values: dict[type[JointTerm], float]) -> Model:
    """A model of one prismatic joint; every term with its value."""
    terms = tuple(term(joint="axis") for term in values)
    setting = Setting({"axis": "m"}, None)
    return Model("block", setting, terms, np.array(list(values.values())))


DRY = block({single_axis.Inertia: MASS, friction.Coulomb: COULOMB})


def coasting(model: Model, speeds: list[float], steps: int, duration: float):
    v = np.array(speeds)[:, None]
    drive = np.zeros((steps + 1, len(speeds), 1))
    return simulate(model, np.zeros_like(v), v, drive, duration / steps, substeps=1)


def test_block_stops_where_and_when_coulomb_friction_says() -> None:
    """Stopping time m v / f_c and distance m v^2 / (2 f_c), from both sides, then exactly still."""
    speeds, steps, duration = [2.0, -1.3, 0.7], 200, 1.0
    motion = coasting(DRY, speeds, steps, duration)
    for n, speed in enumerate(speeds):
        stopped = MASS * abs(speed) / COULOMB
        v = motion.velocity[:, n, 0]
        sliding = motion.time < stopped
        deceleration = COULOMB / MASS * np.sign(speed)
        expected = speed - deceleration * motion.time[sliding]
        np.testing.assert_allclose(v[sliding], expected, atol=1e-12)
        assert (v[motion.time > stopped + duration / steps] == 0.0).all()
        distance = MASS * speed * abs(speed) / (2 * COULOMB)
        assert motion.position[-1, n, 0] == pytest.approx(distance, abs=1e-3)
        assert np.ptp(motion.position[motion.time > stopped + duration / steps, n, 0]) == 0.0


def test_stopping_place_converges_with_the_square_of_the_step() -> None:
    """With viscous friction as well, over many speeds, for where in a step it stops varies."""
    model = block({single_axis.Inertia: MASS, friction.Coulomb: COULOMB, friction.Viscous: VISCOUS})
    speeds = np.linspace(0.5, 2.0, 40)
    time = MASS / VISCOUS * np.log(1 + VISCOUS * speeds / COULOMB)
    place = (MASS * speeds - COULOMB * time) / VISCOUS
    errors = []
    for steps in (25, 50, 100):
        end = coasting(model, list(speeds), steps, 1.0).position[-1, :, 0]
        errors.append(np.sqrt(((end - place) ** 2).mean()))
    np.testing.assert_allclose(np.diff(-np.log2(errors)), 2.0, atol=0.3)
    assert errors[-1] < 1e-4


@pytest.mark.parametrize("push", [0.0, 0.5, -0.5, 0.9999999, -0.9999999])
def test_block_at_rest_stays_exactly_up_to_breakaway(push: float) -> None:
    drive = np.full((100, 1, 1), push * COULOMB)
    motion = simulate(DRY, np.full((1, 1), 0.3), np.zeros((1, 1)), drive, 0.01)
    assert (motion.velocity == 0.0).all()
    assert (motion.position == 0.3).all()


@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_block_beyond_breakaway_accelerates_with_what_friction_leaves(sign: float) -> None:
    drive = np.full((101, 1, 1), sign * 1.5 * COULOMB)
    motion = simulate(DRY, np.zeros((1, 1)), np.zeros((1, 1)), drive, 0.01)
    expected = sign * 0.5 * COULOMB / MASS * motion.time
    np.testing.assert_allclose(motion.velocity[:, 0, 0], expected, atol=1e-12)
    np.testing.assert_allclose(motion.position[:, 0, 0], expected * motion.time / 2, atol=1e-12)


def test_block_on_a_slope_slides_up_stops_and_stays() -> None:
    """The slope pulls with less than f_c: up it decelerates with both, and does not slide back."""
    model = block(
        {
            single_axis.Inertia: MASS,
            friction.Coulomb: COULOMB,
            single_axis.Offset: SLOPE,
        }
    )
    motion = coasting(model, [2.0], 400, 1.0)
    height = MASS * 2.0**2 / (2 * (COULOMB + SLOPE))
    assert motion.position[-1, 0, 0] == pytest.approx(height, abs=1e-4)
    assert motion.velocity[-1, 0, 0] == 0.0


def test_block_on_a_steep_slope_stops_and_slides_back() -> None:
    steep = 1.5 * COULOMB
    model = block(
        {
            single_axis.Inertia: MASS,
            friction.Coulomb: COULOMB,
            single_axis.Offset: steep,
        }
    )
    motion = coasting(model, [2.0], 1000, 1.0)
    turned = MASS * 2.0 / (COULOMB + steep)
    back = (steep - COULOMB) / MASS * (1.0 - turned)
    assert motion.velocity[-1, 0, 0] == pytest.approx(-back, rel=1e-2)


def test_friction_that_differs_with_direction() -> None:
    """(12): f_c + df_c forwards, f_c - df_c backwards."""
    difference = 10.0
    model = block(
        {
            single_axis.Inertia: MASS,
            friction.Coulomb: COULOMB,
            friction.CoulombAsymmetry: difference,
        }
    )
    motion = coasting(model, [1.0, -1.0], 400, 1.0)
    forwards, backwards = motion.position[-1, :, 0]
    assert forwards == pytest.approx(MASS / (2 * (COULOMB + difference)), abs=1e-4)
    assert backwards == pytest.approx(-MASS / (2 * (COULOMB - difference)), abs=1e-4)


def test_drive_between_instants_is_interpolated() -> None:
    """A force that grows in proportion to time: v = k t^2 / (2 m)."""
    model = block({single_axis.Inertia: MASS})
    time = np.linspace(0.0, 1.0, 11)
    motion = simulate(model, np.zeros((1, 1)), np.zeros((1, 1)), 60.0 * time[:, None, None], 0.1)
    np.testing.assert_allclose(motion.velocity[:, 0, 0], 30.0 * time**2 / MASS, atol=1e-12)
    np.testing.assert_array_equal(motion.force[:, 0, 0], 60.0 * time)
    np.testing.assert_allclose(motion.time, time, atol=1e-15)


def test_substeps_are_shorter_steps() -> None:
    model = block({single_axis.Inertia: MASS, friction.Viscous: VISCOUS})
    v = np.array([[1.0]])
    coarse = simulate(model, 0 * v, v, np.zeros((11, 1, 1)), 0.1, substeps=4)
    fine = simulate(model, 0 * v, v, np.zeros((41, 1, 1)), 0.025, substeps=1)
    np.testing.assert_allclose(coarse.position, fine.position[::4], rtol=1e-14)
    assert coarse.velocity[-1, 0, 0] == pytest.approx(math.exp(-VISCOUS / MASS), rel=1e-4)


@pytest.mark.filterwarnings("ignore::RuntimeWarning")
def test_steps_too_long_for_the_model_are_refused() -> None:
    """Explicit steps of a light block in thick oil grow without bound."""
    model = block({single_axis.Inertia: 1e-3, friction.Viscous: 1e3})
    with pytest.raises(RangeError, match="'block'.*steps are too long"):
        coasting(model, [1.0], 200, 2.0)


@pytest.mark.parametrize("inertia", [0.0, -2.0])
def test_mass_that_is_not_physical_is_refused(inertia: float) -> None:
    model = block({single_axis.Inertia: inertia, friction.Coulomb: COULOMB})
    with pytest.raises(RangeError, match=rf"'block'.*inertia of axis is {inertia:g} in"):
        coasting(model, [1.0], 2, 0.01)


joints = st.integers(1, 3)


@given(joints, st.integers(0, 2**32 - 1))
def test_dry_friction_opposes_motion_and_holds_within_its_limit(joints: int, seed: int) -> None:
    """v = free - compliance f with f = dry sgn(v) of a joint that moves and |f| <= dry at rest."""
    rng = np.random.default_rng(seed)
    root = rng.standard_normal((20, joints, joints))
    compliance = root @ root.transpose(0, 2, 1) + 0.1 * np.eye(joints)
    free = 3.0 * rng.standard_normal((20, joints))
    dry = rng.uniform(0.0, 3.0, (20, joints)) * (rng.random((20, joints)) < 0.8)
    v = with_dry_friction(free, compliance, dry)
    force = np.linalg.solve(compliance, (free - v)[:, :, None])[:, :, 0]
    moving = v != 0.0
    np.testing.assert_allclose(force[moving], (dry * np.sign(v))[moving], atol=1e-7)
    assert (np.abs(force[~moving]) <= dry[~moving] + 1e-7).all()


def test_presliding_against_an_independent_integrator() -> None:
    """A block on bristles of Dahl, pushed to and fro; scipy integrates motion and state."""
    friction_force, travel, push, rate = 20.0, 0.01, 25.0, 9.0
    time = np.linspace(0.0, 2.0, 401)
    drive = push * np.sin(rate * time)[:, None, None]
    terms = single_axis.Inertia(joint="axis"), presliding.Presliding(joint="axis", travel=travel)
    setting = Setting({"axis": "m"}, None)
    model = Model("bristles", setting, terms, np.array([MASS, friction_force]))

    def slope(t: float, state: np.ndarray) -> list[float]:
        _, v, z = state
        force = np.interp(t, time, drive[:, 0, 0]) - friction_force * z
        return [v, force / MASS, (v - abs(v) * z) / travel]

    expected = solve_ivp(
        slope, (0.0, 2.0), [0.0, 0.2, 0.5], t_eval=time, rtol=1e-9, atol=1e-12, max_step=0.005
    )
    start = np.zeros((1, 1)), np.full((1, 1), 0.2)
    memory = {terms[1]: np.full((1, 1), 0.5)}
    errors = []
    for substeps in (1, 2):
        motion = simulate(model, *start, drive, 0.005, substeps, memory=memory)
        errors.append(np.abs(motion.position[:, 0, 0] - expected.y[0]).max())
    assert errors[1] < 1e-2 * np.abs(expected.y[0]).max()
    assert errors[1] < 0.3 * errors[0]  # with the square of the step


def test_signals_beside_the_drive_reach_the_terms() -> None:
    """A term of temperature: the block coasts in oil that warms up."""

    class Oil(JointTerm):
        """f T q'."""

        type: Literal["test_oil"] = "test_oil"
        family: ClassVar[Family] = "friction"

        def column(self, record: Record, j: int) -> np.ndarray:
            assert record.temperature is not None
            return record.temperature * record.velocity[:, j]

        def parameter(self, coordinate: str, force: str) -> Parameter:
            return Parameter("oil", "N s/m", 0.0, "per degree")

    try:
        model = block({single_axis.Inertia: MASS, Oil: VISCOUS})
        time = np.linspace(0.0, 1.0, 201)
        warmth = np.stack([1.0 + time, 2.0 + 0.0 * time], axis=1)
        still = np.zeros((201, 2, 1))
        motion = simulate(
            model, still[0], np.ones((2, 1)), still, 0.005, beside={"temperature": warmth}
        )
    finally:
        del REGISTRY["test_oil"]
    rates = VISCOUS / MASS * np.array([1.5, 2.0])  # of the mean temperature
    np.testing.assert_allclose(motion.velocity[-1, :, 0], np.exp(-rates), rtol=1e-4)
