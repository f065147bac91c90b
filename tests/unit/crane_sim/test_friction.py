"""Friction of the plant against literal statements of the laws."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from crane_model.machine_files import machine_file
from crane_sim import SimulatedCrane, load_simulated_crane
from crane_sim.parts.constants import pack_friction
from crane_sim.parts.cylinders import lugre_force, step_lugre, step_set_valued

STEP = 1e-3


def _step(
    law: np.ndarray, mass: np.ndarray, push: np.ndarray, v: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Velocity after a step under the force `push`, and the friction force that it implies."""
    mode, after = np.zeros(4, dtype=np.int64), v.copy()
    impulse = mass @ v + STEP * push
    step_set_valued(law, mass, impulse, STEP, mode, np.empty((5, 4)), after)
    return after, (impulse - mass @ after) / STEP


@settings(max_examples=200, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), load=st.floats(0.1, 4.0))
def test_result_of_a_step_satisfies_the_set_valued_law(seed: int, load: float) -> None:
    """Where a joint moves friction is (13) at the new velocity; where it stands, within (13)."""
    law = pack_friction(load_simulated_crane())
    rng = np.random.default_rng(seed)
    root = rng.normal(size=(4, 4))
    mass = 50.0 * (root @ root.T + np.eye(4))
    push = load * rng.normal(size=4) * law["coulomb_up"]
    v = rng.normal(size=4) * 0.02 * rng.integers(0, 2, size=4)
    after, friction = _step(law, mass, push, v)
    for i in range(4):
        up, down = law["coulomb_up"][i], law["coulomb_down"][i]
        if after[i] > 0.0:
            expected = up + law["viscous_up"][i] * after[i]
        elif after[i] < 0.0:
            expected = -down + law["viscous_down"][i] * after[i]
        else:
            assert -down * (1 + 1e-9) <= friction[i] <= up * (1 + 1e-9)
            continue
        assert friction[i] == pytest.approx(expected, rel=1e-6)


@pytest.mark.parametrize("joint", range(4))
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_breakaway_is_asymmetric_and_standing_is_exact(
    simulated: SimulatedCrane, joint: int, sign: float
) -> None:
    """Below f_c + df_c up, or f_c - df_c down, the velocity stays exactly 0; above, it moves."""
    law = pack_friction(simulated)
    threshold = law["coulomb_up" if sign > 0 else "coulomb_down"][joint]
    push = np.zeros(4)
    push[joint] = sign * 0.999 * threshold
    assert (_step(law, 300.0 * np.eye(4), push, np.zeros(4))[0] == 0.0).all()
    push[joint] = sign * 1.001 * threshold
    assert sign * _step(law, 300.0 * np.eye(4), push, np.zeros(4))[0][joint] > 0.0


@pytest.mark.parametrize("v", [-0.3, -0.02, -0.004, 0.004, 0.02, 0.3])
def test_lugre_settles_at_its_steady_state_law(v: float) -> None:
    """At constant speed: Stribeck curve between breakaway and Coulomb, plus viscous friction."""
    path = machine_file("simulated_crane_dynamic_friction.yaml")
    for law in pack_friction(load_simulated_crane(path)):
        z = 0.0
        for _ in range(20_000):
            force, z = lugre_force(law, v, z, 1e-3)
        coulomb = law["coulomb_up"] if v > 0 else law["coulomb_down"]
        viscous = law["viscous_up"] if v > 0 else law["viscous_down"]
        excess = (law["breakaway_ratio"] - 1) * coulomb
        stribeck = excess * math.exp(-((v / law["stribeck_velocity"]) ** 2))
        expected = math.copysign(coulomb + stribeck, v) + viscous * v
        assert force == pytest.approx(expected, rel=1e-6)


def test_lugre_springs_back_before_it_slides() -> None:
    """A push below breakaway only bends the bristles: the joint comes to rest nearby."""
    path = machine_file("simulated_crane_dynamic_friction.yaml")
    law = pack_friction(load_simulated_crane(path))
    push = 0.5 * law["coulomb_up"]
    mass, v, z, travel = 300.0 * np.eye(4), np.zeros(4), np.zeros(4), np.zeros(4)
    for _ in range(40_000):
        step_lugre(law, mass, mass @ v + 2e-4 * push, 2e-4, z, np.empty((5, 4)), v)
        travel += 2e-4 * v
    assert np.abs(v).max() < 1e-6
    np.testing.assert_allclose(z, push / law["stiffness"], rtol=1e-3)
    assert (np.abs(travel) < 3.0 * push / law["stiffness"]).all()
