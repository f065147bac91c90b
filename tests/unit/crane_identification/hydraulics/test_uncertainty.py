"""Standard deviations of few correlated blocks, and what the rounding of an encoder leaves."""

import numpy as np
import pytest
from scipy import signal

from crane_identification.hydraulics.balance import (
    CUT_OFF,
    FLOW_FILTER_ORDER,
    WHITENED,
    Passage,
    PassageRows,
    between_counts,
)
from crane_identification.hydraulics.projection import block_covariance

STEP = 0.005  # s
COUNT = 1e-4  # m


def test_intervals_from_few_blocks_cover() -> None:
    """Twelve blocks, three of which tell nearly all: normal intervals of a scatter cover 85 %."""
    rng = np.random.default_rng(1)
    blocks = np.repeat(np.arange(12), 6)
    rows = rng.normal(size=(len(blocks), 2)) * np.where(blocks < 3, 4.0, 1.0)[:, np.newaxis]
    bread = np.linalg.inv(rows.T @ rows)
    hits = []
    for _ in range(800):
        noise = np.repeat(rng.normal(size=12), 6) + rng.normal(size=len(blocks))
        error = bread @ rows.T @ noise
        std_dev = np.sqrt(np.diag(block_covariance(rows, noise - rows @ error, bread, blocks)))
        hits.append(np.abs(error) < 1.96 * std_dev)
    assert 0.93 < np.mean(hits) < 0.99


@pytest.mark.parametrize("speed", [3e-4, 0.03], ids=["creeping", "fast"])
def test_rounding_is_known_at_any_speed(speed: float) -> None:
    """White noise of a count would tell it of a fast joint, and too little of a slow one."""
    time = STEP * np.arange(12000)
    x = 1.0 + speed * 3.0 * np.sin(time / 3.0)
    readings = np.round(x / COUNT)
    passage = Passage(
        source="made",
        step=STEP,
        time=time,
        length=COUNT * readings,
        counts=between_counts(time, readings, time),
        resolution=np.full(len(time), COUNT),
        pressures={},
        stamps=time,
        commands=np.zeros(len(time)),
    )
    rows = PassageRows(passage)
    true = PassageRows(Passage(**{**vars(passage), "length": x})).speed
    left = float(np.std(rows.speed - true))
    known = np.mean([np.var(rows.speed_rounding(shift)) for shift in np.arange(16) / 16])
    assert np.sqrt(known) == pytest.approx(left, rel=0.25)
    white = COUNT / np.sqrt(12.0) * _gain_of_white()
    assert (left > 2.0 * white) == (speed < 1e-3)


def _gain_of_white() -> float:
    """Standard deviation of the filtered speed per standard deviation of white noise [1/s]."""
    noise = np.random.default_rng(2).normal(size=40000)
    slope = (noise[2:] - noise[:-2]) / (2.0 * STEP)
    low = signal.sosfiltfilt(
        signal.butter(FLOW_FILTER_ORDER, CUT_OFF, fs=1.0 / STEP, output="sos"), slope
    )
    whole = signal.butter(1, WHITENED, fs=1.0 / STEP, output="sos")
    return float(np.std(signal.sosfilt(whole, low)))
