"""Held-out force where an axis turns back and rings, faster than its motion can be told."""

from dataclasses import replace

import numpy as np
import pytest

from crane_identification import Validation
from crane_identification.preparation.run import Averaging, Preparation, drift
from crane_identification.signals.motion import smoothed_alike
from crane_identification.validation.force_validation import compare
from crane_model import Model, Record
from crane_model.terms import Setting, friction, single_axis

STEP, PERIOD = 0.005, 20.0  # s
BANDWIDTH, FACTOR = 17.5, 22  # Hz; of the parallel filter
MASS, FRICTION = 2000.0, 420.0  # kg, N
GUARD = 0.08  # s about a reversal where the sign of the velocity is not known
SETTLING = 0.1  # s
TRUE = np.array([MASS, FRICTION])


def model(theta: np.ndarray) -> Model:
    terms = (single_axis.Inertia(joint="axis"), friction.Coulomb(joint="axis"))
    made = Model("axis", Setting({"axis": "m"}, None), terms)
    return made.with_estimate(theta, 0.0 * theta, "true values")


def derivative(values: np.ndarray) -> np.ndarray:
    """Of one period (n, j)."""
    omega = 2j * np.pi * np.fft.rfftfreq(len(values), STEP)[:, np.newaxis]
    return np.fft.irfft(omega * np.fft.rfft(values, axis=0), len(values), axis=0)


def ringing() -> Preparation:
    """One period: a slow sine that drops to rest and rings at 9 Hz behind each of its reversals."""
    n = round(PERIOD / STEP)
    time = STEP * np.arange(n)
    velocity = 0.6 * np.sin(2 * np.pi * 2 * time / PERIOD)
    turns = PERIOD / 4 * np.arange(4)
    since = (time - turns[:, np.newaxis] + PERIOD / 2) % PERIOD - PERIOD / 2
    burst = -0.02 * np.exp(-((since / 0.04) ** 2)) * np.sin(2 * np.pi * 9.0 * since)
    velocity = (velocity + (burst * (-1.0) ** np.arange(4)[:, np.newaxis]).sum(axis=0))[:, None]
    force = MASS * derivative(velocity) + FRICTION * np.sign(velocity)
    seen = smoothed_alike(velocity, np.array([BANDWIDTH]), STEP, True)
    away = np.abs(since).min(axis=0)[:, np.newaxis]
    moving = away > GUARD + SETTLING
    record = Record(("axis",), time, 0.0 * seen, seen, derivative(seen), force=force)
    periods = np.stack([force, force])
    return Preparation(
        source="made",
        record=record,
        step=STEP,
        moving=moving,
        signed=away > GUARD,
        bandwidth=np.array([BANDWIDTH]),
        averaging=Averaging(PERIOD, 2, 0, 0.0, drift(periods, moving)),
        periods=periods,
        reference=None,
    )


def held_out(theta: np.ndarray, preparation: Preparation) -> Validation:
    return compare(model(theta), preparation, FACTOR)


def test_the_true_model_leaves_next_to_nothing() -> None:
    """The smeared acceleration cancels under the filter, for all of it is on both sides."""
    assert held_out(TRUE, ringing()).relative_error[0] < 2.5e-3


@pytest.mark.parametrize("wrong", [(1.1, 1.0), (1.0, 1.2), (1.0, 0.8)])
def test_a_wrong_model_shows_as_before(wrong: tuple[float, float]) -> None:
    """What it is wrong by, as the filter passes it, within a tenth."""
    made, theta = ringing(), TRUE * wrong
    off = (model(theta).predict(made.record) - model(TRUE).predict(made.record))[:, 0]
    expected = np.linalg.norm(off) / np.linalg.norm(made.record.force)
    assert held_out(theta, made).relative_error[0] == pytest.approx(expected, rel=0.1)


def test_a_joint_that_stands_costs_nothing_while_friction_holds_it() -> None:
    """However fast the force that friction holds, and whatever bandwidth rest seems to have."""
    made = ringing()
    force = 0.9 * FRICTION * np.sin(2 * np.pi * 1.5 * made.record.time)[:, np.newaxis]
    still = np.zeros_like(force)
    resting = replace(
        made,
        record=replace(made.record, velocity=still, acceleration=still, force=force),
        moving=still > 0.0,
        signed=still > 0.0,
        bandwidth=np.array([0.05]),
    )
    with np.errstate(invalid="ignore"):  # there is no row at which it moves
        assert held_out(TRUE, resting).relative_error[0] < 1e-9


def test_smoothing_passes_what_is_slow_and_halves_what_is_at_the_bandwidth() -> None:
    time = STEP * np.arange(4000)
    for frequency, left in ((0.5, 1.0), (10.0, 0.5), (40.0, 1 / (1 + 4.0**6))):
        wave = np.sin(2 * np.pi * frequency * time)[:, np.newaxis]
        out = smoothed_alike(wave, np.array([10.0]), STEP, True)
        np.testing.assert_allclose(out, left * wave, atol=1e-6)
    line = 3.0 + 0.5 * time[:, np.newaxis]
    ends = smoothed_alike(line, np.array([10.0]), STEP, False)
    np.testing.assert_allclose(ends, line, atol=0.02)
    assert smoothed_alike(line, np.array([np.inf]), STEP, False) == pytest.approx(line)
