"""Injected friction and pushes against the laws as textbooks have them."""

import numpy as np
import pytest
from unit.crane_sim.injected_machine import Rig, effect_of, rig

from crane_model import Machine, load_machine
from crane_model.cylinders import lever_arm
from crane_sim import SimulatedCrane
from crane_sim.effects.form import InjectedForm

JOINTS = load_machine().joint_names

JOINT, COLUMN = "outer_boom", 2
Q = np.array([0.1, 0.4, -1.2, 0.7])
SPEEDS = np.array([-0.2, -0.03, -0.004, 0.004, 0.03, 0.2])
DRIVE = np.array([0.0, 9000.0, -2500.0, 1200.0])


def added_friction(machine_rig: Rig, v: float, drive: np.ndarray = DRIVE) -> float:
    """Coulomb friction that is added at the joint; the same in both directions."""
    nominal = machine_rig.constants.friction[COLUMN]
    machine_rig.put(Q, np.array([0.0, 0.05, v, 0.1]), drive)
    machine_rig.act()
    up = machine_rig.scratch.law[COLUMN]["coulomb_up"] - nominal["coulomb_up"]
    assert machine_rig.scratch.law[COLUMN]["coulomb_down"] - nominal[
        "coulomb_down"
    ] == pytest.approx(up)
    force = machine_rig.settle()
    assert force[0, COLUMN] == pytest.approx(up * np.sign(v))
    assert (np.delete(force[0], COLUMN) == 0.0).all()
    return float(up)


def place(machine: Machine) -> float:
    limits = machine.limits[JOINT]
    return (2 * Q[COLUMN] - limits.position_max - limits.position_min) / (
        limits.position_max - limits.position_min
    )


@pytest.mark.parametrize("v", SPEEDS)
def test_friction_over_the_speed(machine: Machine, simulated: SimulatedCrane, v: float) -> None:
    """Stribeck's excess in two siblings; what the neighbour's speed brings."""
    for effect, wanted in (
        (effect_of("stribeck", JOINT, 90.0, 0.02), 90.0 / (1.0 + (v / 0.02) ** 2)),
        (effect_of("stribeck", JOINT, 90.0, 0.02, form="sech"), 90.0 / np.cosh(v / 0.02)),
        (effect_of("coupled_friction", JOINT, 90.0, 0.1), 90.0 * 0.05 / 0.1),
    ):
        assert added_friction(rig(simulated, machine, effect), v) == pytest.approx(wanted)


def test_friction_over_load_and_pressure(machine: Machine, simulated: SimulatedCrane) -> None:
    """Hypotenuse of load and corner; what gravity asks; powers of the pressures."""
    smooth = rig(simulated, machine, effect_of("load_friction", JOINT, 0.05, 200.0))
    assert added_friction(smooth, 0.1) == pytest.approx(0.05 * np.hypot(2500.0, 200.0))

    weight = rig(simulated, machine, effect_of("load_friction", JOINT, 0.05, form="weight"))
    got = added_friction(weight, 0.1)
    assert got == pytest.approx(0.05 * abs(weight.scratch.bias[COLUMN]))

    seal = rig(simulated, machine, effect_of("seal_friction", JOINT, 0.05, 0.8))
    p_a, p_b = (seal.state.actuators[name][COLUMN] for name in ("p_a", "p_b"))
    cylinder = machine.cylinders["outer_boom"]
    pressed = sum(
        area * 5e6 * (p / 5e6) ** 0.8
        for area, p in ((cylinder.area_a, p_a), (cylinder.area_b, p_b))
    )
    lever = abs(lever_arm(machine, JOINT, Q[COLUMN : COLUMN + 1])[0])
    assert added_friction(seal, 0.1) == pytest.approx(0.05 * lever * pressed)


def test_friction_over_the_position(machine: Machine, simulated: SimulatedCrane) -> None:
    """A bump, a smooth step, a triangle and a rectified sine."""
    u = place(machine)
    triangle = 2 / np.pi * np.arcsin(np.sin(12.0 * Q[COLUMN] + 0.4))
    for effect, wanted in (
        (effect_of("position_friction", JOINT, 80.0, 0.1, 0.3), 80.0 * np.tanh((u - 0.1) / 0.3)),
        (
            effect_of("position_friction", JOINT, 80.0, 0.1, 0.3, form="worn_zone"),
            80.0 * np.exp(-(((u - 0.1) / 0.3) ** 2)),
        ),
        (effect_of("cyclic_friction", JOINT, 80.0, 12.0, 0.4), 80.0 * triangle),
        (
            effect_of("cyclic_friction", JOINT, 80.0, 12.0, 0.4, form="rectified"),
            80.0 * (abs(np.sin(6.0 * Q[COLUMN] + 0.4)) - 2 / np.pi),
        ),
    ):
        assert added_friction(rig(simulated, machine, effect), 0.1) == pytest.approx(wanted)


def test_pads_carry_a_beam_on_two_supports(machine: Machine, simulated: SimulatedCrane) -> None:
    """Forces on the pads from the balance of forces and moments, solved as equations."""
    injected = rig(simulated, machine, effect_of("pad_friction", "telescope", 0.1))
    injected.put(Q, np.array([0.0, 0.0, 0.0, 0.1]))
    injected.act()
    across = machine.gravity * np.cos(Q[1] + Q[2])
    tip = machine.as_planar().telescope_length + Q[3]
    bodies = (simulated.bodies["telescope"], simulated.bodies["gripper"])
    weight = sum(body.mass * across for body in bodies)
    moment = sum(body.mass * across * (tip + body.centre_of_mass[0]) for body in bodies)
    front, rear = 1.1, 1.1 - (1.95 - Q[3])  # where the pads are, from the elbow
    pads = np.linalg.solve([[1.0, 1.0], [front, rear]], [weight, moment])
    added = injected.scratch.law[3]["coulomb_up"] - injected.constants.friction[3]["coulomb_up"]
    assert added == pytest.approx(0.1 * np.abs(pads).sum())


def test_breakaway_grows_at_rest_and_is_gone_after_some_travel(
    machine: Machine, simulated: SimulatedCrane
) -> None:
    """1 - exp(-(t/growth)^0.6) at rest, then one over one plus the square of the way."""
    injected = rig(simulated, machine, effect_of("stiction", JOINT, 300.0, 0.8, 5e-3))
    for _ in range(2000):  # 0.4 s
        at_rest = added_friction(injected, 0.0)
    assert at_rest == pytest.approx(300.0 * (1 - np.exp(-((0.4 / 0.8) ** 0.6))), rel=1e-3)
    for _ in range(500):  # 10 mrad
        moving = added_friction(injected, 0.1)
    assert moving == pytest.approx(at_rest / (1 + (0.01 / 5e-3) ** 2), rel=0.01)
    for _ in range(5000):
        moving = added_friction(injected, 0.1)
    assert moving == 0.0


def test_wear_jumps_once(machine: Machine, simulated: SimulatedCrane) -> None:
    """Nothing before its time, all of it after."""
    injected = rig(simulated, machine, effect_of("wear_jump", JOINT, 70.0, 2.0))
    assert added_friction(injected, 0.1) == 0.0
    injected.injected.clock[0] = 2.1
    assert added_friction(injected, 0.1) == pytest.approx(70.0)


def test_friction_never_turns_into_a_drive(machine: Machine, simulated: SimulatedCrane) -> None:
    """What is taken away leaves some of Coulomb friction (13)."""
    strong = effect_of("position_friction", JOINT, 1e5, 0.9, 0.1)
    injected = rig(simulated, machine, strong)
    injected.put(Q, np.array([0.0, 0.0, 0.1, 0.0]))
    injected.act()
    assert injected.scratch.law[COLUMN]["coulomb_up"] > 0.0
    assert injected.scratch.law[COLUMN]["coulomb_down"] > 0.0


@pytest.mark.parametrize("v", SPEEDS)
def test_pushes_on_one_joint(machine: Machine, simulated: SimulatedCrane, v: float) -> None:
    """Each resists by its formula, and is noted with that force."""
    u = place(machine)
    half = np.ptp([machine.limits[JOINT].position_min, machine.limits[JOINT].position_max]) / 2
    reach = half + 0.2  # the zone of the cushion reaches beyond the middle
    depth = max(0.0, 1.0 - (1.0 - abs(u)) * half / reach)
    warm = np.exp(1.2 * np.exp(-5.0 / 30.0)) - 1.0
    cases: list[tuple[InjectedForm, float]] = [
        (effect_of("viscous_quadratic", JOINT, 500.0, 1.8), 500.0 * np.sign(v) * abs(v) ** 1.8),
        (
            effect_of("viscous_quadratic", JOINT, 500.0, 0.01, form="rounded"),
            500.0 * v * np.hypot(v, 0.01),
        ),
        (effect_of("warm_up", JOINT, 500.0, 30.0, 1.2), 500.0 * v * warm / (np.exp(1.2) - 1.0)),
        (effect_of("hose_stiffness", JOINT, 60.0, 0.9), 60.0 * np.tanh(u / 0.9)),
        (
            effect_of("hose_stiffness", JOINT, 60.0, -0.8, form="cord"),
            30.0 * (u + 0.8 + np.sqrt((u + 0.8) ** 2 + 0.04)),
        ),
        (effect_of("end_cushioning", JOINT, 60.0, reach), 60.0 * v * depth**1.5),
        (effect_of("cubic_spring", JOINT, 60.0, 0.5), 60.0 * ((u / 0.5) ** 3 - u / 0.5)),
        (effect_of("detent", JOINT, 60.0, 30.0, 0.2), 60.0 * np.sin(30.0 * Q[COLUMN] + 0.2)),
    ]
    for effect, wanted in cases:
        injected = rig(simulated, machine, effect)
        injected.injected.clock[0] = 5.0
        injected.put(Q, np.array([0.0, 0.05, v, 0.1]), DRIVE)
        injected.act()
        assert DRIVE[COLUMN] - injected.scratch.force[COLUMN] == pytest.approx(wanted), effect.form
        assert (np.delete(injected.scratch.force - DRIVE, COLUMN) == 0.0).all()
        assert injected.settle()[0, COLUMN] == pytest.approx(wanted)


def test_joints_are_those_of_the_suite() -> None:
    """The columns that these tests look at."""
    assert JOINTS[COLUMN] == JOINT
