"""A crane that stands tells no more the longer it stands, and hides what comes to its tip."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import pytest
from unit.crane_observer.observed import JOINTS, MACHINE, known

from crane_benchmark.observing.machines import PAYLOAD
from crane_observer import PositionEstimator
from crane_observer.position.estimator import EstimatorCondition, WindowEstimate
from crane_sim import Plant, load_simulated_crane

STEP = 0.005  # s
READING = 1.2e4  # Pa, noise of a transducer
ENCODER = 2e-5  # rad or m
START = np.array([0.0, 0.5, -1.3, 0.6])
COLUMNS = [MACHINE.index(joint) for joint in JOINTS]
LOST_AT = 0.3  # s


class Seen(NamedTuple):
    """What was told of the joints at n times, and what was true."""

    told: list[WindowEstimate]
    away: np.ndarray  # (n, 3) rad, m
    deviation: np.ndarray  # (n, 3)
    load: np.ndarray  # (n,) kg, of the load that hangs there


class Bench:
    """A machine, its position estimator, and one joint whose encoder is lost at the start."""

    def __init__(self, lost: int, seed: int, stays_frozen: bool = False):
        self.plant = Plant(load_simulated_crane(), MACHINE, START, [PAYLOAD])
        self.sensor = PositionEstimator(known(), START[COLUMNS])
        self.time, self.load, self.count = 0.0, 0.0, 0
        self.keeps: Callable[[], bool] = lambda: True
        self.push = np.zeros(3)  # Pa, on chambers A
        self._lost, self._frozen, self._rng = lost, stays_frozen, np.random.default_rng(seed)
        self._shown = np.nan
        self._seen: list[tuple[WindowEstimate, np.ndarray, float]] = []
        self.work(0.5, np.zeros(3))

    def work(self, seconds: float, command: np.ndarray, step: float = STEP) -> None:
        """The machine moves by its commands [of the stroke]."""
        whole = np.zeros(len(START))
        whole[COLUMNS] = command
        for _ in range(round(seconds / step)):
            self.plant.set_magnitude(0, self.load)
            self.sensor.add_command(self.time, command)
            self.plant.advance(whole, step)
            self._tell(step)

    def wait(self, seconds: float) -> None:
        """The machine stands; one reading a window is enough."""
        self.work(seconds, np.zeros(3), 10 * STEP)

    def seen(self) -> Seen:
        told, away, load = zip(*self._seen, strict=True)
        deviation = np.array([window.estimate.deviation[:-1] for window in told])
        return Seen(list(told), np.array(away), deviation, np.array(load))

    def _tell(self, passed: float) -> None:
        self.time += passed
        true = self.plant.q[COLUMNS]
        encoders = true + self._rng.normal(0.0, ENCODER, 3)
        if self.time > LOST_AT:
            if np.isnan(self._shown) and self._frozen:
                self._shown = encoders[self._lost]
            encoders[self._lost] = self._shown
        self.sensor.add_encoders(self.time, encoders)
        if not self.keeps():
            return
        noise = self._rng.normal(0.0, READING, (2, 3))
        told = self.sensor.add_pressures(
            self.time,
            self.plant.pressure_a[COLUMNS] + noise[0] + self.push,
            self.plant.pressure_b[COLUMNS] + noise[1],
            float(self.plant.supply_pressure),
        )
        if told is not None:
            self._seen.append((told, told.estimate.position - true, self.load))


def moved(bench: Bench, share: float = 1.0) -> None:
    bench.work(2.0, share * np.array([0.2, -0.25, 0.2]))
    bench.work(1.5, np.zeros(3))


def back(bench: Bench) -> None:
    moved(bench, -0.8)


def holds(seen: Seen, lost: int, since: float = 0.0) -> None:
    """Within its own 95 % interval in 95 % of the windows, and at the last of them."""
    rows = np.array([window.estimate.time > since for window in seen.told])
    inside = np.abs(seen.away[rows, lost]) < 1.96 * seen.deviation[rows, lost]
    assert inside.mean() > 0.95
    assert inside[-1]


@pytest.mark.parametrize(("lost", "seconds"), [(0, 60.0), (1, 60.0), (2, 60.0), (1, 600.0)])
def test_a_long_stand_adds_no_certainty(lost: int, seconds: float) -> None:
    bench = Bench(lost, seed=lost)
    moved(bench)
    begun = bench.seen().deviation[-1, lost]
    bench.wait(seconds)
    stood = bench.seen()
    assert stood.deviation[-1, lost] > 0.95 * begun
    estimate = stood.told[-1].estimate  # of a machine that carries nothing
    assert abs(estimate.load) < 1.96 * estimate.deviation[-1]
    assert stood.told[-1].condition is EstimatorCondition.ENCODER_LOST
    back(bench)
    holds(bench.seen(), lost)


@pytest.mark.parametrize("lost", range(3))
def test_a_stand_after_a_look_back_is_like_any(lost: int) -> None:
    """Its encoder froze before the motion and was found out in it."""
    bench = Bench(lost, seed=10 + lost, stays_frozen=True)
    bench.work(1.0, np.array([0.2, -0.25, 0.2]))
    bench.sensor.distrust(lost, LOST_AT)
    begun = bench.time
    bench.work(2.0, np.zeros(3))
    bench.wait(60.0)
    back(bench)
    holds(bench.seen(), lost, begun)


@pytest.mark.parametrize("lost", range(3))
def test_a_stand_with_windows_lost_is_like_any(lost: int) -> None:
    bench = Bench(lost, seed=20 + lost)
    moved(bench)
    bench.keeps = lambda: int(bench.time) % 7 != 0 or bench.time % 1.0 > 0.3
    bench.wait(60.0)
    bench.keeps = lambda: True
    back(bench)
    holds(bench.seen(), lost)


@pytest.mark.parametrize("weight", [15.0, 90.0])
@pytest.mark.parametrize("lost", range(3))
def test_a_load_that_friction_hides_does_not_move_the_pose(lost: int, weight: float) -> None:
    bench = Bench(lost, seed=30 + lost)
    moved(bench)
    bench.load = weight
    bench.work(3.0, np.zeros(3))
    estimate = bench.seen().told[-1].estimate
    assert abs(estimate.load - weight) < 2.5 * estimate.deviation[-1]
    bench.wait(30.0)
    back(bench)
    holds(bench.seen(), lost)


def test_one_window_at_rest_is_no_load() -> None:
    bench = Bench(1, seed=40)
    moved(bench)
    bench.wait(2.0)
    before = bench.seen().told[-1].estimate
    bench.push = np.full(3, 30e5)
    bench.wait(0.1)
    bench.push = np.zeros(3)
    bench.wait(2.0)
    after = bench.seen()
    assert not any(window.estimate.surprised for window in after.told)
    assert abs(after.told[-1].estimate.load - before.load) < 1.0
    holds(after, 1)


def test_a_load_that_no_machine_carries_is_named() -> None:
    bench = Bench(1, seed=50)
    bench.load = 400.0
    moved(bench)
    bench.work(2.0, np.array([-0.2, 0.25, -0.2]))
    told = bench.seen().told
    assert told[-1].condition is EstimatorCondition.LOAD_IMPOSSIBLE
