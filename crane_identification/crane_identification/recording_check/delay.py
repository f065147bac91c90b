"""Delay and drift between forces and positions, where the force fits the motion best."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.optimize import minimize

from crane_identification.recording_check.constants import (
    AGREEING,
    ALONE,
    DELAY_STEP,
    DRIFT,
    LARGEST_DRIFT,
    LEAST_DRIFT,
    LEAST_UNEXPLAINED,
    LONGEST_DELAY,
    POWER_LEFT,
    ROWS,
    SHORTEST_DELAY,
)
from crane_identification.recording_check.forces import equations
from crane_identification.recording_check.grid import Grid
from crane_model.model_file import Model

TINY = float(np.finfo(float).tiny)
SHORTEST_RECORDING = 6.0 * LONGEST_DELAY  # s, of which the ends are not used
STEPS = np.arange(-LONGEST_DELAY, LONGEST_DELAY + DELAY_STEP / 2, DELAY_STEP)  # s
DRIFTS = np.linspace(-LARGEST_DRIFT, LARGEST_DRIFT, 17)  # s/s, a quarter of a per cent apart


@dataclass(frozen=True)
class Delay:
    """The force is `delay` [s] behind the positions in the middle, and gains `drift` [s/s].

    `left` and `left_without` are the shares of the force unexplained as recorded, and without the
    delay. `joints` are those on which it shows; it is `common` where they are several that agree.
    """

    delay: float
    drift: float
    left: float
    left_without: float
    joints: tuple[str, ...]
    common: bool


class _Scan:
    """What is unexplained of the force at any delay: the motion stays, the force is shifted."""

    def __init__(self, model: Model, whole: Grid) -> None:
        margin = round(LONGEST_DELAY / whole.step) + 1
        every = max(1, int(whole.moving.sum()) // ROWS)
        found = equations(model, whole, slice(margin, len(whole.record) - margin, every))
        self.whole, self.rows, self.joint = whole, found.sample, found.joint
        self.basis = np.linalg.qr(found.columns)[0]
        self.scale = 1.0 / found.scale[found.joint]
        self.time = whole.record.time - whole.record.time[0]
        self.middle = 0.5 * self.time[-1]

    def left(self, delay: float, drift: float) -> np.ndarray:
        """(j,) power unexplained of each joint, over that of its force."""
        at = self.time + delay + drift * (self.time - self.middle)
        shifted = np.stack([np.interp(at, self.time, one) for one in self.whole.pistons.T], axis=1)
        force = self.whole.generalized(shifted)[self.rows, self.joint] * self.scale
        error = force - self.basis @ (self.basis.T @ force)
        count = len(self.whole.joints)
        left, power = (
            np.bincount(self.joint, values**2, minlength=count) for values in (error, force)
        )
        return left / np.maximum(power, TINY)


def find_delay(model: Model, whole: Grid) -> Delay | None:
    """The delay that explains most of what is unexplained, or None where none matters."""
    if whole.record.time[-1] - whole.record.time[0] < SHORTEST_RECORDING:
        return None
    scan, joints = _Scan(model, whole), range(len(whole.joints))
    as_is = scan.left(0.0, 0.0)
    if np.sqrt(as_is.max()) < LEAST_UNEXPLAINED:
        return None
    at_steps = np.array([scan.left(step, 0.0) for step in STEPS])  # (steps, j)
    delay, drift = _best(scan, at_steps.sum(axis=1))
    own = [_of_joint(scan, j, STEPS[at_steps[:, j].argmin()], drift) for j in joints]
    shows = [
        j
        for j in joints
        if (drift or abs(own[j].delay) > SHORTEST_DELAY)
        and np.sqrt(as_is[j]) > LEAST_UNEXPLAINED
        and own[j].left < POWER_LEFT * as_is[j]
    ]
    if not shows:
        return None
    delays = np.array([own[j].delay for j in shows])
    typical = float(np.median(delays))
    alike = np.abs(delays - typical) < max(SHORTEST_DELAY, AGREEING * abs(typical))
    common = len(shows) > 1 and bool(alike.all())
    if not common:
        worst = max(shows, key=lambda j: as_is[j] - own[j].left)
        if own[worst].left > ALONE * as_is[worst]:
            return None
        shows, delay = [worst], own[worst].delay
    without = scan.left(delay, drift)
    left, left_without = (float(np.sqrt(power[shows].mean())) for power in (as_is, without))
    return Delay(delay, drift, left, left_without, tuple(whole.joints[j] for j in shows), common)


class _OfJoint(NamedTuple):
    """The best delay [s] of one joint, and the power that it leaves."""

    delay: float
    left: float


def _of_joint(scan: _Scan, j: int, around: float, drift: float) -> _OfJoint:
    delays = around + np.linspace(-DELAY_STEP, DELAY_STEP, 21)
    left = np.array([scan.left(delay, drift)[j] for delay in delays])
    return _OfJoint(float(delays[left.argmin()]), float(left.min()))


def _best(scan: _Scan, at_steps: np.ndarray) -> tuple[float, float]:
    """Delay and drift that leave least, given what each of `STEPS` leaves (steps,).

    A drift must leave much less than any delay, and must be one that clocks have.
    """
    delay, drift = float(STEPS[at_steps.argmin()]), 0.0
    drifting = [(d, s) for s in DRIFTS for d in delay + DELAY_STEP * np.arange(-8, 9, 2)]
    tried = [scan.left(*one).sum() for one in drifting]
    if min(tried) < POWER_LEFT * at_steps.min():
        delay, drift = _refined(scan, *drifting[int(np.argmin(tried))])
    if abs(drift) < max(DRIFT, LEAST_DRIFT / scan.time[-1]):
        drift = 0.0
    return (delay, drift) if drift else _refined(scan, delay, 0.0)


def _refined(scan: _Scan, delay: float, drift: float) -> tuple[float, float]:
    """The best delay and drift around these; without drift there is none."""
    scale = np.array([DELAY_STEP, DRIFT])
    free = np.array([1.0, float(drift != 0.0)])
    start = np.array([delay, drift])

    def left(x: np.ndarray) -> float:
        return float(scan.left(*(start + free * scale * x)).sum())

    found = minimize(left, np.zeros(2), method="Nelder-Mead", options={"maxfev": 60}).x
    best = start + free * scale * found
    return float(best[0]), float(best[1])
