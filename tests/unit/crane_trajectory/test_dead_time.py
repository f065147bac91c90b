"""`predictive_flow`: margins of its loop against simulated loops, and what it does with a joint."""

import numpy as np
import pytest

from crane_trajectory.control.dead_time import (
    LEAST_MARGINS,
    PredictorGains,
    margins,
    predictor_gains,
)

STEP_S = 0.005


def left_over(gains: PredictorGains, lag: float, late: float, gain: float) -> float:
    """How far a joint swings in the end that begins 1 rad off: it integrates `gain` times the speed
    asked for, `late` s late, and its controller believes in 1 and in `lag`.
    """
    count, known, true = int(40.0 / STEP_S), round(lag / STEP_S), round(late / STEP_S)
    sent, course = np.zeros(count), np.ones(count)
    q0, d = 1.0, 0.0
    for k in range(1, count):
        course[k] = course[k - 1] + STEP_S * gain * (sent[k - true] if k >= true else 0.0)
        off = course[k] - q0
        q0 += STEP_S * ((sent[k - known] if k >= known else 0.0) + d + gains.l1 * off)
        d += STEP_S * gains.l2 * off
        ahead = q0 + STEP_S * sent[max(0, k - known) : k].sum() + lag * d
        sent[k] = -gains.kv * ahead - d
    return float(np.abs(course[-count // 4 :]).max())


@pytest.mark.parametrize("lag", [0.15, 0.4])
def test_loops_swing_beyond_their_margins_and_settle_within(lag: float) -> None:
    gains = predictor_gains(lag)
    found = margins(gains, lag)
    assert left_over(gains, lag, lag, 0.85 * found.gain) < 0.1
    assert left_over(gains, lag, lag, 1.15 * found.gain) > 1.0
    assert left_over(gains, lag, lag + 0.85 * found.delay, 1.0) < 0.2
    assert left_over(gains, lag, lag + 1.15 * found.delay, 1.0) > 1.0


@pytest.mark.parametrize("lag", [0.0, 0.03, 0.1, 0.2, 0.4, 0.6])
def test_every_lag_gets_gains_with_the_margins_that_are_wanted(lag: float) -> None:
    gains = predictor_gains(lag)
    gain, phase, delay = margins(gains, max(lag, 0.02))
    assert gain >= LEAST_MARGINS[0] and phase >= LEAST_MARGINS[1]
    assert delay >= LEAST_MARGINS[2] * lag
    assert gains.kv * lag < 1.0


def test_a_loop_that_is_unstable_has_no_margins() -> None:
    assert margins(PredictorGains(10.0, 200.0, 1e4), 0.4).gain <= 1.1
