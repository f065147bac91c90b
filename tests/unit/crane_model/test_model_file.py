"""Model files: round trip, sum of terms, and what each kind of wrong file is told."""

from pathlib import Path

import numpy as np
import pytest

from crane_model import ConfigurationError, Machine, Model, Record, load_model, save_model
from crane_model.configuration import save
from crane_model.terms.friction import Coulomb
from crane_model.terms.single_axis import Offset

SLIDE = """\
name: slide
joints: {axis: m}
terms:
  - {type: inertia, joint: axis}
  - {type: coulomb, joint: axis}
"""
ESTIMATE = """\
estimate:
  provenance: a measurement
  parameters:
    - {name: inertia.axis, unit: kg, value: 12.0, std_dev: 0.5}
    - {name: f_c.axis, unit: N, value: 30.0, std_dev: 2.0}
"""


@pytest.fixture
def file(tmp_path: Path) -> Path:
    return tmp_path / "model.yaml"


def written(file: Path, text: str) -> Model:
    file.write_text(text)
    return load_model(file)


def random_record(joints: tuple[str, ...], samples: int = 40) -> Record:
    q, v, a = np.random.default_rng(11).standard_normal((3, samples, len(joints)))
    return Record(joints, np.arange(samples) * 0.01, q, v, a)


def test_file_becomes_a_model(file: Path) -> None:
    model = written(file, SLIDE + ESTIMATE)
    assert model.joints == ("axis",)
    assert [(p.name, p.unit) for p in model.parameters] == [
        ("inertia.axis", "kg"),
        ("f_c.axis", "N"),
    ]
    np.testing.assert_array_equal(model.theta, [12.0, 30.0])
    np.testing.assert_array_equal(model.std_devs, [0.5, 2.0])
    assert model.provenance == "a measurement"


def test_units_follow_the_kind_of_joint(file: Path) -> None:
    model = written(file, SLIDE.replace("axis: m", "axis: rad"))
    assert [p.unit for p in model.parameters] == ["kg m2", "N m"]


@pytest.mark.parametrize("estimated", [False, True])
def test_round_trip(crane: Model, file: Path, estimated: bool) -> None:
    """With its machine inside, and every digit of its values."""
    model = crane
    if estimated:
        values, std_devs = np.random.default_rng(12).standard_normal((2, 20)) ** 2 / 3.0
        model = crane.with_estimate(values, std_devs, "two bags of Tuesday, 66 s each")
    save_model(file, model)
    read = load_model(file)
    assert (read.name, read.setting, read.terms, read.provenance) == (
        model.name,
        model.setting,
        model.terms,
        model.provenance,
    )
    if estimated:
        np.testing.assert_array_equal(read.theta, model.theta)
        np.testing.assert_array_equal(read.std_devs, model.std_devs)
    else:
        assert read.values is None
        assert read.std_devs is None


def test_machine_in_a_file_beside_the_model(machine: Machine, crane: Model, file: Path) -> None:
    heavier = machine.model_copy(update={"gravity_given": 9.83})
    save(file.parent / "crane.yaml", heavier)
    telescope = SLIDE.replace("axis", "telescope")
    model = written(file, telescope + "machine: crane.yaml\n")
    assert model.machine == heavier
    assert written(file, telescope + "machine: laboratory_crane\n").machine == machine
    assert written(file, SLIDE).machine is None


def test_values_that_are_not_finite_cannot_be_saved(file: Path) -> None:
    model = written(file, SLIDE).with_estimate(np.array([1.0, 2.0]), np.array([0.1, np.inf]), "")
    with pytest.raises(ConfigurationError, match=r"parameters\.f_c\.axis\.std_dev.*finite.*inf"):
        save_model(file, model)
    assert load_model(file).values is None  # the file that was there is not touched


def test_prediction_is_the_sum_of_the_terms(crane: Model) -> None:
    record = random_record(crane.joints)
    theta = np.random.default_rng(13).standard_normal(20)
    model = crane.with_estimate(theta, np.zeros(20), "made up")
    total, start = np.zeros((len(record), 3)), 0
    for term in model.terms:
        columns = term.columns(record, model.setting)
        total += columns @ theta[start : start + columns.shape[2]]
        start += columns.shape[2]
    assert start == 20
    np.testing.assert_allclose(model.predict(record), total, atol=1e-11)


def test_gravity_is_the_prediction_at_rest_without_friction(crane: Model) -> None:
    record = random_record(crane.joints)
    theta = np.random.default_rng(14).uniform(1.0, 2.0, 20)
    model = crane.with_estimate(theta, np.zeros(20), "made up")
    frictionless = crane.with_estimate(np.r_[theta[:8], np.zeros(12)], np.zeros(20), "made up")
    np.testing.assert_allclose(
        model.gravity(record), frictionless.predict(record.at_rest()), atol=1e-12
    )
    assert np.abs(model.gravity(record)).max() > 1.0


def test_range_at_standstill_lies_between_the_branches_of_friction(crane: Model) -> None:
    """(13) with the sign of either direction; also if Coulomb friction is estimated negative."""
    theta = np.random.default_rng(23).uniform(1.0, 2.0, 20)
    coulomb = np.array([8, 12, 16])
    theta[16] *= -1.0
    model = crane.with_estimate(theta, np.zeros(20), "made up")
    record = random_record(crane.joints)
    low, high = model.range_at_standstill(record)
    without = theta.copy()
    without[coulomb] = 0.0
    middle = crane.with_estimate(without, np.zeros(20), "made up").predict(record)
    np.testing.assert_allclose(high - middle, np.tile(np.abs(theta[coulomb]), (40, 1)), atol=1e-12)
    np.testing.assert_allclose(middle - low, high - middle, atol=1e-12)


def test_term_added_to_an_estimated_model_asks_for_a_new_fit(file: Path) -> None:
    model = written(file, SLIDE + ESTIMATE)
    extended = model.with_term(Offset(joint="axis"))
    assert [p.name for p in extended.parameters] == ["inertia.axis", "f_c.axis", "offset.axis"]
    with pytest.raises(ConfigurationError, match="'slide' has no values yet; fit it"):
        extended.predict(random_record(("axis",)))
    assert model.values is not None


def test_term_added_twice(file: Path) -> None:
    model = written(file, SLIDE).with_term(Coulomb(joint="axis"))
    with pytest.raises(ConfigurationError, match=r"f_c\.axis stands twice"):
        _ = model.parameters


WRONG = {
    "unknown type lists the types": (
        SLIDE.replace("inertia", "wobble"),
        ["'terms.0'", "'wobble'", "coulomb, coulomb_asymmetry, curved_reading_a"],
    ),
    "term without a type": (SLIDE + "  - {joint: axis}\n", ["'terms.2'", "no term of type None"]),
    "term that is a word": (SLIDE + "  - viscous\n", ["'terms.2'", "no term of type None"]),
    "term twice": (
        SLIDE + "  - {type: coulomb, joint: axis}\n",
        ["f_c.axis stands twice", "once per joint"],
    ),
    "joint that is not there": (
        SLIDE.replace("inertia, joint: axis", "inertia, joint: axle"),
        ["term 'inertia'", "no joint 'axle'", "joints are axis"],
    ),
    "term without its joint": (
        SLIDE.replace("inertia, joint: axis", "inertia"),
        ["'terms.0.joint'", "required"],
    ),
    "key that the term does not have": (
        SLIDE.replace("coulomb, joint: axis", "coulomb, joint: axis, delta: 2"),
        ["'terms.1.delta'", "no such key; there are type, joint (got 2"],
    ),
    "no terms": (SLIDE.split("  -")[0].replace("terms:", "terms: []"), ["'terms'", "at least 1"]),
    "no joints": (SLIDE.replace("{axis: m}", "{}"), ["'joints'", "at least 1"]),
    "unit of a joint": (
        SLIDE.replace("axis: m", "axis: mm"),
        ["'joints.axis'", "'rad' or 'm'", "mm"],
    ),
    "unknown key": (
        SLIDE + "terns: 1\n",
        ["'terns'", "no such key; there are name, machine, joints, terms, estimate"],
    ),
    "key twice": (SLIDE + "name: other\n", ["'name'", "twice"]),
    "rigid bodies without a machine": (
        SLIDE + "  - {type: planar_rigid_body}\n",
        ["'planar_rigid_body'", "needs a machine", "the model has none"],
    ),
    "wrong machine inside": (
        SLIDE + "machine: {name: half a crane, gravity: -1}\n",
        ["machine", "'gravity'", "greater than 0", "-1", "'joints'", "required"],
    ),
    "machine that is no machine": (SLIDE + "machine: 3\n", ["'machine", "3"]),
    "estimate of too few parameters": (
        SLIDE + ESTIMATE.rsplit("    -", 1)[0],
        ["'estimate.parameters'", "inertia.axis [kg], f_c.axis [N]", "got inertia.axis [kg]"],
    ),
    "estimate in another unit": (
        SLIDE + ESTIMATE.replace("unit: N", "unit: kN"),
        ["'estimate.parameters'", "got inertia.axis [kg], f_c.axis [kN]"],
    ),
    "negative standard deviation": (
        SLIDE + ESTIMATE.replace("0.5", "-0.5"),
        ["'estimate.parameters.inertia.axis.std_dev'", "at least 0", "-0.5"],
    ),
    "value that is not finite": (
        SLIDE + ESTIMATE.replace("30.0", ".nan"),
        ["'estimate.parameters.f_c.axis.value'", "finite", "nan"],
    ),
}


@pytest.mark.parametrize(("text", "parts"), WRONG.values(), ids=WRONG)
def test_wrong_file_is_told_what_is_wrong(file: Path, text: str, parts: list[str]) -> None:
    with pytest.raises(ConfigurationError) as caught:
        written(file, text)
    for part in [str(file), *parts]:
        assert part in str(caught.value)


def test_absent_machine_file_is_named(file: Path) -> None:
    with pytest.raises(ConfigurationError, match=r"grader\.yaml: no such machine"):
        written(file, SLIDE + "machine: grader.yaml\n")


def test_rigid_bodies_of_the_plane_need_the_joints_of_the_plane(file: Path) -> None:
    text = "name: x\nmachine: laboratory_crane\nterms: [{type: planar_rigid_body}]\n"
    with pytest.raises(ConfigurationError) as caught:
        written(file, text + "joints: {inner_boom: rad, outer_boom: rad}\n")
    for part in (
        "inner_boom [rad], outer_boom [rad], telescope [m]",
        "got inner_boom [rad], outer_boom [rad]",
    ):
        assert part in str(caught.value)
