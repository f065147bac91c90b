"""The further laws of each family against their formulas, energies and limits."""

import numpy as np
import pytest
from scipy.integrate import quad
from unit.crane_sim.injected_machine import STEP, effect_of, rig
from unit.crane_sim.test_injected_friction import JOINT, SPEEDS, Q, added_friction, place
from unit.crane_sim.test_injected_loads import MOTIONS, asked, lagrange, slope
from unit.crane_sim.test_injected_memory import led, line

from crane_model import Machine
from crane_model.cylinders import cylinder_length, lever_arm
from crane_model.dynamics import Geometry, lagrangian_regressor
from crane_model.terms.gravity_and_load import tip_mass
from crane_sim import SimulatedCrane
from crane_sim.effects.form import InjectedForm

COLUMN = 2
LIMITS = (-2.7, -0.1)  # rad, of the outer boom


@pytest.mark.parametrize("v", SPEEDS)
def test_friction_over_the_speed(machine: Machine, simulated: SimulatedCrane, v: float) -> None:
    """Hill's curve; what a neighbour brings that moves at 0.05 rad/s."""
    for effect, wanted in (
        (effect_of("stribeck", JOINT, 90.0, 0.02, 3.0, form="hill"), 90 / (1 + abs(v / 0.02) ** 3)),
        (effect_of("coupled_friction", JOINT, 90.0, 0.1, form="neighbour_square"), 90 / 4),
        (effect_of("coupled_friction", JOINT, 90.0, 0.05, form="neighbour_slow"), 90 / 2),
    ):
        assert added_friction(rig(simulated, machine, effect), v) == pytest.approx(wanted)


def test_friction_over_load_and_pressure(machine: Machine, simulated: SimulatedCrane) -> None:
    """A power of the load; seals without the lever arm, and of the rod alone."""
    power = rig(
        simulated, machine, effect_of("load_friction", JOINT, 0.05, 800.0, 1.2, form="power")
    )
    assert added_friction(power, 0.1) == pytest.approx(0.05 * 800 * (2500 / 800) ** 1.2)

    cylinder, middle = machine.cylinders[JOINT], np.array([sum(LIMITS) / 2])
    levers = [abs(lever_arm(machine, JOINT, at)[0]) for at in (middle, Q[COLUMN : COLUMN + 1])]
    assert abs(levers[0] / levers[1] - 1) > 0.01  # or the test would not tell them apart
    pressed_a, pressed_b = cylinder.area_a * 5e6, cylinder.area_b * 4e6  # as the rig has them
    free = rig(simulated, machine, effect_of("seal_friction", JOINT, 0.05, 0.7, form="no_lever"))
    wanted = 0.05 * levers[0] * (pressed_a + 0.7 * pressed_b)
    assert added_friction(free, 0.1) == pytest.approx(wanted)
    rod = rig(simulated, machine, effect_of("seal_friction", JOINT, 0.05, 0.2, form="rod_seal"))
    wanted = 0.05 * levers[1] * (0.2 * pressed_a + pressed_b)
    assert added_friction(rod, 0.1) == pytest.approx(wanted)


def test_friction_over_the_place(machine: Machine, simulated: SimulatedCrane) -> None:
    """A slope that is no straight line, and waves with an overtone."""
    u, phase = place(machine), 12.0 * Q[COLUMN] + 0.4
    for effect, wanted in (
        (
            effect_of("position_friction", JOINT, 80.0, 0.3, 1.5, form="tilted_guide"),
            80.0 * np.sign(u - 0.3) * abs(u - 0.3) ** 1.5,
        ),
        (
            effect_of("cyclic_friction", JOINT, 80.0, 12.0, 0.4, 0.3, form="harmonics"),
            80.0 * (np.sin(phase) + 0.3 * np.sin(2 * phase + 0.4)),
        ),
    ):
        assert added_friction(rig(simulated, machine, effect), 0.1) == pytest.approx(wanted)


@pytest.mark.parametrize(
    ("form", "grown", "left"),
    [
        ("kato", lambda x: 1 - np.exp(-(x**0.6)), lambda y: 1 / (1 + y**2)),
        ("logarithm", np.log1p, lambda y: np.exp(-y)),
        ("hyperbola", lambda x: x / (1 + x), lambda y: max(1 - y / 2, 0)),
    ],
)
@pytest.mark.parametrize("rest", [0.2, 2.0])
def test_what_sticks_grows_with_the_rest_and_wears_off(
    machine: Machine, simulated: SimulatedCrane, form: str, grown, left, rest: float
) -> None:
    """Also where bristles let a joint creep while it stands."""
    effect = effect_of("stiction", JOINT, 100.0, 0.5, 4e-3, form=form)
    injected = rig(simulated, machine, effect)
    for _ in range(round(rest / STEP)):
        added_friction(injected, 1e-7)
    at = added_friction(injected, 1e-7)
    assert at == pytest.approx(100.0 * grown(rest / 0.5), rel=1e-2)
    for _ in range(100):  # 2 mm
        after = added_friction(injected, 0.1)
    assert after == pytest.approx(at * left(100 * STEP * 0.1 / 4e-3), rel=1e-2)


def resisted(
    machine: Machine, simulated: SimulatedCrane, effect: InjectedForm, q: float, v: float
) -> float:
    """Force of a push at a place and a speed of its joint, 3 s after the start."""
    injected = rig(simulated, machine, effect)
    injected.injected.clock[0] = 3.0
    pose, speed = Q.copy(), np.zeros(4)
    pose[COLUMN], speed[COLUMN] = q, v
    injected.put(pose, speed)
    injected.act()
    return float(injected.settle()[0, COLUMN])


@pytest.mark.parametrize(
    ("effect", "q", "v", "wanted"),
    [
        (effect_of("viscous_quadratic", JOINT, 50, 0.04, 1.5, form="threshold"), -1, -0.1,
         -50 * 0.06**1.5),
        (effect_of("viscous_quadratic", JOINT, 50, 0.04, 1.5, form="threshold"), -1, 0.03, 0.0),
        (effect_of("warm_up", JOINT, 50, 20, 1.5, form="hyperbolic"), -1, 0.1, 5 / 1.15**1.5),
        (effect_of("warm_up", JOINT, 50, 20, 0.4, form="quick_and_slow"), -1, 0.1,
         5 * (0.4 * np.exp(-0.15) + 0.6 * np.exp(-0.03))),
        (effect_of("hose_stiffness", JOINT, 50, 0.2, 2.0, form="progressive"), -0.75, 0.0,
         50 * np.sinh(2 * (0.65 / 1.3 - 0.2)) / np.sinh(2)),
        (effect_of("end_cushioning", JOINT, 50, 0.2, 0.05, 1.0, form="early"), -0.25, 0.1,
         5 * (1 - 0.1 / 0.2)),
        (effect_of("end_cushioning", JOINT, 50, 0.2, 0.05, 1.0, form="early"), -0.12, 0.1, 5.0),
        (effect_of("end_cushioning", JOINT, 50, 0.2, 0.1, 1.0, form="orifice"), -0.2, 0.1, 2.5),
        (effect_of("end_cushioning", JOINT, 50, 0.2, 0.1, -1.0, form="orifice"), -0.2, 0.1, 0.0),
        (effect_of("cubic_spring", JOINT, 50, 0.5, form="snap"), -0.75, 0.0, 50 * (np.tanh(4) - 1)),
        (effect_of("cubic_spring", JOINT, 50, 0.5, form="toggle"), -1.075, 0.0, 50.0),
        (effect_of("detent", JOINT, 50, 30, 0.1, 1.0, form="wells"), -1.0, 0.0,
         50 * np.sin(-29.9) * np.exp(np.cos(-29.9) - 1)),
        (effect_of("detent", JOINT, 50, 30, 0.1, form="zigzag"), -1.0, 0.0,
         100 / np.pi * np.arcsin(np.sin(-29.9))),
    ],
    ids=lambda one: one.form.name if isinstance(one, InjectedForm) else "",
)  # fmt: skip
def test_pushes_by_their_formulas(
    machine: Machine,
    simulated: SimulatedCrane,
    effect: InjectedForm,
    q: float,
    v: float,
    wanted: float,
) -> None:
    """The range of the outer boom is 2.6 rad about -1.4."""
    got = resisted(machine, simulated, effect, q, v)
    assert got == pytest.approx(wanted, rel=1e-6, abs=1e-9)


@pytest.mark.parametrize("form", ["dahl", "graded", "soft_blocks"])
def test_presliding_builds_up_to_the_friction_that_it_replaces(
    machine: Machine, simulated: SimulatedCrane, form: str
) -> None:
    """On the way there it is monotone; with the exponent 1 it is Dahl's exponential."""
    travel, share = 4e-3, 0.6
    effect, values = ("presliding", (1.0,)) if form == "dahl" else ("maxwell_slip", ())
    values = (0.5,) if form == "graded" else values
    injected = rig(
        simulated, machine, effect_of(effect, "telescope", travel, share, *values, form=form)
    )
    law = simulated.friction["telescope"]
    resistance, noted = led(injected, line(0.5, 0.55))
    most = share * (law.f_c + law.df_c)
    assert resistance[-1] == pytest.approx(most, rel=1e-3)
    assert noted[-1] == pytest.approx(0.0, abs=1e-3 * most)
    assert (np.diff(resistance) > -1e-9 * most).all()
    if form == "dahl":
        way = 0.05 * STEP * np.arange(len(resistance))
        np.testing.assert_allclose(resistance, most * (1 - np.exp(-way / travel)), atol=5e-3 * most)


@pytest.mark.parametrize("form", ["relaxing", "levels", "slackening"])
def test_a_hose_lets_go_while_it_stays_bent(
    machine: Machine, simulated: SimulatedCrane, form: str
) -> None:
    values = (100.0, 0.2, 1.0, *((1.0,) if form == "slackening" else ()))
    injected = rig(simulated, machine, effect_of("relaxing_hose", "telescope", *values, form=form))
    bent = np.concatenate([line(0.5, 0.6, speed=5.0), np.full(round(1.0 / STEP), 0.6)])
    resistance, noted = led(injected, bent)
    np.testing.assert_allclose(resistance, noted, atol=1e-9)
    begin, end = resistance.max(), resistance[-1]
    z = 0.5  # of 0.1 m over 0.2 m; one relaxation time later:
    wanted = {
        "relaxing": (100 * z, 100 * z / np.e),
        "levels": (100 * np.tanh(2 * z), 100 * np.tanh(2 * z / np.e)),
        "slackening": (100 * z, 100 * z / (1 + z)),
    }
    assert (begin, end) == pytest.approx(wanted[form], rel=0.03)


@pytest.mark.parametrize(("q", "v", "a"), MOTIONS)
def test_a_slung_load_is_a_point_at_the_tip(
    machine: Machine, simulated: SimulatedCrane, q: np.ndarray, v: np.ndarray, a: np.ndarray
) -> None:
    held = v * [0, 1, 1, 1]
    got = asked(rig(simulated, machine, effect_of("payload", None, 12.0, form="slung")), q, held, a)
    columns = lagrangian_regressor(
        Geometry.of(machine), q[np.newaxis, 1:], v[np.newaxis, 1:], a[np.newaxis, 1:]
    )
    np.testing.assert_allclose(got[1:], 12.0 * (columns @ tip_mass(machine))[0], rtol=1e-9)


@pytest.mark.parametrize(
    ("form", "shape", "weigh"),
    [("tapered", 0.5, lambda s: s**0.5), ("second", 0.3, lambda s: 1.0 + (s > 0.3))],
)
@pytest.mark.parametrize(("q", "v", "a"), MOTIONS)
def test_hoses_by_lagrange(
    machine: Machine, simulated: SimulatedCrane, form: str, shape: float, weigh, q, v, a
) -> None:
    """Energies of a hose whose density at s along it is `weigh`, by quadrature."""
    density = 3.0

    def moment(out: float, order: int) -> float:
        kinks = [shape] if shape < out else None
        return density * float(quad(lambda s: weigh(s) * s**order, 0.0, out, points=kinks)[0])

    def kinetic(q: np.ndarray, v: np.ndarray) -> float:
        turned = (v[1] + v[2]) ** 2 + (v[0] * np.cos(q[1] + q[2])) ** 2
        return 0.5 * (moment(q[3], 2) * turned + moment(q[3], 0) * v[3] ** 2)

    def potential(q: np.ndarray) -> float:
        return moment(q[3], 1) * machine.gravity * float(np.sin(q[1] + q[2]))

    wanted = lagrange(kinetic, q, v, a) + slope(potential, q)
    got = asked(
        rig(simulated, machine, effect_of("hose_mass", None, density, shape, form=form)), q, v, a
    )
    np.testing.assert_allclose(got, wanted, rtol=1e-3, atol=1e-3 * np.abs(wanted).max())


@pytest.mark.parametrize(("q", "v", "a"), MOTIONS)
def test_a_column_of_oil_by_lagrange(
    machine: Machine, simulated: SimulatedCrane, q: np.ndarray, v: np.ndarray, a: np.ndarray
) -> None:
    mass, gradient = 40.0, 0.3

    def kinetic(q: np.ndarray, v: np.ndarray) -> float:
        ends = q[COLUMN] + 1e-4 * v[COLUMN] * np.array([-1.0, 1.0])
        rate = np.diff(cylinder_length(machine, JOINT, ends))[0] / 2e-4
        return 0.5 * mass * (1 + gradient * (q[COLUMN] + 1.4) / 1.3) * rate**2

    effect = effect_of("actuator_inertia", JOINT, mass, gradient, form="oil_column")
    got = asked(rig(simulated, machine, effect), q, v, a)
    assert got[COLUMN] == pytest.approx(lagrange(kinetic, q, v, a)[COLUMN], rel=1e-3, abs=1e-3)
