"""Injected effects in a machine that moves: balance of forces, magnitudes, and refusals."""

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from unit.crane_sim.injected_machine import effect_of, inverse_dynamics

from crane_model import ConfigurationError, Machine, RangeError, load_machine
from crane_model.machine_files import machine_file
from crane_sim import InjectedEffect, Plant, Sensors, SimulatedCrane, Spec, calibrate, record
from crane_sim.calibration import MAX_TRIES, UnmovedError, draw, moved, reach
from crane_sim.effects.forces import SLIDING_SPEED
from crane_sim.effects.form import InjectedForm
from crane_sim.effects.kernel import FORMS
from crane_sim.effects.sensing import faults
from crane_sim.ground_truth import (
    check_place,
    clean_path,
    ground_truth,
    load_injected,
    write_ground_truth,
)
from crane_sim.parts.constants import pack_chain
from crane_sim.parts.parameters import column
from crane_trajectory.control.controller import Gains, load_gains
from crane_trajectory.motion.motion import Reference

JOINTS = load_machine().joint_names
PLANAR_JOINTS = load_machine().as_planar().joints

CATALOGUE = {
    "stribeck", "stiction", "presliding", "maxwell_slip", "load_friction", "seal_friction",
    "pad_friction", "position_friction", "cyclic_friction", "viscous_quadratic", "warm_up",
    "pressure_offset", "pressure_gain", "chamber_gain", "encoder_offset", "base_tilt", "payload",
    "hose_stiffness", "hose_mass", "actuator_inertia", "backlash", "boom_flexibility", "time_skew",
    "end_cushioning", "swinging_load", "slew_coupling", "valve_dead_band", "valve_hysteresis",
    "valve_asymmetry", "internal_leakage", "oil_compressibility",
}  # fmt: skip


@pytest.fixture(scope="module")
def gains() -> Gains:
    """The packaged ones."""
    return load_gains(machine_file("controller.yaml"), load_machine())


@dataclass(frozen=True)
class Strokes:
    """All planar joints to and fro, each at its own pace, and back at rest."""

    start: np.ndarray
    duration: float = 8.0

    def reference(self, time: np.ndarray) -> Reference:
        """One minus cosine, whole swings."""
        omega = 2 * np.pi * np.array([0.0, 2.0, 3.0, 3.0]) / self.duration
        reach = np.array([0.0, 0.08, 0.12, 0.15])
        phase = np.outer(np.clip(time, 0.0, self.duration), omega)
        return Reference(
            self.start + reach * (1 - np.cos(phase)),
            reach * omega * np.sin(phase),
            reach * omega**2 * np.cos(phase),
            np.zeros(len(phase)),
        )

    def probe(self, time: np.ndarray) -> np.ndarray:
        """Nothing."""
        return np.zeros((len(time), len(self.start)))


@pytest.fixture(scope="module")
def motion(simulated: SimulatedCrane) -> Strokes:
    """Eight seconds."""
    return Strokes(simulated.start)


def test_every_effect_of_the_catalogue_can_be_injected_and_some_outside(machine: Machine) -> None:
    """Rows 1 to 29; at least five that no catalogue has."""
    inside = {name for name, forms in FORMS.items() if not forms[0].outside}
    assert inside == CATALOGUE
    assert len(FORMS.keys() - inside) >= 5
    numbers = [form.law for forms in FORMS.values() for form in forms]
    assert len(set(numbers)) == len(numbers)
    for forms in FORMS.values():
        for form in forms:
            assert set(form.where.joints(machine)) <= set(PLANAR_JOINTS)
            assert form.outside == forms[0].outside
            assert "{" not in form.unit(form.magnitude.unit, machine, "telescope")


def test_nothing_injected_changes_nothing(machine: Machine, simulated: SimulatedCrane) -> None:
    """Effects of no size leave the motion as it is, to the last bit."""
    nil = [
        effect_of("hose_stiffness", "telescope", 0.0, 1.0),
        effect_of("stribeck", "inner_boom", 0.0, 0.01),
        effect_of("payload", None, 0.0, 0.1, 0.1),
        effect_of("valve_asymmetry", "outer_boom", 0.0, 0.01),
        effect_of("internal_leakage", "outer_boom", 0.0),
    ]
    plants = [Plant(simulated, machine, simulated.start, effects) for effects in ((), nil)]
    for plant in plants:
        for command in ([0.0, 0.3, 0.3, 0.3], [0.1, -0.3, 0.2, -0.4]):
            plant.advance(np.array(command), 0.4)
    plain, hiding = plants
    for name in ("q", "v", "pressure_a", "pressure_b"):
        np.testing.assert_array_equal(getattr(plain, name), getattr(hiding, name))
    assert hiding.injected_force.shape == (5, 4)
    assert plain.injected_force.shape == (0, 4)


def test_forces_of_all_effects_close_the_balance(
    machine: Machine, simulated: SimulatedCrane, motion: Strokes, gains: Gains
) -> None:
    """Seen force = bodies (6) + friction (13) + the parts of the effects, many at once."""
    effects = (
        effect_of("stribeck", "telescope", 100.0, 0.02),
        effect_of("load_friction", "outer_boom", 0.03, 200.0),
        effect_of("viscous_quadratic", "inner_boom", 5000.0, 1.8),
        effect_of("detent", "outer_boom", 60.0, 20.0, 0.3),
        effect_of("maxwell_slip", "inner_boom", 2e-3, 0.6),
        effect_of("boom_flexibility", "inner_boom", 0.3, 1.5, 0.1),
        effect_of("base_tilt", None, 0.02),
        effect_of("payload", None, 10.0, 0.2, 0.2),
        effect_of("hose_mass", None, 2.0),
        effect_of("actuator_inertia", "inner_boom", 200.0),
        effect_of("swinging_load", None, 8.0, 1.0, 0.02),
        effect_of("wind", None, 20.0, 0.4),
        effect_of("pressure_offset", "inner_boom", 1e5, 0.1, 40.0),
        effect_of("encoder_offset", "outer_boom", 0.01),
    )
    clean = moved(effects, machine, simulated, motion, gains)
    chain, law = pack_chain(simulated, machine), simulated.friction
    up = np.where(clean.velocity > 0.0, 1.0, -1.0)
    coulomb = column(law, "f_c") * up + column(law, "df_c")
    viscous = column(law, "f_v") * clean.velocity + column(law, "df_v") * np.abs(clean.velocity)
    bodies = [
        inverse_dynamics(chain, *motion)
        for motion in zip(clean.position, clean.velocity, clean.acceleration, strict=True)
    ]
    left = clean.seen_drive - (np.array(bodies) + coulomb + viscous + clean.force.sum(axis=0))
    slides = (np.abs(clean.velocity) > SLIDING_SPEED)[:, 1:]
    drive = np.sqrt(np.mean(clean.seen_drive[:, 1:] ** 2, axis=0))
    for i, joint in enumerate(PLANAR_JOINTS):
        rest = left[slides[:, i], i + 1]
        assert len(rest) > 500
        assert np.sqrt(np.mean(rest**2)) < 2e-3 * drive[i], joint
    assert clean.force.shape == (len(effects), len(clean.time), len(JOINTS))
    assert (clean.relative_magnitude(effects, machine) > 1e-4).all()


def test_strength_comes_as_wanted(
    machine: Machine, simulated: SimulatedCrane, motion: Strokes, gains: Gains
) -> None:
    """Two at once, one in the plant and one in a sensor; the truth tells what was reached."""
    spec = Spec(
        seed=4,
        effects=(
            InjectedEffect(effect="presliding", joint="inner_boom", relative_magnitude=0.02),
            InjectedEffect(effect="crosstalk", joint="telescope", relative_magnitude=0.04),
        ),
    )
    effects = calibrate(spec, machine, simulated, motion, gains)
    clean = moved(effects, machine, simulated, motion, gains)
    np.testing.assert_allclose(clean.relative_magnitude(effects, machine), [0.02, 0.04], rtol=0.15)
    first, second = ground_truth(effects, clean, machine)
    assert (first.effect, second.effect, second.name) == (
        "presliding", "outside", "crosstalk",
    )  # fmt: skip
    assert first.joint == "inner_boom"
    assert first.relative_magnitude_requested == 0.02
    speed = np.abs(clean.velocity[:, 3])
    slides = speed > 0.02 * speed.max()
    rms = np.sqrt((clean.force[1, slides, 3] ** 2).mean() / (clean.drive[slides, 3] ** 2).mean())
    assert second.relative_magnitude == pytest.approx(rms)
    assert [entry.unit for entry in first.parameters] == ["rad", "1", "s"]


def test_a_label_brings_the_whole_machine_back(
    machine: Machine, simulated: SimulatedCrane, motion: Strokes, gains: Gains, tmp_path: Path
) -> None:
    """What is injected on no joint of its own is injected again by the ground truth."""
    effects = (effect_of("base_tilt", None, 0.02),)
    clean = moved(effects, machine, simulated, motion, gains)
    write_ground_truth(tmp_path / "a.json", tmp_path / "bag", 1, machine, simulated, effects, clean)
    (again,) = load_injected(tmp_path / "a.json", machine, simulated).effects
    assert (again.effect, again.joint) == ("base_tilt", None)
    assert tuple(again.parameters.values()) == effects[0].values


def test_what_cannot_be_reached_is_refused_by_name(
    machine: Machine, simulated: SimulatedCrane, motion: Strokes, gains: Gains
) -> None:
    """Centrifugal force is weak within the limits of the slew."""
    spec = Spec(effects=(InjectedEffect(effect="slew_coupling", relative_magnitude=0.2),))
    with pytest.raises(RangeError, match=r"slew_coupling.*0\.38 rad/s.*0\.2 was asked"):
        calibrate(spec, machine, simulated, motion, gains)


def test_a_motion_that_shows_nothing_is_refused_at_once(
    machine: Machine, simulated: SimulatedCrane, gains: Gains
) -> None:
    """Cushions of the ends, half a meter away from them."""
    spec = Spec(
        effects=(
            InjectedEffect(effect="end_cushioning", joint="telescope", relative_magnitude=0.02),
        )
    )
    start = simulated.start.copy()
    limits = machine.limits["telescope"]
    start[3] = (limits.position_min + limits.position_max) / 2.0 - 0.15
    with pytest.raises(UnmovedError, match=r"end_cushioning.*does nothing on this motion"):
        calibrate(spec, machine, simulated, Strokes(start, 2.0), gains)


def test_an_effect_that_cannot_be_so_weak_is_refused_before_all_tries(
    machine: Machine, simulated: SimulatedCrane, motion: Strokes, gains: Gains
) -> None:
    """The corner of an overlap stays, however narrow its band is."""
    effect = InjectedEffect(
        effect="valve_dead_band", form="soft_overlap", joint="telescope", relative_magnitude=1e-4
    )
    builds = 0

    def build(*given: Any) -> Plant:
        nonlocal builds
        builds += 1
        return Plant(simulated, machine, *given)

    wanted = draw(Spec(effects=(effect,)), machine, simulated)
    with pytest.raises(UnmovedError, match=r"valve_dead_band.*however small its band; 0\.0001 was"):
        reach(wanted, machine, simulated, motion, gains, build)
    assert builds < MAX_TRIES


def test_parameters_are_drawn_from_the_seed_or_given(
    machine: Machine, simulated: SimulatedCrane
) -> None:
    """The same seed gives the same; what is given stays."""

    def drawn(seed: int, **parameters: float) -> InjectedForm:
        effect = InjectedEffect(
            effect="stribeck", joint="telescope", relative_magnitude=0.02, parameters=parameters
        )
        return draw(Spec(seed=seed, effects=(effect,)), machine, simulated)[0]

    assert drawn(1) == drawn(1)
    assert drawn(1).values[1] != drawn(2).values[1]
    assert drawn(1, speed=0.03).values[1] == 0.03
    given = InjectedEffect(effect="payload", parameters={"mass": 12.5, "gyration": 0.2})
    values = draw(Spec(effects=(given,)), machine, simulated)[0].values
    assert (values[0], values[2]) == (12.5, 0.2)


def test_the_sign_is_drawn_where_either_is_possible(
    machine: Machine, simulated: SimulatedCrane
) -> None:
    """Zeros of transducers read too much or too little; friction is friction."""

    def signs(effect: str) -> set[float]:
        entry = InjectedEffect(effect=effect, joint="telescope", relative_magnitude=0.02)
        return {
            float(np.sign(draw(Spec(seed=seed, effects=(entry,)), machine, simulated)[0].values[0]))
            for seed in range(20)
        }

    assert signs("pressure_offset") == {-1.0, 1.0}
    assert signs("stribeck") == {1.0}


def test_the_page_of_effects_lists_every_effect_with_its_forms(machine: Machine) -> None:
    """In the table of what can be injected, and each form with its parameters and their units."""
    page = Path(__file__).resolve().parents[3] / "docs" / "effects.md"
    section = page.read_text(encoding="utf-8").split("## Effects to inject\n")[1]
    listed = {
        name: names.split(", ") for name, names in re.findall(r"`(\w+)` \(([\w, ]+)\)", section)
    }
    assert listed == {name: [form.name for form in forms] for name, forms in FORMS.items()}
    rows = re.findall(r"^\| `(\w+)` \| `(\w+)` \| .* \| (.*) \|$", section, re.MULTILINE)
    parameters = {
        (effect, form): re.findall(r"`(\w+)` \[(.+?)\]", cell) for effect, form, cell in rows
    }
    assert parameters == {
        (form.effect, form.name): [
            (entry.name, form.unit(entry.unit, machine, (*form.where.joints(machine), None)[0]))
            for entry in (form.magnitude, *form.draws)
        ]
        for forms in FORMS.values()
        for form in forms
    }


@pytest.mark.parametrize(
    ("entry", "message"),
    [
        ("effect: ghost, relative_magnitude: 0.1", "no effect 'ghost'"),
        ("effect: stribeck, joint: telescope, relative_magnitude: 0.1, form: exp", "no form 'exp'"),
        (
            "effect: stribeck, relative_magnitude: 0.1",
            r"spec\.yaml: 'stribeck' acts on a joint, whose pres.* joint of inner_boom",
        ),
        (
            "effect: stribeck, joint: slew, relative_magnitude: 0.1",
            r"spec\.yaml: 'stribeck' acts on a joint, whose pres.* joint of inner_boom",
        ),
        (
            "effect: encoder_offset, joint: telescope, relative_magnitude: 0.1",
            r"acts on a joint that turns, .* joint of inner_boom, outer_boom; got 'tel",
        ),
        ("effect: payload, joint: telescope, relative_magnitude: 0.1", "give no joint"),
        ("effect: payload", "either its relative_magnitude or its parameter mass"),
        (
            "effect: payload, relative_magnitude: 0.1, parameters: {mass: 3}",
            "either its relative_magnitude",
        ),
        ("effect: payload, relative_magnitude: 0.1, parameters: {weight: 3}", "not weight"),
        ("effect: payload, relative_magnitude: -0.1", "relative_magnitude"),
    ],
)
def test_wrong_specifications_are_refused_by_name(
    machine: Machine, simulated: SimulatedCrane, tmp_path: Path, entry: str, message: str
) -> None:
    """File, key and remedy."""
    path = tmp_path / "spec.yaml"
    path.write_text(f"effects:\n  - {{{entry}}}\n", encoding="utf-8")
    with pytest.raises(ConfigurationError, match=message):
        load_injected(path, machine, simulated)


def test_a_label_lies_outside_of_the_bag(tmp_path: Path) -> None:
    """In any spelling of the path; and no file is overwritten."""
    bag = tmp_path / "bag"
    for inside in (bag / "label.json", bag / "deep" / "label.json", bag / ".." / "bag" / "x.json"):
        with pytest.raises(ConfigurationError, match="must not reveal what was injected"):
            check_place(inside, bag)
    there = tmp_path / "label.json"
    check_place(there, bag)
    clean_path(there).touch()
    with pytest.raises(ConfigurationError, match="suffix"):
        check_place(tmp_path / "label.npz", bag)
    with pytest.raises(Exception, match="exists"):
        check_place(there, bag)


def test_what_warms_up_goes_on_where_the_session_is(
    machine: Machine, simulated: SimulatedCrane, motion: Strokes, gains: Gains
) -> None:
    """Oil and transducers of a machine that has run for so long; its motion begins all the same."""
    oil = effect_of("warm_up", "outer_boom", 500.0, 300.0, 1.0)
    zero = effect_of("pressure_offset", "inner_boom", 1e5, 0.1, 50.0)
    for running in (0.0, 600.0):
        plant = Plant(simulated, machine, motion.start, (oil, zero), running)
        sensors = Sensors(simulated.sensors, machine, 0, faults((oil, zero), machine))
        recording = record(motion, plant, sensors, gains)
        truth = recording.truth
        assert truth.time[0] == pytest.approx(running, abs=0.01)
        np.testing.assert_allclose(recording.position[0], motion.start, atol=1e-3)
        assert np.ptp(recording.reference.position[:, 3]) == pytest.approx(0.3, rel=1e-3)
        cold = np.exp(np.exp(-truth.time / 300.0)) - 1.0
        force = 500.0 * truth.velocity[:, 2] * cold / (np.e - 1.0)
        np.testing.assert_allclose(truth.injected_force[0, :, 2], force, rtol=0.01, atol=0.5)
        column = recording.cylinders.index("inner_boom")
        shown = recording.pressures.chamber_a[:, column] - truth.pressure_a[:, 1]
        left = 1.0 - 0.1 * (1.0 - np.exp(-truth.time.mean() / 50.0))
        assert shown.mean() == pytest.approx(1e5 * left, abs=1000.0)
