"""Lines in the force of all recordings, beside booms that swing in each at another frequency."""

from pathlib import Path

import numpy as np
import pytest

from crane_identification.diagnosis.evidence import Run
from crane_identification.diagnosis.gap import (
    SPACING,
    Line,
    clearest_lines,
    pulsations,
)
from crane_identification.thresholds import load_thresholds
from crane_model import Model, Record, load_model

RATE, LONG = 200.0, 60.0  # Hz, s
LINE, DRIVEN = 3.263, 1.61  # Hz
FORCE = 1e3  # N, rms
THRESHOLDS = load_thresholds()


def found(model: Model, given: list[Run]) -> tuple[Line, ...]:
    """By the gate of the package."""
    lines = clearest_lines(model, given, THRESHOLDS.method.pulsation_recordings)
    return pulsations(lines, THRESHOLDS)


@pytest.fixture
def model(tmp_path: Path) -> Model:
    """Two axes of inertia 1, fitted."""
    (tmp_path / "two.yaml").write_text(
        "name: two axes\njoints: {one: m, other: m}\n"
        "terms:\n  - {type: inertia, joint: one}\n  - {type: inertia, joint: other}\n"
    )
    return load_model(tmp_path / "two.yaml").with_estimate(np.ones(2), np.ones(2), "by hand")


def runs(model: Model, count: int, rms: float) -> list[Run]:
    """Recordings of motion that is driven at the same frequency in all, swinging booms and noise;
    the force of the other axis pulsates by `rms` of it as well.
    """
    rng = np.random.default_rng(3)
    time = np.arange(0.0, LONG, 1.0 / RATE)
    zeros = np.zeros((len(time), 2))
    out = []
    for number in range(count):
        slow = np.sin(2.0 * np.pi * rng.uniform(0.04, 0.06) * time)
        slow += 0.3 * np.sin(2.0 * np.pi * DRIVEN * time)
        slow *= FORCE / np.sqrt((slow**2).mean())
        swing = 0.05 * np.sin(2.0 * np.pi * rng.uniform(1.5, 5.0) * time + rng.uniform(0.0, 6.0))
        rest = swing * np.exp(-0.2 * (time % 10.0)) + 0.05 * rng.standard_normal(len(time))
        line = np.sqrt(2.0) * rms * np.sin(2.0 * np.pi * LINE * time + number)
        force = slow[:, np.newaxis] + FORCE * np.stack([rest, rest + line], axis=1)
        record = Record(
            joints=model.joints,
            time=time,
            position=zeros,
            velocity=zeros,
            acceleration=np.repeat(slow[:, np.newaxis], 2, axis=1),
            force=force,
        )
        out.append(Run(f"bag {number}", number, record, np.ones((len(time), 2)), 80))
    return out


def test_a_line_in_all_recordings_is_found_with_its_frequency_and_strength(model: Model):
    (one,) = found(model, runs(model, 8, 0.01))
    assert one.joint == "other"
    assert one.frequency == pytest.approx(LINE, abs=2.0 * SPACING)
    assert one.relative_magnitude == pytest.approx(0.01, rel=0.1)


def test_swinging_booms_and_driven_motion_are_no_pulsation(model: Model):
    assert found(model, runs(model, 8, 0.0)) == ()


def test_motion_that_the_model_does_not_explain_is_one(model: Model):
    wrong = model.with_estimate(np.array([1.0, 0.5]), np.ones(2), "by hand")
    (one,) = found(wrong, runs(model, 8, 0.0))
    assert (one.joint, one.frequency) == ("other", pytest.approx(DRIVEN, abs=2.0 * SPACING))


def test_a_few_recordings_do_not_tell(model: Model):
    assert found(model, runs(model, 3, 0.01)) == ()
