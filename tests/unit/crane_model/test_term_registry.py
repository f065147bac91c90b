"""What every term of the registry must be: documented, of the right shape, and linear."""

import inspect
import re
from dataclasses import replace
from typing import get_args

import numpy as np
import pytest

from crane_model.configuration import packaged, read_yaml
from crane_model.machine import JOINT_UNITS, PLANAR_JOINTS, load_machine
from crane_model.record import Record
from crane_model.terms import (
    REGISTRY,
    MemoryTerm,
    OneJointTerm,
    Parameter,
    Term,
    term_from_mapping,
)
from crane_model.terms.term import Family, Setting

SETTING = Setting({joint: JOINT_UNITS[joint] for joint in PLANAR_JOINTS}, load_machine())
EQUATION = re.compile(r"\(\d+\)|q'|=")  # the number of one in the report, or an equation itself
UNIT = re.compile(r"1|(kg|N|m|rad|s|Pa|K|degC|Hz)[\w /^()-]*")

ON_ONE_JOINT = sorted(name for name in REGISTRY if issubclass(REGISTRY[name], OneJointTerm))
WITH_MEMORY = sorted(name for name in REGISTRY if issubclass(REGISTRY[name], MemoryTerm))
CANDIDATES = sorted(name for name in REGISTRY if REGISTRY[name].effect)

each_type = pytest.mark.parametrize("name", sorted(REGISTRY))


def example(name: str, joint: str = "outer_boom") -> Term:
    """The term with shape parameters from within their ranges, on one joint if it acts on one."""
    content = {"type": name}
    content |= {
        field: shape.grid[shape.points // 2] for field, shape in REGISTRY[name].shapes.items()
    }
    if "joint" in REGISTRY[name].model_fields:
        content["joint"] = joint
    return term_from_mapping(content)


def random_record(samples: int = 60) -> Record:
    """Every signal that a term may ask for."""
    rng = np.random.default_rng(20)
    q = rng.uniform([-0.45, -2.7, 0.0], [1.37, -0.1, 1.55], (samples, 3))
    v, a, force = rng.standard_normal((3, samples, 3))
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
    )


def test_registry_is_complete() -> None:
    """Every class that is not abstract is registered, under the name that model files use."""

    def descendants(cls: type) -> set[type]:
        return {cls} | {d for child in cls.__subclasses__() for d in descendants(child)}

    concrete = {cls for cls in descendants(Term) if not inspect.isabstract(cls)}
    concrete = {cls for cls in concrete if cls.__module__.startswith("crane_model.")}
    assert set(REGISTRY.values()) >= concrete
    for name, cls in REGISTRY.items():
        assert cls.model_fields["type"].default == name
        assert cls.family in get_args(Family)


def test_the_shipped_model_lists_no_column_twice() -> None:
    listed = read_yaml(packaged("crane_model", "crane_model.yaml"))["terms"]
    entries = [tuple(sorted(entry.items())) for entry in listed]
    assert len(entries) == len(set(entries))


@each_type
def test_docstring_holds_the_equation(name: str) -> None:
    doc = inspect.getdoc(REGISTRY[name])
    assert doc, f"{REGISTRY[name].__name__} has no docstring"
    assert EQUATION.search(doc), f"{REGISTRY[name].__name__}: no equation in: {doc}"


@each_type
def test_every_parameter_has_a_name_a_unit_and_a_meaning(name: str) -> None:
    parameters = example(name).parameters(SETTING)
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
    columns = term.columns(record, SETTING)
    assert columns.shape == (len(record), 3, len(term.parameters(SETTING)))
    assert columns.dtype == float
    assert np.isfinite(columns).all()
    assert (np.abs(columns).max(axis=(0, 1)) > 0.0).all(), "a column of zeros on a random motion"


@each_type
def test_columns_do_not_depend_on_what_stands_beside_them(name: str) -> None:
    """Written into a part of a larger array, and sample by sample where there is no memory."""
    record, term = random_record(), example(name)
    count = len(term.parameters(SETTING))
    larger = np.zeros((len(record), 3, count + 2))
    term.fill(record, SETTING, larger[:, :, 1:-1])
    np.testing.assert_array_equal(larger[:, :, 1:-1], term.columns(record, SETTING))
    assert not larger[:, :, [0, -1]].any()


@each_type
def test_columns_are_linear_in_acceleration_and_direction(name: str) -> None:
    """What forward simulation asks of a term: M a + rest + dry s, with s the direction."""
    rng, record, term = np.random.default_rng(21), random_record(), example(name)

    def columns(acceleration: np.ndarray, direction: np.ndarray) -> np.ndarray:
        changed = replace(record, acceleration=acceleration, direction_known=direction)
        return term.columns(changed, SETTING)

    a, b = rng.standard_normal((2, len(record), 3))
    s, t = rng.uniform(-1, 1, (2, len(record), 3))
    zero = np.zeros_like(a)
    rest = columns(zero, zero)
    combined = columns(2.0 * a - b, 0.5 * s + 0.25 * t) - rest
    by_a, by_b = columns(a, zero) - rest, columns(b, zero) - rest
    by_s, by_t = columns(zero, s) - rest, columns(zero, t) - rest
    np.testing.assert_allclose(combined, 2.0 * by_a - by_b + 0.5 * by_s + 0.25 * by_t, atol=1e-9)


@pytest.mark.parametrize("name", ON_ONE_JOINT)
@pytest.mark.parametrize("joint", PLANAR_JOINTS)
def test_term_of_a_joint_leaves_the_others_alone(name: str, joint: str) -> None:
    term = example(name, joint)
    assert all(p.name.endswith(f".{joint}") for p in term.parameters(SETTING))
    columns = term.columns(random_record(), SETTING)
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
    assert len(cls.effect.settled_by) > 10
    for field, shape in cls.shapes.items():
        assert field in cls.model_fields
        assert 0.0 < shape.lowest < shape.highest
        assert UNIT.fullmatch(shape.unit.split(" or ")[0]), shape.unit
        assert shape.grid[0] == pytest.approx(shape.lowest)
        assert shape.grid[-1] == pytest.approx(shape.highest)
