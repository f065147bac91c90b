"""Transducers behind filters of other forms than the catalogue's delay, by their signature."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.signal import lfilter
from unit.crane_identification.diagnosis.test_axis import FULL, model
from unit.crane_identification.diagnosis.test_strange import INNER, OUTER, decided
from unit.crane_identification.synthetic import axis_log

from crane_identification import Log, Options, Signal
from crane_identification.diagnosis.diagnosis import Diagnosis, diagnose
from crane_identification.diagnosis.findings import Verdict
from crane_identification.thresholds import load_thresholds
from crane_model import load_model, save_model

SEEDS = range(5)  # four recordings to train on, one to validate on
STEP = 0.01  # s between samples
NOISE = 0.5  # N

Filter = Callable[[np.ndarray], np.ndarray]


def moved(force: np.ndarray, delay: float) -> np.ndarray:
    time = STEP * np.arange(len(force))
    return np.interp(time - delay, time, force)


def twice(force: np.ndarray) -> np.ndarray:
    """Half of it 40 ms late, half of it 120 ms: the mean of two busses."""
    return 0.5 * (moved(force, 0.04) + moved(force, 0.12))


def two_lags(force: np.ndarray) -> np.ndarray:
    """Of first order, 60 ms each."""
    keep = np.exp(-STEP / 0.06)
    for _ in range(2):
        force = lfilter([1.0 - keep], [1.0, -keep], force, zi=[keep * force[0]])[0]
    return force


def early(force: np.ndarray) -> np.ndarray:
    """The encoders are late."""
    return moved(force, -0.08)


def diagnosed(folder: Path, shown: Filter) -> Diagnosis:
    """Of one axis whose force is shown by a filter."""
    given = model(folder, *FULL)

    def log(seed: int) -> Log:
        plain = axis_log(seed, given, periods=2, noise=0.0)
        assert plain.force is not None
        noise = NOISE * np.random.default_rng(seed).normal(size=len(plain.force.time))
        force = shown(plain.force.value[:, 0]) + noise
        return replace(plain, force=Signal(plain.force.time, force[:, np.newaxis], "f"))

    logs = [log(seed) for seed in SEEDS]
    return diagnose(given, logs[:-1], logs[-1:], Options(), load_thresholds())


@pytest.mark.parametrize("shown", [twice, two_lags, early], ids=lambda one: one.__name__)
def test_a_filter_of_any_form_is_a_delay(shown: Filter, tmp_path: Path) -> None:
    result = diagnosed(tmp_path, shown)
    (found,) = result.findings
    assert result.verdict is Verdict.NAMED
    assert found.candidate.type == "time_skew" and not found.judged.indistinct
    assert result.gap.closed[0] > 0.95
    save_model(tmp_path / "after.yaml", result.after)
    record = result.training.runs[0].record
    np.testing.assert_allclose(
        load_model(tmp_path / "after.yaml").predict(record), result.after.predict(record)
    )


@pytest.mark.parametrize("joint", [INNER, OUTER])
def test_a_transducer_that_is_late_is_neither_a_gain_nor_bent(joint: int) -> None:
    found = decided(joint, lambda p: two_lags(p[:, joint]))
    assert not found.beyond
    assert [one.shaped.candidate.type for one in found.passed] == ["time_skew"]
