"""What a machine is always off by is found again, whatever else happened now and then."""

import numpy as np
import pytest

from crane_observer.monitor.tolerance import fitted, regressors

ZERO, UP, DOWN = 3e4, -2e-3, 4e-3  # Pa, of the way
WIDER_UP, WIDER_DOWN = 6e-5, -4e-5  # of the stroke
SOFTER = 0.03  # of what the oil gives way
LATER, LEAK = -4e-3, 2e-14  # s, m3/(s Pa)


def made(rng: np.random.Generator, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Residuals of one channel, by hand, and their regressors."""
    t = 0.05 * np.arange(count)
    course = 1e-3 * np.sin(0.7 * t) * (1.0 + 0.9 * np.sin(0.05 * t))  # slow and fast
    pressed = 1e-10 * (1.2 + np.sin(0.31 * t)) * np.sign(np.cos(0.7 * t))
    null = 0.02 * (1.0 + 0.2 * np.cos(0.17 * t))
    squeezed = 1e-3 * np.cos(1.3 * t)
    late, leak = 1e-3 * np.sin(2.3 * t), 2e7 * (1.0 + 0.3 * np.sin(0.11 * t))
    residual = ZERO * pressed + np.where(course > 0.0, UP, DOWN) * course
    residual += np.where(course > 0.0, WIDER_UP, -WIDER_DOWN) * null
    residual += SOFTER * squeezed + LATER * late + LEAK * leak
    residual += 2e-6 * rng.standard_normal(count)
    parts = (pressed, course, null, squeezed, late, leak)
    return residual[:, None], regressors(*(part[:, None] for part in parts))


def test_what_is_always_off_is_found_beside_noise_and_outliers() -> None:
    rng = np.random.default_rng(5)
    residual, columns = made(rng, 6000)
    residual[2000:2060] += 1e-4  # a chamber that sucked air
    found = fitted([(residual, columns), made(rng, 3000)])
    assert found[0, 0] == pytest.approx(ZERO, rel=0.05)
    assert found[0, 1:3] == pytest.approx([UP, DOWN], abs=5e-4)
    assert found[0, 3:5] == pytest.approx([WIDER_UP, WIDER_DOWN], abs=1.5e-5)  # 2.5 standard errors
    assert found[0, 5] == pytest.approx(SOFTER, abs=2e-3)
    assert found[0, 6] == pytest.approx(LATER, abs=2e-4)
    assert found[0, 7] == pytest.approx(LEAK, rel=0.05)


def test_a_channel_in_which_nothing_moves_is_trimmed_by_nothing() -> None:
    nothing = np.zeros((2000, 1))
    assert not fitted([(nothing, regressors(*[nothing] * 6))]).any()
