"""Which rows may be used."""

import numpy as np

from crane_identification.online.estimator import Gate
from crane_identification.online.streams import Smoothed
from crane_identification.preparation.run import STANDSTILL_SIGMAS

STEP = 10_000_000  # ns
HALF = 20  # instants on either side of a row
NOISE, GAIN = 1e-3, 2.0
RESOLUTION = STANDSTILL_SIGMAS * NOISE * GAIN


def decided(velocity: np.ndarray, run: np.ndarray | None = None) -> dict[int, bool]:
    """Whether the row at each instant is used, from velocities (n,) of one joint."""
    gate = Gate(np.array([NOISE]))
    out = {}
    nothing = np.zeros(1)
    for k, v in enumerate(velocity):
        number = 0 if run is None else int(run[k])
        gate.add(Smoothed(k * STEP, number, nothing, np.array([v]), nothing, nothing, GAIN))
        out[k - HALF] = bool(gate.open((k - 2 * HALF) * STEP)[0])
    return out


def test_rows_are_used_where_nothing_happens_within_their_window() -> None:
    velocity = np.ones(200)
    velocity[100:] = -1.0
    used = decided(velocity)
    assert [k for k, use in used.items() if use] == [*range(20, 80), *range(120, 180)]


def test_standstill_and_speeds_below_the_resolution_are_closed() -> None:
    assert not any(decided(np.zeros(100)).values())
    assert not any(decided(np.full(100, 0.99 * RESOLUTION)).values())
    assert any(decided(np.full(100, 1.01 * RESOLUTION)).values())


def test_a_joint_that_sticks_and_goes_on_the_same_way_closes_too() -> None:
    velocity = np.ones(200)
    velocity[100] = 0.0
    used = decided(velocity)
    assert not any(used[k] for k in range(81, 121))
    assert used[79] and used[121]


def test_a_new_run_knows_nothing_of_the_old_one() -> None:
    run = np.repeat([0, 1], 100)
    used = decided(np.ones(200), run)
    assert [k for k, use in used.items() if use] == [*range(20, 80), *range(120, 180)]
