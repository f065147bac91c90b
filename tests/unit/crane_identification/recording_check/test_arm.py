"""Forces of a robot with six axes: turned signs, zeros that are off, another unit of each joint."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from unit.crane_identification.recording_check.corruption import column, each

from crane_identification import Log, Signal
from crane_identification.check_recording import main, parser
from crane_identification.recording_check.check import check
from crane_identification.recording_check.suspicion import RecordingVerdict
from crane_model import Model, Record, load_model
from crane_model.terms.drives import RotorInertia

MODEL = Path(__file__).parents[3] / "machines" / "kuka_kr300_model.yaml"
MIDDLE = np.array([0.0, 0.3, -1.3, 0.0, 0.0, 0.0])  # rad, within the limits of each axis
SWING = np.array([0.9, 0.5, 0.6, 0.9, 0.8, 1.2])
FORCE = ("force",)


@pytest.fixture(scope="module")
def model() -> Model:
    return load_model(MODEL)


@pytest.fixture(scope="module")
def good(model: Model) -> Log:
    """Thirty seconds of all axes at once, with bodies that are boxes, and noise of 1 %."""
    rng = np.random.default_rng(43)
    time = np.arange(0.0, 30.0, 0.004)
    frequency = rng.uniform(0.8, 2.5, (4, 6))
    phase = rng.uniform(0.0, 2 * np.pi, (4, 6))
    wave = frequency * time[:, np.newaxis, np.newaxis] + phase
    position = MIDDLE + SWING * np.sin(wave).mean(axis=1)
    velocity = (SWING * frequency * np.cos(wave)).mean(axis=1)
    acceleration = (-SWING * frequency**2 * np.sin(wave)).mean(axis=1)
    record = Record(model.joints, time, position, velocity, acceleration)
    theta = np.array([0.1 + 0.2 * rng.uniform() for _ in model.parameters])
    bodies = next(term for term in model.terms if term.type == "serial_rigid_body")
    combined = bodies.of_bodies(model.setting)
    assert combined is not None
    mass, arm = 12.0, np.array([0.1, 0.05, 0.15])
    inertia = np.array([0.6, 0.0, 0.6, 0.0, 0.0, 0.6]) + mass * 0.01
    box = np.concatenate([[mass], mass * arm, inertia])
    theta[model.part(bodies)] = combined @ np.resize(box, combined.shape[1])
    for term in model.terms:
        if term.type in ("coulomb", "viscous"):
            theta[model.part(term)] = 3.0
        elif term.type == "rotor_inertia":
            theta[model.part(term)] = 1e-5  # kg m2, in front of the gear
    force = model.regressor(record) @ theta
    force += 0.01 * force.std(axis=0) * rng.normal(size=force.shape)
    return Log(
        "robot", model.joints, 0, Signal(time, position, "q"), force=Signal(time, force, "f")
    )


def test_a_good_recording_looks_right(model: Model, good: Log) -> None:
    assert check(model.machine, good, model).verdict is RecordingVerdict.RIGHT
    without = check(model.machine, good)
    assert without.verdict is RecordingVerdict.DOUBTFUL and "--model" in without.unchecked[-1]


@pytest.mark.parametrize("j", range(6))
def test_a_turned_force_is_found(model: Model, good: Log, j: int) -> None:
    turned = each(good, FORCE, column(j, np.negative))
    (found,) = check(model.machine, turned, model).decisive
    assert found.where == f"axis {j + 1}" and "the sign of its force" in found.cause


@pytest.mark.filterwarnings("error")
def test_efforts_of_zeros_are_told_and_not_fitted(model: Model, good: Log) -> None:
    found = check(None, each(good, FORCE, np.zeros_like), model).decisive
    assert found and all("all readings are zero" in str(one) for one in found)


def test_several_turned_forces_are_found(model: Model, good: Log) -> None:
    """Each alone explains little of what both spoil; of all, none alone explains anything."""
    for turned in ([1, 2], [0, 3, 4], range(6)):
        sign = np.where(np.isin(range(6), turned), -1.0, 1.0)
        found = check(None, each(good, FORCE, sign.__mul__), model).decisive
        assert {one.where for one in found} == {f"axis {j + 1}" for j in turned}
        assert all("the sign of its force" in one.cause for one in found)


@pytest.mark.parametrize("angle", [np.pi / 2, -np.pi / 2])
def test_a_zero_that_is_off(model: Model, good: Log, angle: float) -> None:
    off = each(good, ("position",), column(4, lambda q: q - angle))
    (found,) = check(None, off, model).decisive
    name = "+90°" if angle > 0 else "-90°"
    assert found.where == "axis 5" and f"zero is off by {name}" in found.cause


def test_efforts_in_amperes_are_no_turned_sign(model: Model, good: Log) -> None:
    ampere = np.array([0.02, 0.02, 0.03, 0.08, 0.1, 0.15])
    (found,) = check(model.machine, each(good, FORCE, lambda f: f * ampere), model).decisive
    assert found.where == "forces" and "amperes" in found.cause
    factors = [float(part.split()[-1]) for part in found.cause.partition("agree: ")[2].split(", ")]
    np.testing.assert_allclose(np.array(factors) / factors[0], ampere[0] / ampere, rtol=0.15)


@pytest.mark.parametrize(("j", "unit"), [(0, -9.5), (2, 9.5), (5, 9.5)])
def test_one_effort_in_amperes_leaves_the_other_factors(
    model: Model, good: Log, j: int, unit: float
) -> None:
    (found,) = check(None, each(good, FORCE, column(j, lambda f: f / unit)), model).suspicions
    factors = [float(part.split()[-1]) for part in found.cause.partition("agree: ")[2].split(", ")]
    np.testing.assert_allclose(factors, np.where(np.arange(6) == j, unit, 1.0), rtol=0.15)


def test_units_that_differ_little_are_doubtful(model: Model, good: Log) -> None:
    """Currents of motors with torque constants of 8 to 11 N m/A explain themselves nearly."""
    ampere = 1.0 / np.array([11.5, 11.5, 9.8, 8.4, 8.4, 8.1])
    checked = check(model.machine, each(good, FORCE, lambda f: f * ampere), model)
    assert checked.verdict is RecordingVerdict.DOUBTFUL
    (found,) = checked.suspicions
    assert found.where == "forces" and "amperes" in found.cause


@pytest.mark.parametrize(("axes", "ratio"), [([3, 5], 1.5), ([4, 5], 4.0), ([5], 4.0)])
def test_a_force_that_the_model_lacks_is_not_a_unit(
    model: Model, good: Log, axes: list[int], ratio: float
) -> None:
    """A hose that the axes twist: a factor near 0 would hide it, and explains nothing."""
    assert good.force is not None
    twist = good.position.value[:, axes].sum(axis=1)
    force = good.force.value.copy()
    for j in axes:
        force[:, j] += ratio * force[:, j].std() * twist / twist.std()
    lacking = replace(good, force=replace(good.force, value=force))
    assert not check(model.machine, lacking, model).decisive


def test_without_a_model_a_force_that_feeds_friction_is_found(good: Log) -> None:
    """A single axis, as EMPS: inertia and friction are negative."""
    time = good.position.time
    q = np.column_stack([0.2 * np.sin(1.1 * time) + 0.1 * np.sin(2.3 * time)])
    v = np.gradient(q, time, axis=0)
    force = 95.0 * np.gradient(v, time, axis=0) + 20.0 * np.sign(v) + 200.0 * v
    log = Log("axis", ("axis",), 0, Signal(time, q, "q"), force=Signal(time, force, "f"))
    assert not check(None, log).suspicions
    (found,) = check(None, each(log, FORCE, np.negative)).decisive
    assert "friction would feed it" in found.evidence and "sign of its force" in found.cause


def test_a_model_that_lacks_friction_is_no_wrong_sign(model: Model, good: Log) -> None:
    lacking = model
    for term in model.terms:
        if term.type in ("coulomb", "viscous"):
            lacking = lacking.without_term(term)
    assert not check(model.machine, good, lacking).decisive


def test_parameters_that_no_motion_separates_are_no_mistake(model: Model, good: Log) -> None:
    """The rotor of the first axis turns as its link does."""
    both = replace(model, terms=(*model.terms, RotorInertia(joint="axis_1")))
    assert check(model.machine, good, both).verdict is RecordingVerdict.RIGHT


def test_terms_of_the_user_are_taken() -> None:
    given = parser().parse_args(["--model", "m.yaml", "--terms", "own.py", "bag"])
    assert given.terms == Path("own.py")


def test_a_map_of_other_joints_asks_for_the_machine(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The laboratory crane, which is the default, has none of them."""
    joint = "{position: {column: q, unit: rad}, force: {column: i, unit: N m}}"
    (tmp_path / "map.yaml").write_text(f"rate: 100\njoints:\n  axis_1: {joint}\n")
    assert main(["--columns", str(tmp_path / "map.yaml"), str(tmp_path / "table.csv")]) == 1
    assert "give your machine by --model or --machine" in capsys.readouterr().err
