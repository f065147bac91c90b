"""Injected loads against potential energies, differentiated numerically, and crane_model."""

from collections.abc import Callable

import numpy as np
import pytest
from unit.crane_sim.injected_machine import STEP, Rig, effect_of, rig

from crane_model import Machine, tip_jacobian
from crane_model.cylinders import cylinder_length
from crane_model.dynamics import Geometry, lagrangian_regressor
from crane_model.machine_files import machine_file
from crane_model.terms.gravity_and_load import tip_mass
from crane_sim import SimulatedCrane
from crane_sim.calibration import Slewing, slewing
from crane_sim.parts.parameters import Body
from crane_trajectory import load_clearance, plan
from crane_trajectory.motion.periodic import PeriodicTrajectory

POSES = np.array([[0.2, 0.4, -1.2, 0.7], [-0.5, 1.1, -2.2, 0.2], [0.0, -0.2, -0.4, 1.4]])
RATES = np.array([[0.2, 0.1, -0.3, 0.4], [-0.3, -0.15, 0.2, -0.3], [0.1, 0.2, 0.3, 0.2]])
CHANGES = np.array([[0.0, 0.8, -1.0, 0.5], [0.0, -0.4, 0.9, 1.0], [0.0, 0.3, 0.2, -0.7]])

MOTIONS = list(zip(POSES, RATES, CHANGES, strict=True))


def asked(machine_rig: Rig, q: np.ndarray, v: np.ndarray, a: np.ndarray) -> np.ndarray:
    """(4,) what one effect asks of the drives at an acceleration."""
    machine_rig.put(q, v)
    machine_rig.act()
    return machine_rig.settle(v + STEP * a)[0]


def slope(energy: Callable[[np.ndarray], float], q: np.ndarray) -> np.ndarray:
    """(4,) derivative of an energy."""
    steps = 1e-5 * np.eye(4)
    return np.array([(energy(q + step) - energy(q - step)) / 2e-5 for step in steps])


def lagrange(
    kinetic: Callable[[np.ndarray, np.ndarray], float],
    q: np.ndarray,
    v: np.ndarray,
    a: np.ndarray,
) -> np.ndarray:
    """(4,) d/dt dT/dv - dT/dq by differences along the motion."""

    def momentum(time: float) -> np.ndarray:
        place, rate = q + time * v + time**2 / 2 * a, v + time * a
        return slope(lambda speed: kinetic(place, speed), rate)

    ahead = 1e-4
    return (momentum(ahead) - momentum(-ahead)) / (2 * ahead) - slope(
        lambda place: kinetic(place, v), q
    )


@pytest.mark.parametrize(("q", "v", "a"), MOTIONS)
def test_payload_is_a_body_at_the_tip(
    machine: Machine, simulated: SimulatedCrane, q: np.ndarray, v: np.ndarray, a: np.ndarray
) -> None:
    """A point mass at the tip as crane_model has it; farther out and with inertia it asks more."""
    held = v * [0, 1, 1, 1]
    got = asked(rig(simulated, machine, effect_of("payload", None, 12.0, 0.0, 0.0)), q, held, a)
    columns = lagrangian_regressor(
        Geometry.of(machine), q[np.newaxis, 1:], v[np.newaxis, 1:], a[np.newaxis, 1:]
    )
    np.testing.assert_allclose(got[1:], 12.0 * (columns @ tip_mass(machine))[0], rtol=1e-9)
    body = asked(rig(simulated, machine, effect_of("payload", None, 12.0, 0.0, 0.3)), q, held, a)
    turning = 12.0 * 0.3**2 * (a[1] + a[2])
    np.testing.assert_allclose(body - got, [0.0, turning, turning, 0.0], atol=1e-6)


@pytest.mark.parametrize("q", POSES)
def test_tilt_turns_gravity(machine: Machine, simulated: SimulatedCrane, q: np.ndarray) -> None:
    """Change of the potential energy of all bodies when the vertical is turned by the angle."""
    dh, bodies, angle = machine.as_planar(), simulated.bodies, 0.05

    def place(body: Body, q: np.ndarray, carried: bool, slides: bool) -> tuple[float, float]:
        phi, psi = q[1] + dh.theta_2_0, q[1] + q[2]
        along, normal, _ = body.centre_of_mass
        if slides:
            along, normal = along + dh.telescope_length + q[3], normal + dh.telescope_offset
        direction = psi if carried else phi
        point = (along + 1j * normal) * np.exp(1j * direction)
        if carried:
            point += dh.inner_boom_length * np.exp(1j * phi)
        return point.real, point.imag

    def energy(q: np.ndarray) -> float:
        total = 0.0
        for body, carried, slides in (
            (bodies["inner_boom"], False, False),
            (bodies["outer_boom"], True, False),
            (bodies["telescope"], True, True),
            (bodies["gripper"], True, True),
        ):
            r, z = place(body, q, carried, slides)
            total += body.mass * machine.gravity * (z * (np.cos(angle) - 1) + r * np.sin(angle))
        return total

    got = asked(
        rig(simulated, machine, effect_of("base_tilt", None, angle)), q, np.zeros(4), np.zeros(4)
    )
    np.testing.assert_allclose(got[1:], slope(energy, q)[1:], rtol=1e-6)


@pytest.mark.parametrize(("q", "v", "a"), MOTIONS)
def test_hose_by_lagrange(
    machine: Machine, simulated: SimulatedCrane, q: np.ndarray, v: np.ndarray, a: np.ndarray
) -> None:
    """Energies of a hose of many short pieces between reel and tip of the telescope."""
    density, pieces = 3.0, (np.arange(2000) + 0.5) / 2000

    def kinetic(q: np.ndarray, v: np.ndarray) -> float:
        turned = (v[1] + v[2]) ** 2 + (v[0] * np.cos(q[1] + q[2])) ** 2
        return 0.5 * density * q[3] * (np.mean((pieces * q[3]) ** 2) * turned + v[3] ** 2)

    def potential(q: np.ndarray) -> float:
        height = np.mean(pieces) * q[3] * np.sin(q[1] + q[2])
        return density * q[3] * machine.gravity * height

    wanted = lagrange(kinetic, q, v, a) + slope(potential, q)
    got = asked(rig(simulated, machine, effect_of("hose_mass", None, density)), q, v, a)
    np.testing.assert_allclose(got, wanted, rtol=1e-4, atol=1e-3)


@pytest.mark.parametrize("joint", [1, 2, 3])
@pytest.mark.parametrize(("q", "v", "a"), MOTIONS)
def test_rod_by_lagrange(
    machine: Machine,
    simulated: SimulatedCrane,
    joint: int,
    q: np.ndarray,
    v: np.ndarray,
    a: np.ndarray,
) -> None:
    """T = m x'^2/2 with the cylinder's length x(q), x' from differences."""
    name, mass = ("slew", "inner_boom", "outer_boom", "telescope")[joint], 40.0

    def kinetic(q: np.ndarray, v: np.ndarray) -> float:
        ends = q[joint] + 1e-4 * v[joint] * np.array([-1.0, 1.0])
        rate = np.diff(cylinder_length(machine, name, ends))[0] / 2e-4
        return 0.5 * mass * rate**2

    got = asked(rig(simulated, machine, effect_of("actuator_inertia", name, mass)), q, v, a)
    wanted = lagrange(kinetic, q, v, a)
    assert got[joint] == pytest.approx(wanted[joint], rel=1e-3, abs=1e-3)
    assert (np.delete(got, joint) == 0.0).all()


@pytest.mark.parametrize("q", POSES)
def test_wind_pushes_the_tip_sideways(
    machine: Machine, simulated: SimulatedCrane, q: np.ndarray
) -> None:
    """Its force does the work of a horizontal force at the tip, and is not always the same."""
    injected = rig(simulated, machine, effect_of("wind", None, 50.0, 0.3))
    jacobian = tip_jacobian(machine, q)[0]
    outward = (np.cos(q[0]) * jacobian[0] + np.sin(q[0]) * jacobian[1])[1:]
    pushes = []
    for time in (1.0, 1.7, 2.9):
        injected.injected.clock[0] = time
        got = asked(injected, q, np.zeros(4), np.zeros(4))[1:]
        push = got @ outward / (outward @ outward)
        np.testing.assert_allclose(got, push * outward, atol=1e-9)
        pushes.append(push)
    assert np.ptp(pushes) > 5.0


@pytest.mark.parametrize("q", POSES)
def test_slewing_is_noted_and_not_added(
    machine: Machine, simulated: SimulatedCrane, q: np.ndarray
) -> None:
    """-dT/dq of the inertia about the slew axis at constant slew speed."""
    injected = rig(simulated, machine, effect_of("slew_coupling", None, 0.3, 0.6))
    v = np.array([0.3, 0.05, -0.1, 0.2])

    def kinetic(q: np.ndarray) -> float:
        probe = rig(simulated, machine, effect_of("base_tilt", None, 0.0))
        probe.put(q, np.zeros(4))
        return 0.5 * probe.scratch.mass[0, 0] * v[0] ** 2

    injected.put(q, v)
    mass, bias = injected.scratch.mass.copy(), injected.scratch.bias.copy()
    injected.act()
    np.testing.assert_array_equal(injected.scratch.mass, mass)
    np.testing.assert_array_equal(injected.scratch.bias, bias)
    got = injected.settle(v)[0]
    np.testing.assert_allclose(got[1:], -slope(kinetic, q)[1:], rtol=1e-6, atol=1e-6)


def test_slewing_begins_and_ends_at_rest(
    machine: Machine, simulated: SimulatedCrane, trajectory: PeriodicTrajectory
) -> None:
    """Whole swings within the limits; the booms go as they would."""
    motion = plan(
        machine, trajectory, simulated.start, 1, load_clearance(machine_file("clearance.yaml"))
    )
    assert slewing(motion, ()) is motion
    led = slewing(motion, (effect_of("slew_coupling", None, 0.3, 0.6),))
    assert isinstance(led, Slewing)
    time = np.linspace(-1.0, led.duration + 1.0, 20001)
    reference = led.reference(time)
    np.testing.assert_allclose(reference.position[[0, -1]], motion.reference(time[[0, -1]])[0])
    np.testing.assert_allclose(reference.velocity[[0, -1]], 0.0, atol=1e-9)
    assert np.abs(reference.velocity[:, 0]).max() == pytest.approx(0.3, rel=1e-3)
    assert reference.position[:, 0].max() < machine.limits["slew"].position_max
    np.testing.assert_allclose(
        np.gradient(reference.position[:, 0], time)[1:-1], reference.velocity[1:-1, 0], atol=1e-3
    )
    np.testing.assert_array_equal(reference.position[:, 1:], motion.reference(time)[0][:, 1:])
