"""What every term of the registry must be: documented, of the right shape, and linear."""

import inspect
import re
from dataclasses import replace
from time import process_time
from typing import get_args

import numpy as np
import pytest
from laboratory_crane import JOINT_UNITS, PLANAR_JOINTS

from crane_model import DataError, Record, load_machine
from crane_model.actuators import actuator_from_mapping
from crane_model.configuration import read_yaml
from crane_model.machine import Coupling
from crane_model.machine_files import machine_file
from crane_model.terms import (
    REGISTRY,
    MemoryTerm,
    NonparametricTerm,
    Parameter,
    Setting,
    Term,
    candidates,
    joints_of,
    nuisances,
    term_from_mapping,
    typical,
)
from crane_model.terms.joint_term import ProportionalTerm
from crane_model.terms.nonparametric import NonparametricDryFriction
from crane_model.terms.term import Family

SETTING = Setting({joint: JOINT_UNITS[joint] for joint in PLANAR_JOINTS}, load_machine())
MOTOR = actuator_from_mapping({"type": "electric_drive", "gear_ratio": 100.0})
MOTORS = Setting(
    SETTING.units,
    SETTING.machine.model_copy(
        update={
            "joints": tuple(
                joint.model_copy(update={"actuator": MOTOR}) for joint in SETTING.machine.joints
            )
        }
    ),
)
COUPLED = Setting(
    SETTING.units,
    SETTING.machine.model_copy(
        update={
            "couplings": (
                Coupling(joints=("inner_boom", "outer_boom"), matrix=((1.0, 0.0), (1.0, 1.0))),
            )
        }
    ),
)
OF_MOTORS = {"rotor_inertia"}  # which no cylinder has
OF_COUPLINGS = {"motor_coulomb", "motor_viscous"}
EQUATION = re.compile(r"\(\d+\)|q'|=")  # the number of one in the report, or an equation itself
UNIT = re.compile(r"(1|kg|N|m|rad|s|Pa|K|degC|Hz)[\w /^()-]*")

ACROSS_JOINTS = {
    "boom_flexibility",
    "motor_coulomb",
    "motor_viscous",
}  # of a joint, but others carry it too
ON_ONE_JOINT = sorted(
    (name, joint)
    for name in REGISTRY
    for joint in joints_of(
        REGISTRY[name],
        MOTORS if name in OF_MOTORS else COUPLED if name in OF_COUPLINGS else SETTING,
    )
)
WITH_MEMORY = sorted(name for name in REGISTRY if issubclass(REGISTRY[name], MemoryTerm))
CANDIDATES = sorted(name for name in REGISTRY if REGISTRY[name].effect)

each_type = pytest.mark.parametrize("name", sorted(REGISTRY))


def setting_of(name: str) -> Setting:
    """The crane, with motors for terms of motors, and coupled for terms of couplings."""
    return MOTORS if name in OF_MOTORS else COUPLED if name in OF_COUPLINGS else SETTING


def example(name: str, joint: str = "outer_boom") -> Term:
    """The term with shape parameters from within their ranges, on one joint if it acts on one."""
    joints = joints_of(REGISTRY[name], setting_of(name))
    if not joints:
        return typical(REGISTRY[name])
    return typical(REGISTRY[name], joint if joint in joints else joints[0])


def random_record(samples: int = 60) -> Record:
    """Every signal that a term may ask for: wide jumps, from limit to limit, a stand, and small
    motion at one place.
    """
    rng = np.random.default_rng(20)
    limits = [-0.45, -2.7, 0.0], [1.37, -0.1, 1.55]
    q = rng.uniform(*limits, (samples, 3))
    q[1:3] = limits
    v, a, force = rng.standard_normal((3, samples, 3))
    v[10:20] = 0.0
    small = samples // 2
    q[small:] = [0.4, -1.2, 0.7] + 1e-3 * rng.standard_normal((samples - small, 3))
    slew = rng.standard_normal((3, samples))
    return Record(
        PLANAR_JOINTS,
        np.arange(samples) * 0.01,
        q,
        v,
        a,
        run=np.repeat([0, 1], samples // 2),
        force=1e3 * force,
        pressure_a=rng.uniform(0, 175e5, (samples, 3)),
        pressure_b=rng.uniform(0, 175e5, (samples, 3)),
        slew_position=slew[0],
        slew_velocity=slew[1],
        slew_acceleration=slew[2],
        command=rng.uniform(-1, 1, (samples, 3)),
        temperature=rng.uniform(20, 60, samples),
        supply_pressure=rng.uniform(150e5, 175e5, samples),
        tank_pressure=rng.uniform(1e5, 3e5, samples),
    )


def test_registry_is_complete() -> None:
    """Every class that is not abstract is registered, under the name that model files use."""

    def descendants(cls: type) -> set[type]:
        return {cls} | {d for child in cls.__subclasses__() for d in descendants(child)}

    concrete = {cls for cls in descendants(Term) if not inspect.isabstract(cls)}
    concrete = {cls for cls in concrete if cls.__module__.startswith("crane_model.")}
    bases = {ProportionalTerm, NonparametricTerm, NonparametricDryFriction}
    assert set(REGISTRY.values()) >= concrete - bases
    for name, cls in REGISTRY.items():
        assert cls.model_fields["type"].default == name
        assert cls.family in get_args(Family)


def test_the_shipped_model_lists_no_column_twice() -> None:
    listed = read_yaml(machine_file("model.yaml"))["terms"]
    entries = [tuple(sorted(entry.items())) for entry in listed]
    assert len(entries) == len(set(entries))


@each_type
def test_docstring_holds_the_equation(name: str) -> None:
    doc = inspect.getdoc(REGISTRY[name])
    assert doc, f"{REGISTRY[name].__name__} has no docstring"
    assert EQUATION.search(doc), f"{REGISTRY[name].__name__}: no equation in: {doc}"


@each_type
def test_every_parameter_has_a_name_a_unit_and_a_meaning(name: str) -> None:
    parameters = example(name).parameters(setting_of(name))
    assert parameters
    for parameter in parameters:
        assert isinstance(parameter, Parameter)
        assert re.fullmatch(r"[A-Za-z]\w*(\.\w+)*", parameter.name)
        assert UNIT.fullmatch(parameter.unit), f"{parameter.name}: unit {parameter.unit!r}"
        assert len(parameter.meaning) > 5
        assert parameter.minimum in (None, 0.0)
    assert len({parameter.name for parameter in parameters}) == len(parameters)


@each_type
def test_columns_have_the_shape_of_the_parameters(name: str) -> None:
    record, term = random_record(), example(name)
    columns = term.columns(record, setting_of(name))
    assert columns.shape == (len(record), 3, len(term.parameters(setting_of(name))))
    assert columns.dtype == float
    assert np.isfinite(columns).all()
    assert (np.abs(columns).max(axis=(0, 1)) > 0.0).all(), "a column of zeros on a random motion"


@each_type
def test_columns_do_not_depend_on_what_stands_beside_them(name: str) -> None:
    """Written into a part of a larger array, and sample by sample where there is no memory."""
    record, term = random_record(), example(name)
    setting = setting_of(name)
    count = len(term.parameters(setting))
    larger = np.zeros((len(record), 3, count + 2))
    term.fill(record, setting, larger[:, :, 1:-1])
    np.testing.assert_array_equal(larger[:, :, 1:-1], term.columns(record, setting))
    assert not larger[:, :, [0, -1]].any()


@each_type
def test_columns_are_linear_in_acceleration_and_direction(name: str) -> None:
    """What forward simulation asks of a term: M a + rest + dry s, with s the direction."""
    rng, record, term = np.random.default_rng(21), random_record(), example(name)

    def columns(acceleration: np.ndarray, direction: np.ndarray) -> np.ndarray:
        changed = replace(record, acceleration=acceleration, direction_known=direction)
        return term.columns(changed, setting_of(name))

    a, b = rng.standard_normal((2, len(record), 3))
    s, t = rng.uniform(-1, 1, (2, len(record), 3))
    zero = np.zeros_like(a)
    rest = columns(zero, zero)
    combined = columns(2.0 * a - b, 0.5 * s + 0.25 * t) - rest
    by_a, by_b = columns(a, zero) - rest, columns(b, zero) - rest
    by_s, by_t = columns(zero, s) - rest, columns(zero, t) - rest
    np.testing.assert_allclose(combined, 2.0 * by_a - by_b + 0.5 * by_s + 0.25 * by_t, atol=1e-9)


@pytest.mark.parametrize(("name", "joint"), ON_ONE_JOINT)
def test_term_of_a_joint_leaves_the_others_alone(name: str, joint: str) -> None:
    term = example(name, joint)
    assert all(p.name.endswith(f".{joint}") for p in term.parameters(setting_of(name)))
    if name in ACROSS_JOINTS:
        return
    columns = term.columns(random_record(), setting_of(name))
    assert not np.delete(columns, PLANAR_JOINTS.index(joint), axis=1).any()


@each_type
def test_term_survives_its_own_yaml(name: str) -> None:
    term = example(name)
    assert term_from_mapping(term.model_dump(mode="json")) == term


@pytest.mark.parametrize("name", WITH_MEMORY)
def test_states_are_traced_as_they_are_advanced(name: str) -> None:
    """What a term compiles for whole recordings is what forward simulation does step by step."""
    record, term = random_record(), example(name)
    assert isinstance(term, MemoryTerm)
    step_by_step = MemoryTerm.trace(term, record, SETTING)
    np.testing.assert_allclose(term.trace(record, SETTING), step_by_step, rtol=1e-9, atol=1e-12)
    begins = np.flatnonzero(record.first_of_run)
    assert begins.tolist() == [0, 30]
    np.testing.assert_array_equal(step_by_step[begins], term.start(record, SETTING)[begins])


@pytest.mark.parametrize("name", CANDIDATES)
def test_candidates_are_described(name: str) -> None:
    cls = REGISTRY[name]
    assert cls.effect is not None
    assert len(cls.effect.name) > 3
    assert len(cls.effect.signature) > 10
    assert len(cls.effect.discriminated_by) > 10
    for field, shape in cls.shapes.items():
        assert field in cls.model_fields
        assert 0.0 < shape.lowest < shape.highest
        assert UNIT.fullmatch(shape.unit.split(" or ")[0]), shape.unit
        assert shape.grid[0] == pytest.approx(shape.lowest)
        assert shape.grid[-1] == pytest.approx(shape.highest)
        shares = np.linspace(0.0, 1.0, shape.points)
        assert [shape.share(x) for x in shape.grid] == pytest.approx(shares)
        assert [shape.value(x) for x in shares] == pytest.approx(shape.grid)


def test_another_law_names_the_usual_one_of_its_effect() -> None:
    others = {name: REGISTRY[name].effect.law_of for name in CANDIDATES}
    assert others["cyclic_friction"] == "position_friction"
    for name, usual in others.items():
        assert not usual or (usual in CANDIDATES and usual != name and not others[usual])


def test_terms_are_confusable_both_ways_and_with_candidates() -> None:
    for name in CANDIDATES:
        effect = REGISTRY[name].effect
        assert effect is not None
        assert len(set(effect.confusable)) == len(effect.confusable)
        for other in effect.confusable:
            assert other != name
            assert other in CANDIDATES, f"{name}: confusable with {other}, which is no candidate"
            back = REGISTRY[other].effect
            assert back is not None
            assert name in back.confusable, f"{other} is not confusable with {name}, but back it is"


def test_names_of_effects_and_of_parameters_are_used_once() -> None:
    names = [cls.effect.name for cls in REGISTRY.values() if cls.effect]
    assert len(set(names)) == len(names)
    owners: dict[str, str] = {}
    for name in REGISTRY:
        if name == "serial_rigid_body":  # of this crane it is the planar one under its names
            continue
        for parameter in example(name).parameters(setting_of(name)):
            assert owners.setdefault(parameter.name, name) == name, f"{parameter.name} is twice"


def test_the_crane_can_hold_every_candidate() -> None:
    held = {cls.model_fields["type"].default for cls in candidates(SETTING)}
    assert held == set(CANDIDATES) - OF_MOTORS
    moved = {cls.model_fields["type"].default for cls in candidates(MOTORS)}
    assert moved >= OF_MOTORS
    assert "actuator_inertia" not in moved
    assert {cls.model_fields["type"].default for cls in nuisances(SETTING)} == {"velocity_lag"}
    assert joints_of(REGISTRY["stribeck"], SETTING) == PLANAR_JOINTS
    assert joints_of(REGISTRY["encoder_offset"], SETTING) == ("inner_boom", "outer_boom")
    assert joints_of(REGISTRY["pad_friction"], SETTING) == ("telescope",)
    assert joints_of(REGISTRY["payload"], SETTING) == ()


def test_a_machine_without_linkages_has_fewer_candidates() -> None:
    """What needs lever arms, limits or the planar crane is left out; the rest works without."""
    setting = Setting({"axis": "m"}, None)
    names = {cls.model_fields["type"].default for cls in candidates(setting)}
    assert names >= {"coulomb", "stribeck", "seal_friction", "actuator_inertia", "backlash"}
    assert not names & {"payload", "base_tilt", "encoder_offset", "end_cushioning", "pad_friction"}
    rng = np.random.default_rng(22)
    q, v, a, force, p_a, p_b = rng.standard_normal((6, 40, 1))
    time, warm = np.arange(40) * 0.01, rng.uniform(20, 60, 40)
    record = Record(("axis",), time, q, v, a, None, force, p_a, p_b, temperature=warm)
    for name in names:
        term = typical(REGISTRY[name], "axis")
        assert np.isfinite(term.columns(record, setting)).all()


@pytest.mark.parametrize(
    ("name", "signal"),
    [
        ("load_friction", "force"),
        ("seal_friction", "pressure_a"),
        ("temperature_viscosity", "temperature"),
        ("slew_coupling", "slew_velocity"),
        ("backlash", "force"),
        ("time_skew", "force"),
    ],
)
def test_a_signal_that_is_missing_is_named_with_what_to_do(name: str, signal: str) -> None:
    record = replace(random_record(), **{signal: None})
    with pytest.raises(DataError, match=rf"'{name}': needs {signal}, which was not.*; record"):
        example(name).columns(record, SETTING)


@each_type
def test_columns_are_quick_on_long_recordings(name: str) -> None:
    """100,000 samples, compiled once, in a time that a loop of Python would not reach."""
    record, term = random_record(100_000), example(name)
    term.columns(random_record(), setting_of(name))  # compile
    begin = process_time()
    term.columns(record, setting_of(name))
    assert process_time() - begin < 0.25
