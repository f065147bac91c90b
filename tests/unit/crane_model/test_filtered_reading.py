"""Readings through filters: weights of later instants restore what the machine felt."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

from crane_model import Model, Record, simulate
from crane_model.terms import Setting
from crane_model.terms.sensing import LEADS_S, FilteredReading, TimeSkew
from crane_model.terms.single_axis import Inertia

AXIS = Setting({"axis": "m"}, None)
STEP = 0.01
TIME = np.arange(0.0, 20.0, STEP)
TERM = FilteredReading(joint="axis", knots=LEADS_S)
LED = [lead for lead in LEADS_S if lead]


def felt(time: np.ndarray) -> np.ndarray:
    return 900.0 * np.sin(2.0 * time) + 400.0 * np.sin(7.0 * time + 1.0)


def shown(force: np.ndarray) -> Record:
    still = np.zeros((len(force), 1))
    return Record(("axis",), TIME, still, still, still, force=force[:, np.newaxis])


@pytest.mark.parametrize("delay", [0.15, -0.1])
def test_the_weight_of_one_lead_restores_what_a_delay_has_moved(delay: float) -> None:
    record = shown(felt(TIME - delay))
    weights = np.isclose(LED, delay).astype(float)
    restored = felt(TIME - delay) + TERM.columns(record, AXIS)[:, 0] @ weights
    inside = (TIME > 0.5) & (TIME < 19.5)
    np.testing.assert_allclose(restored[inside], felt(TIME)[inside], atol=1e-6)


def test_a_force_that_stays_is_shown_as_it_is() -> None:
    """By which a filter differs from a gain."""
    assert not TERM.columns(shown(np.full(len(TIME), 700.0)), AXIS).any()


def test_weights_restore_a_filter_whose_form_no_delay_has() -> None:
    """Two lags of first order by SciPy; the rate of the force leaves ten times as much."""
    keep = np.exp(-STEP / 0.08)
    once = lfilter([1.0 - keep], [1.0, -keep], felt(TIME))
    record = shown(lfilter([1.0 - keep], [1.0, -keep], once))
    assert record.force is not None
    inside = (TIME > 2.0) & (TIME < 19.0)
    missing = (felt(TIME) - record.force[:, 0])[inside]

    def left(columns: np.ndarray) -> float:
        columns = columns[inside, 0]
        rest = missing - columns @ np.linalg.lstsq(columns, missing)[0]
        return float(np.linalg.norm(rest) / np.linalg.norm(missing))

    rate = left(TimeSkew(joint="axis").columns(record, AXIS))
    assert left(TERM.columns(record, AXIS)) < 0.1 * rate


def test_leads_do_not_reach_into_another_run() -> None:
    half = len(TIME) // 2
    force = np.where(np.arange(len(TIME)) < half, 100.0, 900.0)
    record = replace(shown(force), run=np.repeat([0, 1], half))
    assert not TERM.columns(record, AXIS).any()


def test_a_long_delay_is_the_change_over_its_lead_and_none_is_the_rate() -> None:
    delay = 0.2
    record = shown(felt(TIME - delay))
    inside = (TIME > 0.5) & (TIME < 19.5)
    columns = TimeSkew(joint="axis", lead=delay).columns(record, AXIS)[:, 0, 0]
    expected = felt(TIME - delay) - felt(TIME)  # what is shown beyond what is felt
    np.testing.assert_allclose(delay * columns[inside], expected[inside], atol=1e-6)
    short, rate = (
        TimeSkew(joint="axis", lead=lead).columns(record, AXIS)[:, 0, 0] for lead in (0.002, 0.0)
    )
    np.testing.assert_allclose(short[inside], rate[inside], atol=0.05 * np.abs(rate).max())


@pytest.mark.parametrize("late", ["time_skew", "filtered_reading"])
def test_a_machine_is_simulated_under_what_it_felt_and_not_what_was_shown(late: str) -> None:
    delay, mass = 0.1, 12.0
    weights = {"time_skew": [delay], "filtered_reading": -np.isclose(LED, delay).astype(float)}
    term = {"time_skew": TimeSkew(joint="axis", lead=delay), "filtered_reading": TERM}[late]
    drive = felt(TIME - delay)[:, np.newaxis, np.newaxis]
    true = Model("true", AXIS, (Inertia(joint="axis"),), np.array([mass]))
    model = Model("late", AXIS, (Inertia(joint="axis"), term), np.array([mass, *weights[late]]))
    start = np.zeros((1, 1))
    wanted = simulate(true, start, start, felt(TIME)[:, np.newaxis, np.newaxis], STEP)
    found = simulate(model, start, start, drive, STEP)
    size = np.ptp(wanted.velocity)
    before_the_end = TIME < 19.8
    np.testing.assert_allclose(
        found.velocity[before_the_end], wanted.velocity[before_the_end], atol=0.01 * size
    )
    without = simulate(true, start, start, drive, STEP)
    assert np.abs(without.velocity - wanted.velocity).max() > 0.1 * size


def test_the_samples_that_are_taken_keep_what_is_known_of_later_ones() -> None:
    record = replace(shown(felt(TIME)), force_at=lambda lead: felt(TIME + lead)[:, np.newaxis])
    part = record.take(slice(100, 200))
    expected = TERM.columns(record, AXIS)[100:200]
    np.testing.assert_array_equal(TERM.columns(part, AXIS), expected)
