"""The plant of other make against the physics that it shares with nobody's code."""

import subprocess
import sys
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

from crane_bags import read_topics
from crane_bags.types import CYLINDER_PRESSURES, JOINT_REFERENCE, JOINT_STATES, VALVE_COMMAND
from crane_benchmark.independent.effects import FORCE_FORMS, FRICTION_FORMS, Rubbed, rubbing
from crane_benchmark.independent.parts import (
    ATMOSPHERE,
    POLYTROPE,
    Make,
    MujocoBodies,
    bent,
    modulus,
    orifice,
    relaxed,
)
from crane_benchmark.independent.plant import IndependentPlant
from crane_model import Machine, RangeError, generalized_forces, load_machine
from crane_model.machine_files import machine_file
from crane_sim import SimulatedCrane, load_simulated_crane, make
from crane_sim.effects.form import Form, InjectedForm
from crane_sim.parts.constants import pack_chain
from crane_sim.parts.rigid_bodies import mass_and_bias
from crane_trajectory import load_clearance, load_trajectory, plan
from crane_trajectory.control.controller import load_gains

pytest.importorskip("mujoco")


MAKE = Make(air=1e-3, stiffening=5.0, pump_lag=0.01)
FORMS = (*FRICTION_FORMS, *FORCE_FORMS)
SHARED = """
import sys
import crane_benchmark.independent.plant
own = ("parts.constants", "parts.cylinders", "parts.rigid_bodies", "plant.plant",
       "effects.friction", "effects.flow", "effects.forms", "effects.kernel", "effects.loads",
       "effects.memory", "effects.pushes", "effects.working", "effects.bending")
print(*(one for one in own if f"crane_sim.{one}" in sys.modules))
"""


@pytest.fixture(scope="module")
def machine() -> Machine:
    return load_machine()


@pytest.fixture(scope="module")
def simulated() -> SimulatedCrane:
    return load_simulated_crane()


class Ridden(NamedTuple):
    """n samples of j joints."""

    q: np.ndarray
    v: np.ndarray
    a: np.ndarray
    drive: np.ndarray
    hidden: np.ndarray


def ridden(plant: IndependentPlant, seconds: float) -> Ridden:
    """To and fro, every joint in a time of its own, from rest."""
    kept, machine = [], plant.machine
    for t in np.arange(0.0, seconds, 0.005):
        command = 0.3 * np.sin(2.0 * np.pi * t / np.array([2.9, 2.3, 1.7, 2.0]))
        plant.advance(command, 0.005)
        kept.append(
            (
                *(plant.q, plant.v, plant.acceleration, plant.pressure_a, plant.pressure_b),
                plant.injected_force.sum(axis=0),
            )
        )
    q, v, a, p_a, p_b, hidden = (np.array(part) for part in zip(*kept, strict=True))
    return Ridden(q, v, a, generalized_forces(machine, q, p_a, p_b, machine.joint_names), hidden)


def balance(simulated: SimulatedCrane, machine: Machine, seen: Ridden) -> np.ndarray:
    """(n, j) what the drives give beyond inertia, weight and the friction (13), by the code of
    `crane_sim`.
    """
    chain, rest = pack_chain(simulated, machine), seen.drive.copy()
    law = [simulated.friction[joint] for joint in machine.joint_names]
    f_c, df_c, f_v, df_v = (
        np.array([getattr(parameters, key) for parameters in law])
        for key in ("f_c", "df_c", "f_v", "df_v")
    )
    mass, bias = np.zeros((4, 4)), np.zeros(4)
    for k, (q, v, a) in enumerate(zip(seen.q, seen.v, seen.a, strict=True)):
        mass_and_bias(chain, q, v, mass, bias)
        rest[k] -= mass @ a + bias + f_c * np.sign(v) + df_c + f_v * v + df_v * np.abs(v)
    return rest


def rms(values: np.ndarray) -> np.ndarray:
    return np.asarray(np.sqrt(np.mean(values**2, axis=0)))


def test_shares_no_code_of_the_simulated_cranes_plant() -> None:
    run = subprocess.run([sys.executable, "-c", SHARED], capture_output=True, text=True, check=True)
    assert run.stdout.strip() == ""


def test_bodies_are_those_of_the_machine(simulated: SimulatedCrane, machine: Machine) -> None:
    bodies, chain = MujocoBodies(simulated, machine), pack_chain(simulated, machine)
    rng, mass, bias = np.random.default_rng(4), np.zeros((4, 4)), np.zeros(4)
    for _ in range(200):
        q = simulated.start + rng.normal(0.0, 0.3, 4)
        v, a = rng.normal(0.0, 1.5, (2, 4))
        mass_and_bias(chain, q, v, mass, bias)
        found_mass, found_bias = bodies.at(q, v)
        np.testing.assert_allclose(found_mass @ a + found_bias, mass @ a + bias, rtol=1e-10)


def test_stays_where_it_is_held(simulated: SimulatedCrane, machine: Machine) -> None:
    plant = IndependentPlant(simulated, machine, MAKE, simulated.start)
    plant.leak(np.array([-cylinder.leakage for cylinder in simulated.cylinders.values()]))
    plant.advance(np.zeros(4), 5.0)
    assert np.abs(plant.q - simulated.start).max() < 1e-6
    assert np.abs(plant.v).max() < 1e-6


def test_drives_carry_inertia_weight_and_friction(
    simulated: SimulatedCrane, machine: Machine
) -> None:
    seen = ridden(IndependentPlant(simulated, machine, MAKE, simulated.start), 8.0)
    moving = np.abs(seen.v) > 0.02
    rest = np.where(moving, balance(simulated, machine, seen), 0.0)
    assert moving.mean(axis=0).min() > 0.4
    assert (rms(rest) < 0.003 * rms(seen.drive)).all()


def test_a_joint_turns_without_a_kick(simulated: SimulatedCrane, machine: Machine) -> None:
    """Also where it rubs more one way than the other: dry friction is bounded, so is its jump."""
    law = {
        joint: friction.model_copy(update={"df_c": 0.3 * friction.f_c})
        for joint, friction in simulated.friction.items()
    }
    one_way = simulated.model_copy(update={"friction": law})
    seen = ridden(IndependentPlant(one_way, machine, MAKE, simulated.start), 8.0)
    fastest = np.abs(seen.a)
    assert (fastest.max(axis=0) < 3.0 * np.percentile(fastest, 99.0, axis=0)).all()


MOVING = [form for form in FORMS if form.effect != "stiction"]


@pytest.mark.parametrize("form", MOVING, ids=lambda form: f"{form.effect}-{form.name}")
def test_a_hidden_law_shows_in_what_the_drives_give(
    simulated: SimulatedCrane, machine: Machine, form: Form
) -> None:
    joint = "outer_boom"
    size = 6.0 * form.magnitude.start * form.magnitude.of(simulated, joint)
    drawn = [draw.highest * draw.of(simulated, joint) for draw in form.draws]
    start = simulated.start.copy()
    start[2] = machine.limits[joint].position_max - 0.2  # where ends are cushioned too
    effects = InjectedForm(form, joint, (size, *drawn))
    seen = ridden(IndependentPlant(simulated, machine, MAKE, start, [effects]), 3.0)
    moving = np.abs(seen.v) > 0.02
    rest = np.where(moving, balance(simulated, machine, seen), 0.0)
    if form.effect == "presliding":  # beside the dry friction that it becomes
        rest[:, 2] -= np.where(moving[:, 2], size * np.sign(seen.v[:, 2]), 0.0)
    left = rms(rest - np.where(moving, seen.hidden, 0.0))
    assert np.abs(seen.hidden[:, [0, 1, 3]]).max() == 0.0
    assert (left < 0.006 * rms(seen.drive)).all()
    assert left[2] < 0.5 * rms(rest)[2]


@pytest.mark.parametrize("law", [form.law for form in FORMS if form.effect == "stiction"])
def test_what_sticks_grows_with_the_rest_and_wears_off(law: int) -> None:
    """More after a longer rest, nothing while it goes on sliding, and anew after the next rest."""
    value, memory = np.array([100.0, 1.0, 5e-3, 0.0, 0.0, 0.0]), np.zeros(3)

    def led(v: float, seconds: float) -> float:
        at = Rubbed(0.0, 0.0, v, 0.0, 0.0, 0.2, 5e6, 4e6, 3e-3, 2e-3)
        for _ in range(round(seconds / 1e-3)):
            extra = rubbing(law, value, memory, 0.2, at, 1e-3)
        return float(extra)

    assert led(0.05, 1.0) == pytest.approx(0.0, abs=1e-6)
    short, long = led(1e-6, 0.3), led(1e-6, 2.7)
    assert 5.0 < short < 0.8 * long < 100.0
    assert led(0.05, 0.01) > 0.4 * long  # half a millimetre on
    assert led(0.05, 2.0) == pytest.approx(0.0, abs=0.1)
    assert led(1e-6, 0.3) == pytest.approx(short, rel=1e-6)
    stuck = led(1e-6, 5.0)
    led(1e-3, 0.1)  # a tenth of a millimetre, a fiftieth of the travel
    assert led(1e-6, 1e-3) == pytest.approx(stuck, rel=0.03)


def test_a_law_without_a_branch_is_refused(simulated: SimulatedCrane, machine: Machine) -> None:
    for number in (
        max(form.law for form in FRICTION_FORMS) + 1,
        max(form.law for form in FORCE_FORMS) + 1,
    ):
        stray = InjectedForm(FRICTION_FORMS[0]._replace(law=number), "telescope", (1.0, 0.1, 1.0))
        plant = IndependentPlant(simulated, machine, MAKE, simulated.start, [stray])
        with pytest.raises(ValueError, match="give it one"):
            plant.advance(np.zeros(4), 0.01)


def test_oil_is_as_stiff_as_its_volume_says() -> None:
    stiffness, air = 1.3e9, 2e-3

    def volume(pressure: float) -> float:
        bubbles = air * (ATMOSPHERE / (pressure + ATMOSPHERE)) ** (1.0 / POLYTROPE)
        return 1.0 - (pressure - 5e6) / stiffness + bubbles

    for pressure in (1e6, 5e6):
        slope = (volume(pressure + 10.0) - volume(pressure - 10.0)) / 20.0
        expected = -volume(pressure) / slope
        assert modulus(pressure, stiffness, 0.0, air) == pytest.approx(expected, rel=5e-3)
    assert modulus(2e7, stiffness, 5.0, 0.0) == pytest.approx(stiffness + 1e8)


def test_an_orifice_is_laminar_and_then_turbulent() -> None:
    gain = 2e-7
    assert orifice(gain, 0.5, 3.5e6)[0] == pytest.approx(0.5 * gain * np.sqrt(3.5e6), rel=1e-6)
    small, smaller = orifice(gain, 1.0, 200.0)[0], orifice(gain, 1.0, 100.0)[0]
    assert small == pytest.approx(2.0 * smaller, rel=1e-2)
    assert orifice(gain, 1.0, -200.0)[0] == -small
    assert orifice(gain, 1.0, 0.999)[0] == pytest.approx(orifice(gain, 1.0, 1.001)[0], rel=1e-2)


def test_pressure_relaxes_to_its_rest_in_one_long_step() -> None:
    assert relaxed(1e6, 4e9, 2e3, 1.0) == pytest.approx(1e6 + 4e9 / 2e3)
    assert relaxed(1e6, 4e9, 0.0, 1e-4) == pytest.approx(1e6 + 4e5)


def test_bristles_hold_without_creeping_and_slip_at_their_largest() -> None:
    z = 0.0
    for step in range(20000):  # a push to and fro within what is elastic
        z = bent(z, 1e-3 * np.cos(step * 1e-4 * 20.0 * np.pi), 1e-4, 1e-4)
    assert abs(z) < 2e-6  # two whole swings: back where it was
    for _ in range(100):
        z = bent(z, 0.05, 1e-4, 1e-4)
    assert z == pytest.approx(1e-4, rel=1e-3)


def test_refuses_what_it_cannot_do(simulated: SimulatedCrane, machine: Machine) -> None:
    plant = IndependentPlant(simulated, machine, MAKE, simulated.start)
    with pytest.raises(RangeError, match="must be finite"):
        plant.advance(np.full(4, np.nan), 0.01)


def test_is_recorded_like_the_simulated_crane(
    tmp_path: Path, simulated: SimulatedCrane, machine: Machine
) -> None:
    trajectory = load_trajectory(machine_file("excitation_20s.yaml"))
    clearance = load_clearance(machine_file("clearance.yaml"))
    motion = plan(machine, trajectory, simulated.start, 1, clearance)
    gains = load_gains(machine_file("controller.yaml"), machine)
    build = partial(IndependentPlant, simulated, machine, MAKE)
    clean = make(tmp_path / "bag", machine, simulated, motion, gains, 1, build=build)
    topics = (JOINT_STATES, CYLINDER_PRESSURES, VALVE_COMMAND, JOINT_REFERENCE)
    found = read_topics(tmp_path / "bag", topics)
    states = found[JOINT_STATES.name]
    assert states.names == machine.joint_names
    assert all(len(found[topic.name].stamp) == len(clean.time) for topic in topics)
    position = states.fields["position"]
    reference = found[JOINT_REFERENCE.name].fields["position"]
    assert rms(position - reference).max() < 0.06  # controlled by (36), as the simulated crane is
    counts = np.array(
        [simulated.sensors.encoder_resolution[joint_name] for joint_name in machine.joint_names]
    )
    assert (np.abs(position - clean.position) <= 0.51 * counts).all()
