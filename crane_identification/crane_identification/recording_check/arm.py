"""Checks of signs, zeros and units by the forces of any machine, with or without its model."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from scipy.ndimage import binary_erosion
from scipy.optimize import lsq_linear
from scipy.sparse.csgraph import connected_components

from crane_identification.data.log import Log
from crane_identification.data.resample import resample
from crane_identification.notation import spoken
from crane_identification.recording_check import limits
from crane_identification.recording_check.forces import NEGLIGIBLE, TINY, LongestRun
from crane_identification.recording_check.suspicion import Suspicion
from crane_model.cylinders import generalized_forces
from crane_model.errors import DataError
from crane_model.machine import Machine
from crane_model.model_file import Model
from crane_model.record import Record

TURNS = {"+90°": np.pi / 2, "-90°": -np.pi / 2, "180°": np.pi}  # that a zero may be off
FACTOR_ROUNDS = 3  # after which each joint has the weight of its own force
UNDONE = ("direction", "turn", "sign")


@dataclass(frozen=True)
class ArmMotion:
    """Motion and generalized force (n, j) behind a low-pass; `moving` (n, j): slides one way."""

    record: Record
    force: np.ndarray
    moving: np.ndarray

    @classmethod
    def of(cls, log: Log, machine: Machine | None) -> "ArmMotion":
        """The longest run without a gap; `DataError` if it is too short or nothing moves."""
        samples = resample(log)
        run = LongestRun(samples, limits.ARM_BANDWIDTH)
        step, position = run.step, run.smooth(samples.position)
        velocity = np.gradient(position, step, axis=0)
        force = samples.force
        if force is None:
            if machine is None or samples.pressure_a is None:
                raise DataError("no forces, and no machine that makes them of pressures")
            assert samples.pressure_b is not None  # a recording has both chambers
            force = generalized_forces(
                machine, samples.position, samples.pressure_a, samples.pressure_b, log.joints
            )
        fast = np.abs(velocity) > limits.SLOW * np.abs(velocity).max(axis=0)
        around = max(1, round(limits.FORCE_SETTLING_S / step))
        moving = np.stack([binary_erosion(column, iterations=around) for column in fast.T], axis=1)
        if (moving.sum() * step) < limits.LEAST_MOTION:
            raise DataError(
                f"{limits.LEAST_MOTION:g} s of motion needed, got {moving.sum() * step:.1f} s"
            )
        record = Record(
            joints=log.joints,
            time=run.time,
            position=position,
            velocity=velocity,
            acceleration=np.gradient(velocity, step, axis=0),
        )
        return cls(record, run.smooth(force), moving)


def signs(moved: ArmMotion) -> Iterator[Suspicion]:
    """Joints whose force would feed friction and inertia alike; needs no model.

    The force is regressed on weight and inertia of all joints, and on own friction.
    """
    q, v, a = moved.record.position, moved.record.velocity, moved.record.acceleration
    shared = [np.ones((len(q), 1)), np.sin(q), np.cos(q), q, a]
    for j, joint in enumerate(moved.record.joints):
        rows = moved.moving[:, j]
        columns = np.column_stack([*shared, np.sign(v[:, j]), v[:, j]])[rows]
        if rows.sum() < 2 * columns.shape[1]:
            continue
        scale = np.linalg.norm(columns, axis=0)
        scale[scale == 0.0] = 1.0
        inverse = np.linalg.pinv(columns / scale, rcond=1e-6)
        found = inverse @ moved.force[rows, j]
        left = moved.force[rows, j] - columns / scale @ found
        covariance = limits.CORRELATED * np.mean(left**2) * (inverse @ inverse.T)
        at_inertia = 1 + 3 * q.shape[1] + j
        inertia = found[at_inertia] / max(float(np.sqrt(covariance[at_inertia, at_inertia])), TINY)
        power = columns[:, -2:] / scale[-2:] @ found[-2:] * v[rows, j]
        along = (columns[:, -2:] / scale[-2:] * v[rows, j, np.newaxis]).sum(axis=0)
        doubt = float(np.sqrt(max(along @ covariance[-2:, -2:] @ along, 0.0)))
        friction = float(power.sum()) / max(doubt, TINY)
        if inertia < -limits.NEGATIVE_SIGMAS and friction < -limits.NEGATIVE_SIGMAS:
            yield Suspicion(
                spoken(joint),
                f"friction would feed it with {-power.mean():.3g} W on average, and its inertia "
                f"would be negative, by {-friction:.0f} and {-inertia:.0f} standard deviations",
                "the sign of its force, or of its position, is reversed",
                decisive=True,
            )


class _Fit:
    """Rows of (28) where joints move, each joint's scaled by the rms of its force."""

    def __init__(self, model: Model, moved: ArmMotion):
        self.model, self.moved = model, moved
        every = max(1, int(moved.moving.sum()) // (limits.ROWS * 2))
        used = np.zeros_like(moved.moving)
        used[::every] = moved.moving[::every]
        self.used, self.joint = used, np.nonzero(used)[1]
        rms = np.sqrt((moved.force**2 * used).sum(axis=0) / np.maximum(used.sum(axis=0), 1))
        self.scale = np.where(rms > 0.0, rms, 1.0)
        self.force = (moved.force / self.scale)[used]
        self.low = np.array(
            [
                -np.inf if parameter.minimum is None else parameter.minimum
                for parameter in model.parameters
            ]
        )

    def basis(self, record: Record) -> "_Basis":
        columns = (self.model.regressor(record) / self.scale[:, np.newaxis])[self.used]
        norms = np.linalg.norm(columns, axis=0)
        norms[norms == 0.0] = 1.0
        q, triangle = np.linalg.qr(columns / norms)
        u, size, directions = np.linalg.svd(triangle)
        known = size > NEGLIGIBLE * size[0]  # no motion separates parameters along the others
        r = size[known, np.newaxis] * directions[known]
        return _Basis(q @ u[:, known], r, self.low * norms)

    def factors(self, basis: "_Basis") -> tuple[np.ndarray, float]:
        """(j,) of the forces of the joints, that make them agree; and what is left.

        Nothing compares joints that share no parameter: of those that do, the middle factor is 1.
        The residual of each joint is relative to its own force: a factor near 0 explains nothing.
        """
        rows = self.joint == np.arange(len(self.scale))[:, np.newaxis]
        power = np.sqrt((rows * self.force**2).sum(axis=1))
        power[power == 0.0] = 1.0
        factor = np.ones(len(power))
        for _ in range(FACTOR_ROUNDS):  # the largest share of the forces that the model explains
            q = np.linalg.qr(basis.q / factor[self.joint, np.newaxis])[0]
            along = (rows * self.force) @ q / power[:, np.newaxis]
            shares = along @ along.T
            count, group = connected_components(np.abs(shares) > NEGLIGIBLE)
            for joints in (np.flatnonzero(group == k) for k in range(count)):
                vector = np.linalg.eigh(shares[np.ix_(joints, joints)])[1][:, -1]
                factor[joints] *= vector / power[joints]
                factor[joints] /= sorted(factor[joints])[len(joints) // 2]
        force = factor[self.joint] * self.force  # or the opposite
        residuals = (force - sign * basis.predicted(sign * force) for sign in (1.0, -1.0))
        left = min(float(np.linalg.norm(residual / factor[self.joint])) for residual in residuals)
        return factor, left / float(np.linalg.norm(self.force))


class _Basis(NamedTuple):
    """Columns of (28), of norm 1, as factors (N, r) and (r, p), and the least values (p,)."""

    q: np.ndarray
    r: np.ndarray
    low: np.ndarray

    def predicted(self, force: np.ndarray) -> np.ndarray:
        """(N,) by the parameters that fit best, within their signs."""
        found = lsq_linear(self.r, self.q.T @ force, bounds=(self.low, np.inf)).x
        return np.asarray(self.q @ (self.r @ found))

    def left(self, force: np.ndarray) -> float:
        """Share (rms) of the force that is left."""
        return float(np.linalg.norm(force - self.predicted(force)) / np.linalg.norm(force))


class _Mistake(NamedTuple):
    """What may be wrong with a joint: its force is `sign` times the one that the model expects, its
    position `direction` times that of the machine file, from a zero that is off by `turn` [rad].
    """

    what: str
    sign: float = 1.0
    direction: float = 1.0
    turn: float = 0.0


RIGHT = _Mistake("")
MISTAKES = (
    _Mistake("the sign of its force is reversed", sign=-1.0),
    *(
        _Mistake(f"its zero is off by {name} from that of the machine file", turn=angle)
        for name, angle in TURNS.items()
    ),
    _Mistake("its position has the opposite direction to the machine file", direction=-1.0),
    _Mistake("it has the opposite direction to the machine file", sign=-1.0, direction=-1.0),
)


def _left(fit: _Fit, mistakes: Sequence[_Mistake]) -> float:
    """Share (rms) of the force that is left if each joint's mistake is undone."""
    record = fit.moved.record
    direction, turn, sign = (
        np.array([getattr(mistake, name) for mistake in mistakes]) for name in UNDONE
    )
    undone = replace(
        record,
        position=direction * record.position + turn,
        velocity=direction * record.velocity,
        acceleration=direction * record.acceleration,
    )
    return fit.basis(undone).left(sign[fit.joint] * fit.force)


def _mistakes(fit: _Fit, left: float, factors: np.ndarray) -> tuple[list[_Mistake], float]:
    """The mistakes of all joints that explain the forces best, and what is left.

    Each further mistake must explain much more of the forces. Some signs explain something only
    together: they are tried in one step, as the signs of the `factors` (j,) and as their opposite.
    """
    joints = fit.model.joints
    found = [RIGHT] * len(joints)
    best, best_left, least = found, left, left
    together = [[MISTAKES[0] if turned else RIGHT for turned in s * factors < 0] for s in (1, -1)]
    for step in range(1, len(joints) + 1):
        tried = [
            [*found[:j], mistake, *found[j + 1 :]]
            for mistake in MISTAKES
            for j, joint in enumerate(joints)
            if found[j] is RIGHT and (not mistake.turn or fit.model.setting.units[joint] == "rad")
        ]
        tried += together
        lefts = [_left(fit, mistakes) for mistakes in tried]
        first = next(k for k, share in enumerate(lefts) if share <= limits.SAME_LEFT * min(lefts))
        found = tried[first]
        if limits.BETTER**step * lefts[first] < least:
            best, best_left, least = found, lefts[first], limits.BETTER**step * lefts[first]
        if least < limits.BETTER ** (step + 1) * limits.IMPERFECT:
            break  # one more could not explain enough
    return best, best_left


def arm(model: Model, moved: ArmMotion) -> Iterator[Suspicion]:
    """Find forces that the user's model cannot explain, and mistakes that would explain them."""
    fit = _Fit(model, moved)
    if not fit.force.any():
        return
    basis = fit.basis(moved.record)
    left = basis.left(fit.force)
    if left < limits.IMPERFECT:
        return
    factors, by_factors = fit.factors(basis)
    found, without = _mistakes(fit, left, factors) if left > limits.POOR else ([], left)
    evidence = f"the model leaves {left:.0%} of the forces, without that {{:.0%}}"
    if without < min(left, limits.SIMPLER * by_factors):
        for joint, mistake in zip(model.joints, found, strict=True):
            if mistake is not RIGHT:
                told = evidence.format(without)
                yield Suspicion(spoken(joint), told, mistake.what, decisive=True)
    elif (
        limits.BETTER * by_factors < left
        and np.abs(factors).max() > limits.LEAST_RATIO * np.abs(factors).min()
    ):
        named = ", ".join(
            f"{spoken(joint)} {factor:.3g}"
            for joint, factor in zip(model.joints, factors, strict=True)
        )
        yield Suspicion(
            "forces",
            evidence.format(by_factors),
            f"joints have different units, as efforts in amperes have; factors that agree: {named}",
            decisive=left > limits.POOR,
        )
    elif left > limits.UNEXPLAINED:
        yield Suspicion(
            "forces",
            f"the model leaves {left:.0%} of them",
            "the model lacks something, or several signs, zeros or units are wrong",
        )
