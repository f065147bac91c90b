"""Nonparametric curves: splines at knots, which a model file carries and a simulation follows."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.interpolate import BSpline, make_interp_spline
from scipy.signal import lfilter
from unit.crane_model.test_term_registry import SETTING, example, random_record

from crane_model import ConfigurationError, Model, Record, load_model, save_model
from crane_model.terms import REGISTRY, NonparametricTerm, Setting, term_from_mapping
from crane_model.terms.friction import PadFriction
from crane_model.terms.nonparametric import (
    NonparametricEndDamping,
    NonparametricLoadFriction,
    NonparametricPadFriction,
    NonparametricPositionForce,
    NonparametricWarmUp,
    RelaxingForce,
    hats,
    rounded,
)

DRAWN = sorted(name for name, cls in REGISTRY.items() if issubclass(cls, NonparametricTerm))
OF_ONE_INSTANT = sorted(set(DRAWN) - {"filtered_reading"})
KNOTS = (-1.0, -0.2, 0.1, 0.5, 2.0)
AXIS = Setting({"axis": "m"}, None)


def axis(time: np.ndarray, q: np.ndarray, v: np.ndarray) -> Record:
    return Record(("axis",), time, q[:, None], v[:, None], np.zeros((len(q), 1)))


def test_hats_are_the_splines_of_scipy() -> None:
    """Of degree one, over knots of any spacing."""
    x = np.linspace(-1.0, 2.0, 301)[:-1]
    padded = np.array([KNOTS[0], *KNOTS, KNOTS[-1]])
    expected = BSpline.design_matrix(x, padded, 1).toarray()
    np.testing.assert_allclose(hats(x, KNOTS), expected, atol=1e-12)


def test_beyond_its_knots_a_shape_stays_as_it_is_there() -> None:
    beyond = hats(np.array([-9.0, 9.0]), KNOTS)
    np.testing.assert_array_equal(beyond, [[1, 0, 0, 0, 0], [0, 0, 0, 0, 1]])


def test_a_straight_shape_goes_on_beyond_its_knots() -> None:
    x, values = np.array([-3.0, -1.0, 0.3, 2.0, 5.0]), np.array([2.0, -1.0, 0.5, 3.0, 1.0])
    expected = make_interp_spline(KNOTS, values, k=1)(x)
    np.testing.assert_allclose(hats(x, KNOTS, straight=True) @ values, expected, atol=1e-12)


@pytest.mark.parametrize("name", OF_ONE_INSTANT)
def test_a_drawn_law_is_its_values_at_the_knots_times_its_factors(name: str) -> None:
    """By scipy's interpolation through the curves that it draws, zeros and all."""
    term, record, rng = example(name), random_record(), np.random.default_rng(7)
    assert isinstance(term, NonparametricTerm)
    j = record.column(term.joint)
    values = rng.standard_normal(len(term.parameters(SETTING)))
    curves = term.curves(values)
    assert [one.times for one in curves] == list(term.times)
    x, factors = term.followed(record, j), term.factors(record, SETTING, j)
    x = x if term.straight else np.clip(x, term.knots[0], term.knots[-1])
    expected = sum(
        make_interp_spline(one.knots, one.values, k=1)(x) * factors[:, k]
        for k, one in enumerate(curves)
    )
    moves = record.direction[:, j] != 0.0  # at rest friction may be anything between both ways
    found = term.columns(record, SETTING)[:, j] @ values
    np.testing.assert_allclose(found[moves], expected[moves], atol=1e-9)


def test_pads_whose_load_is_linear_are_one_of_their_shapes() -> None:
    """Straight lines through m_0 + m_1 q4 at the knots."""
    record, knots = random_record(), (0.0, 0.3, 0.6, 0.9, 1.2, 1.6)
    drawn = NonparametricPadFriction(joint="telescope", knots=knots).columns(record, SETTING)
    pads = PadFriction(joint="telescope").columns(record, SETTING)
    np.testing.assert_allclose(
        drawn @ (40.0 + 25.0 * np.array(knots)), pads @ [40.0, 25.0], atol=1e-9
    )


def test_only_the_telescope_has_pads() -> None:
    with pytest.raises(ConfigurationError, match="only telescope slides on pads"):
        NonparametricPadFriction(joint="outer_boom", knots=(0, 1, 2, 3, 4, 5)).parameters(SETTING)


@pytest.mark.parametrize("name", DRAWN)
def test_the_laws_that_are_drawn_are_in_the_catalogue_and_drawn_once(name: str) -> None:
    cls = REGISTRY[name]
    assert issubclass(cls, NonparametricTerm)
    others = {law for other in DRAWN if other != name for law in REGISTRY[other].draws}  # type: ignore[attr-defined]
    for law in cls.draws:
        effect = REGISTRY[law].effect
        assert effect is not None
        assert law not in others
    assert cls.effect is None  # it never races


def test_knots_lie_over_the_range_and_those_of_time_where_samples_are() -> None:
    x = np.array([0.3, 1.5, -0.5])
    knots = NonparametricPositionForce.over(x)
    np.testing.assert_allclose(knots, np.linspace(-0.5, 1.5, 9))
    time = np.concatenate([np.linspace(0.0, 60.0, 500), np.linspace(7200.0, 7260.0, 500)])
    knots = NonparametricWarmUp.over(time)
    assert sum(60.0 < one < 7200.0 for one in knots) == 0
    assert rounded(np.array([-1.09e-5, 0.123456])) == (0.0, 0.1235)


@pytest.mark.parametrize(
    ("knots", "said"),
    [
        ((0.0, 0.1, 0.2, 0.3), "9 needed, got 4"),
        ((0.0, 0.1, 0.1, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8), "each must exceed the one before"),
    ],
)
def test_knots_that_are_no_knots_are_named(knots: tuple[float, ...], said: str) -> None:
    with pytest.raises(ValueError, match=said):
        term_from_mapping({"type": "nonparametric_position_force", "joint": "axis", "knots": knots})


def test_a_model_file_carries_a_shape(tmp_path: Path) -> None:
    term = NonparametricPositionForce(joint="axis", knots=tuple(np.linspace(0.0, 1.0, 9).tolist()))
    values = np.arange(8.0)
    model = Model("one", AXIS, (term,)).with_estimate(values, np.ones(8), "drawn")
    save_model(tmp_path / "model.yaml", model)
    read = load_model(tmp_path / "model.yaml")
    assert read.terms == (term,)
    q = np.linspace(-0.2, 1.2, 50)
    force = read.predict(axis(np.arange(50.0), q, np.ones(50)))[:, 0]
    np.testing.assert_allclose(force, np.interp(q, term.knots, [0.0, *values]), atol=1e-9)


def test_a_shape_of_cushioning_leaves_the_middle_alone() -> None:
    term = NonparametricEndDamping(
        joint="axis", knots=NonparametricEndDamping.over(np.array([0.0, 1.0]))
    )
    q = np.array([0.0, 0.1, 0.3, 0.5, 0.79, 0.9, 1.0])
    columns = term.columns(axis(np.arange(7.0), q, np.full(7, 0.2)), AXIS)[:, 0]
    assert not columns[2:5].any()
    assert columns[[0, 1, 5, 6]].any(axis=1).all()
    np.testing.assert_allclose(columns[:, 1::2], 0.2 * columns[:, ::2])  # q'|q'| beside q'


def test_a_force_fades_as_a_spring_behind_a_damper_does() -> None:
    """z' = q' - z/T of each spring, by SciPy's filter of the same step."""
    time = np.arange(0.0, 6.0, 0.01)
    q = np.where(time < 3.0, 0.1 * np.sin(2.0 * time), 0.1 * np.sin(6.0))
    term = RelaxingForce(joint="axis", times=(0.5, 2.0))
    z = term.columns(axis(time, q, np.gradient(q, time)), AXIS)[:, 0]
    for column, T in zip(z.T, term.times, strict=True):
        kept = np.exp(-0.01 / T)
        expected = lfilter([(1.0 - kept) * T / 0.01], [1.0, -kept], np.diff(q, prepend=q[:1]))
        np.testing.assert_allclose(column, expected, atol=1e-12)
    at_rest = z[time >= 3.0]
    np.testing.assert_allclose(
        at_rest[-1] / at_rest[0], np.exp(-(time[-1] - 3.0) / np.array(term.times)), rtol=0.02
    )


def test_a_model_without_that_joint_is_refused() -> None:
    with pytest.raises(ConfigurationError, match="no joint 'boom'"):
        RelaxingForce(joint="boom").parameters(AXIS)


def test_friction_of_the_load_is_found_whatever_friction_the_force_holds() -> None:
    """|load| sgn(v) is a shape over the measured force against the motion, which holds Coulomb
    friction as well: no function of |force| is it.
    """
    rng = np.random.default_rng(3)
    load, v = rng.uniform(-1000.0, 1000.0, 4000), rng.choice([-0.1, 0.1], 4000)
    s, coulomb = np.sign(v), 500.0
    measured = load + coulomb * s
    record = replace(
        axis(np.arange(4000.0), 0.0 * v, v), force=measured[:, None], direction_known=s[:, None]
    )
    term = NonparametricLoadFriction(
        joint="axis",
        knots=NonparametricLoadFriction.over(NonparametricLoadFriction.followed(record, 0)),
    )
    base = np.stack([load, s], axis=1)
    columns = np.concatenate([base, term.columns(record, AXIS)[:, 0]], axis=1)
    over_size = np.concatenate(
        [base, hats(np.abs(measured), tuple(np.linspace(0.0, 1500.0, 11))) * s[:, None]], axis=1
    )
    wanted = np.abs(load) * s

    def left(known: np.ndarray) -> float:
        rest = wanted - known @ np.linalg.lstsq(known, wanted)[0]
        return float(np.linalg.norm(rest) / np.linalg.norm(wanted))

    assert left(columns) < 0.1 * left(over_size)
