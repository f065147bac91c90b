"""Encoders that jump, and all that only seems so."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from crane_observer.monitor.readings import NEIGHBOURS, JumpWatch

STEP, PERIOD, COUNT = 4.8e-5, 0.005, 800  # rad, s, readings


def moving(amplitude: float, frequency: float) -> np.ndarray:
    return amplitude * np.sin(2.0 * np.pi * frequency * PERIOD * np.arange(COUNT))


def jumps(shown: np.ndarray, time: np.ndarray | None = None) -> list[tuple[float, float]]:
    """Size, and the time when it was found."""
    watch, found = JumpWatch(1), []
    for at, reading in zip(
        PERIOD * np.arange(len(shown)) if time is None else time, shown, strict=True
    ):
        watch.add(float(at), np.array([reading]))
        if watch.size[0]:
            found.append((float(watch.size[0]), float(at)))
            watch.forget()
    return found


def rounded(values: np.ndarray) -> np.ndarray:
    return np.asarray(STEP * np.round(values / STEP))


motion = {"amplitude": st.floats(0.0, 0.3), "frequency": st.floats(0.05, 3.0)}


@given(**motion, size=st.floats(1.5e-3, 0.05), up=st.booleans())
def test_a_jump_is_found_at_once_with_its_size(
    amplitude: float, frequency: float, size: float, up: bool
) -> None:
    """Of an encoder that moves by up to 0.3 rad/s and 1 rad/s2."""
    amplitude = min(max(amplitude, 0.01), 0.05 / frequency, 0.025 / frequency**2)
    size = size if up else -size
    shown = rounded(moving(amplitude, frequency) + size * (np.arange(COUNT) >= 500))
    ((found, at),) = jumps(shown)
    assert found == pytest.approx(size, abs=3.0 * STEP)
    assert at - 500 * PERIOD == pytest.approx(NEIGHBOURS * PERIOD)


@given(**motion, noise=st.floats(0.0, 30.0), seed=st.integers(0, 99))
def test_motion_rounding_and_noise_are_no_jumps(
    amplitude: float, frequency: float, noise: float, seed: int
) -> None:
    amplitude = min(amplitude, 0.05 / frequency)
    shaken = noise * STEP * np.random.default_rng(seed).uniform(-1.0, 1.0, COUNT)
    assert not jumps(rounded(moving(amplitude, frequency) + shaken))


@pytest.mark.parametrize("late", [0.002, 0.004, 0.02])
def test_stamps_that_are_late_are_no_jumps(late: float) -> None:
    """Of one reading, and of all by a random time."""
    true, time = rounded(moving(0.1, 0.5)), PERIOD * np.arange(COUNT)
    once = np.where(np.arange(COUNT) == 400, time + min(late, 0.9 * PERIOD), time)
    assert not jumps(true, once)
    shaken = time + np.random.default_rng(1).uniform(0.0, min(late, 0.9 * PERIOD), COUNT)
    assert not jumps(true, shaken)


def test_a_glitch_and_a_gap_are_no_jumps() -> None:
    true, time = rounded(moving(0.1, 0.5)), PERIOD * np.arange(COUNT)
    glitch = true + 0.1 * (np.arange(COUNT) == 400)
    assert not jumps(glitch)
    kept = (time < 1.0) | (time > 1.4)
    assert not jumps(true[kept], time[kept])
    true[300:310] = np.nan
    assert not jumps(true)


def test_an_encoder_that_stops_or_starts_is_no_jump() -> None:
    stuck = rounded(moving(0.1, 0.5))
    stuck[400:] = stuck[400]
    assert not jumps(stuck)
    assert not jumps(stuck[::-1])
