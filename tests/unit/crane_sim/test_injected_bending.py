"""An injected boom that bends: what it asks of every joint, against energy and closed formulas."""

import numpy as np
import pytest
from unit.crane_sim.injected_machine import STEP, Rig, effect_of, rig

from crane_model import Machine, load_machine
from crane_sim import SimulatedCrane
from crane_sim.effects.loads import BENDING_MODES
from crane_sim.parts.rigid_bodies import Chain, beyond, mass_and_bias

JOINTS = load_machine().joint_names
PLANAR_JOINTS = load_machine().as_planar().joints

POSE = np.array([0.0, 0.3, -1.4, 0.5])


def energy(chain: Chain, q: np.ndarray, v: np.ndarray) -> float:
    """Kinetic and potential energy of the crane [J]."""
    mass = np.empty((4, 4))
    mass_and_bias(chain, q, v, mass, np.empty(4))
    _, moment = beyond(chain, 1)
    return float(0.5 * v @ mass @ v - chain.gravity @ moment)


def led(bent: Rig, q: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Forces (n - 1, 4) in the steps between n states of the joints, and the memory (n, ...)."""
    forces, memory = [], []
    for n in range(len(q) - 1):
        bent.put(q[n], v[n])
        bent.act()
        memory.append(bent.injected.memory[0].copy())
        forces.append(bent.settle(v[n + 1])[0])
    return np.array(forces), np.array([*memory, bent.injected.memory[0]])


@pytest.mark.parametrize("joint", PLANAR_JOINTS)
def test_the_forces_on_all_joints_do_the_work_that_bending_stores(
    machine: Machine, simulated: SimulatedCrane, joint: str
) -> None:
    """Without damping: energy of the bent shares and of their springs, less that of them unbent."""
    share, frequency = 0.4, 1.5
    bent = rig(simulated, machine, effect_of("boom_flexibility", joint, share, frequency, 0.0))
    chain, i = bent.constants.chain, JOINTS.index(joint)
    times = STEP * np.arange(round(1.0 / STEP))
    omega, reach = np.array([0.0, 5.0, 7.0, 6.0]), np.array([0.0, 0.1, 0.15, 0.1])
    q = POSE + reach * (1.0 - np.cos(np.outer(times, omega)))
    v = reach * omega * np.sin(np.outer(times, omega))
    forces, memory = led(bent, q, v)

    def stored(n: int) -> float:
        total = 0.0
        for mode, (ratio, part) in enumerate(BENDING_MODES):
            turn, rate = np.zeros(4), np.zeros(4)
            turn[i], rate[i] = memory[n, mode], memory[n, 2 + mode]
            stiffness = inertia[i, i] * (2.0 * np.pi * frequency * ratio) ** 2
            total += share * part * (
                energy(chain, q[n] + turn, v[n] + rate)
                - energy(chain, q[n], v[n])
                + 0.5 * stiffness * turn[i] ** 2
            )  # fmt: skip
        return total

    inertia = np.empty((4, 4))
    mass_and_bias(chain, q[0], v[0], inertia, np.empty(4))
    power = np.einsum("nj,nj->n", forces, (v[1:] + v[:-1]) / 2.0)
    work = np.concatenate([[0.0], np.cumsum(power) * STEP])
    kept = np.array([stored(n) - stored(0) for n in range(0, len(q), 100)])
    assert np.ptp(kept) > 1.0  # J
    np.testing.assert_allclose(work[::100], kept, atol=0.01 * np.ptp(kept))
    moved = np.abs(forces).max(axis=0) > 1.0  # N m, N
    assert moved[1:].all() and not moved[0]


def test_a_crane_at_rest_sags_and_does_not_ring(
    machine: Machine, simulated: SimulatedCrane
) -> None:
    """It begins where the springs hold it, and its weight is where it is then."""
    injected = rig(simulated, machine, effect_of("boom_flexibility", "inner_boom", 0.3, 2.0, 0.05))
    still = np.zeros((500, 4))
    forces, memory = led(injected, POSE + still, still)
    np.testing.assert_allclose(memory - memory[0], 0.0, atol=1e-9)
    assert -0.2 < memory[0, 0] < -0.005  # rad
    np.testing.assert_allclose(forces - forces[0], 0.0, atol=1e-6)


def test_bending_answers_as_two_oscillators(machine: Machine, simulated: SimulatedCrane) -> None:
    """Amplitude at a forced oscillation: m a |r^2 - 2 i z r| / |1 - r^2 + 2 i z r| of both.

    Along the telescope, where neither inertia nor weight depends on how far it is bent.
    """
    share, frequency, damping, forced = 0.3, 2.0, 0.1, 1.2
    injected = rig(
        simulated, machine, effect_of("boom_flexibility", "telescope", share, frequency, damping)
    )
    omega, size = 2 * np.pi * forced, 0.1
    times = STEP * np.arange(round(8.0 / STEP))
    v = np.zeros((len(times), 4))
    v[:, 3] = size * np.sin(omega * times)
    forces, _ = led(injected, np.broadcast_to(POSE, v.shape), v)
    last = times[1:] > 8.0 - 4.0 / forced
    got = 2 * np.abs(np.mean(forces[last, 3] * np.exp(-1j * omega * times[1:][last])))
    slid = simulated.bodies["telescope"].mass + simulated.bodies["gripper"].mass
    total = 0j
    for ratio, part in BENDING_MODES:
        r = forced / (frequency * ratio)
        # e'' + 2 z w e' + w^2 e = -a has e''/a = r^2 / (1 - r^2 + 2 i z r)
        total += share * part * slid * r**2 / (1 - r**2 + 2j * damping * r)
    assert got == pytest.approx(abs(total) * size * omega, rel=0.02)
