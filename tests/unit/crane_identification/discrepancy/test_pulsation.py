"""Lines in the force of all recordings, beside booms that swing in each at another frequency."""

import numpy as np
import pytest

from crane_identification.discrepancy.evidence import Run
from crane_identification.discrepancy.pulsation import SPACING, pulsations
from crane_model.record import Record

JOINTS = ("inner_boom", "outer_boom")
RATE, LONG = 200.0, 60.0  # Hz, s
LINE = 3.263  # Hz


def runs(count: int, rms: float) -> list[Run]:
    """Recordings of slow motion, a swinging boom and noise; the outer boom's force of rms 1 kN
    pulsates by `rms` as well.
    """
    rng = np.random.default_rng(3)
    time = np.arange(0.0, LONG, 1.0 / RATE)
    out = []
    for number in range(count):
        slow = np.sqrt(2.0) * np.sin(2.0 * np.pi * rng.uniform(0.04, 0.06) * time)
        swing = 0.05 * np.sin(2.0 * np.pi * rng.uniform(1.5, 5.0) * time + rng.uniform(0.0, 6.0))
        force = slow + swing * np.exp(-0.2 * (time % 10.0)) + 0.05 * rng.standard_normal(len(time))
        line = np.sqrt(2.0) * rms * np.sin(2.0 * np.pi * LINE * time + number)
        zeros = np.zeros((len(time), 2))
        record = Record(
            joints=JOINTS,
            time=time,
            position=zeros,
            velocity=zeros,
            acceleration=zeros,
            force=1e3 * np.stack([force, force + line], axis=1),
        )
        out.append(Run(f"bag {number}", number, record, np.ones((len(time), 2)), 80))
    return out


def test_a_line_in_all_recordings_is_found_with_its_frequency_and_strength():
    (found,) = pulsations(JOINTS, runs(8, 0.01))
    assert found.joint == "outer_boom"
    assert found.frequency == pytest.approx(LINE, abs=2.0 * SPACING)
    assert found.strength == pytest.approx(0.01, rel=0.1)


def test_booms_that_swing_are_no_pulsation():
    assert pulsations(JOINTS, runs(8, 0.0)) == ()


def test_a_few_recordings_do_not_tell():
    assert pulsations(JOINTS, runs(3, 0.01)) == ()


def test_recordings_shorter_than_the_band_above_the_rows_are_not_asked():
    short = [
        Run(one.source, one.number, one.record, one.gate, factor=1) for one in runs(8, 0.01)
    ]  # the rows hold all frequencies
    assert pulsations(JOINTS, short) == ()
