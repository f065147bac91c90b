from dataclasses import replace

import numpy as np
import pytest
from unit.crane_identification.report.synthetic_crane import RATE, crane_model

from crane_identification import Log, Signal
from crane_identification.report.content import left_out, recorded
from crane_identification.signals.kalman import KalmanSmoother
from crane_identification.signals.routes import ButterworthDifferentiator
from crane_model import generalized_forces

BANDWIDTH = np.full(3, 3.0)


def without(log: Log, begin: float, end: float) -> Log:
    """The log with a hole in all its signals."""

    def cut(signal: Signal) -> Signal:
        kept = (signal.time < begin) | (signal.time > end)
        return Signal(signal.time[kept], signal.value[kept], signal.origin)

    signals = {k: cut(v) for k, v in vars(log).items() if isinstance(v, Signal)}
    return replace(log, **signals)


def test_whole_recording_with_forces_from_its_pressures(training):
    log = training[0]
    recording = recorded(crane_model(), log, KalmanSmoother(), BANDWIDTH)
    assert len(recording.time) == len(log.position.time)
    np.testing.assert_allclose(recording.position, log.position.value)
    signals = (log.position, log.pressure_a, log.pressure_b)
    expected = generalized_forces(
        crane_model().machine, *(signal.value for signal in signals), log.joints
    )
    np.testing.assert_allclose(recording.force, expected)
    np.testing.assert_allclose(recording.reference_velocity, log.reference_velocity.value)


@pytest.mark.parametrize("motion", [KalmanSmoother(), ButterworthDifferentiator(cutoff=3.0)])
def test_velocity_is_the_derivative_of_the_position(training, motion):
    log = training[0]
    recording = recorded(crane_model(), log, motion, BANDWIDTH)
    away_from_ends = slice(200, -200)
    velocity, position = recording.velocity[away_from_ends], recording.position[away_from_ends]
    moved = np.cumsum(0.5 * (velocity[1:] + velocity[:-1]), axis=0) / RATE
    np.testing.assert_allclose(moved, position[1:] - position[0], atol=2e-3)
    roughness = np.abs(np.diff(velocity, n=2, axis=0)).max()
    assert roughness < np.abs(velocity).max() / 100


def test_a_measured_force_is_taken_as_it_is(training):
    log = training[0]
    force = np.random.default_rng(0).standard_normal(log.position.value.shape)
    log = replace(log, force=Signal(log.position.time, force, "force"))
    recording = recorded(crane_model(), log, KalmanSmoother(), BANDWIDTH)
    np.testing.assert_allclose(recording.force, force)


def test_a_gap_is_open_in_every_curve(training):
    log = without(training[0], 10.0, 13.0)
    recording = recorded(crane_model(), log, KalmanSmoother(), BANDWIDTH)
    empty = np.flatnonzero(np.isnan(recording.position).any(axis=1))
    assert len(empty) == 1
    assert 9.9 < recording.time[empty[0]] < 10.1
    assert (np.diff(recording.time) > 0).all()
    for values in (recording.velocity, recording.force, recording.reference_position):
        assert np.isnan(values[empty]).all()


def test_a_log_without_reference(training):
    log = replace(training[0], reference_position=None, reference_velocity=None)
    recording = recorded(crane_model(), log, KalmanSmoother(), BANDWIDTH)
    assert recording.reference_position is None


def test_stretches_left_out_are_those_of_the_mask(report):
    preparation = report.validations[0].preparation
    stretches = left_out(preparation, 1)
    time = preparation.record.time + 0.5 * preparation.step
    inside = np.any([(a < time) & (time < b) for a, b in stretches], axis=0)
    np.testing.assert_array_equal(inside, ~preparation.moving[:, 1])
