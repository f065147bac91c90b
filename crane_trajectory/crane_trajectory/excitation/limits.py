"""The limits of (35) on a grid of times, with exact derivatives, and the settings of a search.

Every criterion of (35) is a function of Phi^T Phi. Its derivative with respect to the motion is
sum_jk weight_njk dPhi_njk / d(q, q', q'') at each sample n: the regressor pulled back by a weight.
The terms of rigid bodies and all `motion_columns` have closed forms; for any other term of one
instant, differences of fourth order, which are exact to rounding where the term is smooth.

Positions, velocities and accelerations are linear in the coefficients; pump flow and clearance of
the boom tip are not. Cylinder strokes cover the positions of Table 2, or the machine is refused
when it is loaded.
"""

from collections.abc import Sequence
from dataclasses import replace
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import numpy as np
from pydantic import Field

from crane_model import motion_columns
from crane_model.configuration import Positive, Schema, load
from crane_model.errors import ConfigurationError, RangeError
from crane_model.machine import Machine
from crane_model.model_file import Model
from crane_model.record import Record
from crane_model.terms import Setting, Term
from crane_trajectory.excitation.criterion import PredictedRecording, record_of
from crane_trajectory.motion.check import Clearance, TipClearance, pump_flow
from crane_trajectory.motion.periodic import MotionSamples

STENCIL_STEP = 1e-3  # rad, m and their derivatives: rounding and truncation are alike
STENCIL = ((-2, 1 / 12), (-1, -2 / 3), (1, 2 / 3), (2, -1 / 12))
HOME_POSES, MOST_HOME_POSES = 7, 2401  # per joint and in all, among which the home pose is chosen
NEGLIGIBLE = 1e-3  # share of the flow, m: a search ends this close to a limit, within its margin

Share = Annotated[float, Field(ge=0, lt=1)]
Count = Annotated[int, Field(ge=1)]


class Margins(Schema):
    """Margins to the limits, for a machine that follows the design inexactly."""

    position: Annotated[float, Field(ge=0, lt=0.5)]  # of the range of Table 2, at both ends
    velocity: Share
    flow: Share
    clearance: Annotated[float, Field(ge=0)]  # m

    def positions(self, machine: Machine, joints: Sequence[str]) -> tuple[np.ndarray, np.ndarray]:
        """Lowest and highest positions (j,) that they leave of Table 2."""
        lowest, highest, *_ = machine.ranges(joints)
        free = self.position * (highest - lowest)
        return lowest + free, highest - free


class SearchStage(Schema):
    """How finely one stage of the search sees limits and criterion, and where it ends."""

    grid_per_harmonic: Annotated[int, Field(ge=4)]
    reversal_share: Positive
    power: Positive
    iterations: Count
    tolerance: Positive


class SearchSettings(Schema):
    """How the search samples, how it starts, and its two stages."""

    samples: Count
    start_amplitude: Annotated[float, Field(gt=0, le=1)]
    survivors: Count
    explore: SearchStage
    polish: SearchStage


class DesignSettings(Schema):
    """How excitation trajectories are searched and judged: everything of `design.yaml`.

    Parameters
    ----------
    search
        How the search samples, starts and ends.
    margins
        What a design keeps free of the limits.
    experiment
        The recording for which standard deviations are predicted.
    plausible
        Plausible values of parameters by name, that standard deviations relate to [SI].
    """

    search: SearchSettings
    margins: Margins
    experiment: PredictedRecording
    plausible: dict[str, float]


def load_design_settings(path: Path | str) -> DesignSettings:
    """Load the settings of a search from a YAML file.

    Parameters
    ----------
    path
        The file.

    Returns
    -------
    DesignSettings
        The settings.

    Raises
    ------
    ConfigurationError
        The file cannot be read, or a value in it is wrong.
    """
    return load(path, DesignSettings)


def smooth_record(model: Model, motion: MotionSamples, width: np.ndarray) -> Record:
    """Samples (n, j) as the model takes them, with tanh(q' / width) for sgn(q'); width (j,)."""
    return record_of(model, motion, np.tanh(motion.velocity / width))


def smooth_regressor(model: Model, record: Record) -> np.ndarray:
    """Phi (n, j, p) on a `smooth_record`, with q' tanh(q' / width) for |q'| as well."""
    regressor = np.zeros((*record.position.shape, len(model.parameters)))
    model.fill(record, regressor, smooth=True)
    return regressor


def pull_back(model: Model, record: Record, weight: np.ndarray, width: np.ndarray) -> MotionSamples:
    """sum_jk weight_njk dPhi_njk / d(q, q', q'') of `smooth_regressor`: three arrays (n, j).

    weight (n, j, p); `record` is one of `smooth_record` with the same `width`. Raises
    `ConfigurationError` for a term whose force depends on more than the motion at the instant.
    """
    total = np.zeros((3, *record.position.shape))
    for term, columns in model.whole_terms:
        if not term.of_one_instant:
            raise ConfigurationError(
                f"model '{model.name}': term '{term.type}' depends on more than the motion at one "
                "instant; leave it out of the model for which a trajectory is designed"
            )
        given = weight[:, :, columns]
        slopes = term.pull_back(record, model.setting, given)
        if slopes is None:
            slopes = _by_differences(term, model.setting, record, width, given)
        total += slopes
    steepness = (1.0 - record.direction**2) / width
    motion_columns.pull_back(model.motion_columns, record, steepness, weight, total)
    return MotionSamples(*total)


def _by_differences(
    term: Term, setting: Setting, record: Record, width: np.ndarray, weight: np.ndarray
) -> np.ndarray:
    """(3, n, j): derivatives of a term's weighted (n, j, p) columns by q, q' and q''."""
    slopes = np.zeros((3, *record.position.shape))
    only_joint = term.only_joint
    for j in range(len(width)) if only_joint is None else [record.column(only_joint)]:

        def weighted(quantity: str, shift: float, j: int = j) -> np.ndarray:
            shifted = getattr(record, quantity).copy()
            shifted[:, j] += shift
            moved = {quantity: shifted}
            if quantity == "velocity":
                moved["direction_known"] = np.tanh(shifted / width)
            columns = term.columns(replace(record, **moved), setting)
            total: np.ndarray = np.einsum("njp,njp->n", weight, columns)
            return total

        for slope, quantity in zip(slopes, ("position", "velocity", "acceleration"), strict=True):
            shares = [factor * weighted(quantity, k * STENCIL_STEP) for k, factor in STENCIL]
            slope[:, j] = np.sum(shares, axis=0) / STENCIL_STEP
    return slopes


class Limit(StrEnum):
    """Limits that a design can do without."""

    VELOCITY = "velocity"
    FLOW = "flow"
    CLEARANCE = "clearance"


class Limits:
    """Limits of the joints (j) of one machine at the times of a basis of (32).

    A point is the vector of `FourierTrajectory.coefficients` (2 N + 1, j), row by row. Bounds of
    acceleration (j,) [rad/s2, m/s2] may be infinite.
    """

    def __init__(
        self,
        machine: Machine,
        joints: tuple[str, ...],
        basis: MotionSamples,
        margins: Margins,
        clearance: Clearance,
        acceleration: np.ndarray,
        without: frozenset[Limit] = frozenset(),
    ) -> None:
        self.machine, self.joints, self.basis = machine, joints, basis
        self.margins, self.clearance = margins, clearance
        self._flow_counts = Limit.FLOW not in without and machine.supply is not None
        self._tip_clearance, keep = TipClearance(machine), clearance.kept + margins.clearance
        counts = Limit.CLEARANCE not in without
        self._sides = [side for side in (0, 1) if counts and np.isfinite(keep[side])]
        self._keep = keep[self._sides]
        if self._sides:
            self._tip_clearance.require(joints, ", or design without clearance")
        rows = [machine.limits[joint] for joint in joints]
        self.lowest, self.highest = margins.positions(machine, joints)
        share = np.inf if Limit.VELOCITY in without else 1.0 - margins.velocity
        self.slowest = np.array([row.velocity_min for row in rows]) * share
        self.fastest = np.array([row.velocity_max for row in rows]) * share
        self.acceleration = acceleration
        self.matrix, self.bound = self._linear()
        self.home = self._home_pose()

    def reserves(self, point: np.ndarray) -> np.ndarray:
        """Reserves (r,) of pump flow [shares] and of clearance to pillar and to ground [m].

        Negative beyond a limit less its margin.
        """
        position, velocity, _ = self._motion(point)
        return self._reserves_of(position, velocity)

    def reserve_slopes(self, point: np.ndarray) -> np.ndarray:
        """(r, v): derivatives of `reserves` with respect to the point (v,)."""
        position, velocity, inside = self._motion(point)
        blocks = []
        if self._flow_counts:
            by_position, by_velocity = self._flow_slopes(position, velocity)
            blocks.append(
                self._chain(self.basis.position, by_position * inside)
                + self._chain(self.basis.velocity, by_velocity)
            )
        if self._sides:
            slopes = self._tip_clearance.slopes(self.joints, position)
            blocks += [
                self._chain(self.basis.position, slopes[:, side] * inside) for side in self._sides
            ]
        return np.concatenate([*blocks, np.empty((0, len(point)))])

    def repaired(self, point: np.ndarray) -> np.ndarray:
        """A point within the limits near the given one; the point itself if it is within.

        Waves that are too large for a joint are scaled and shifted to fit; then the whole motion is
        drawn towards the home pose as far as pump flow and clearance need it.
        """
        waves = point.reshape(-1, len(self.joints)).copy()
        offset, waves[0] = waves[0].copy(), 0.0
        swing, speed, change = (functions @ waves for functions in self.basis)
        used = [
            np.ptp(swing, axis=0) / (self.highest - self.lowest),
            speed.max(axis=0) / self.fastest,
            speed.min(axis=0) / self.slowest,
            np.abs(change).max(axis=0) / self.acceleration,
        ]
        scale = 1.0 / np.maximum(1.0, np.max(used, axis=0))
        waves *= scale
        waves[0] = np.clip(
            offset,
            self.lowest - scale * swing.min(axis=0),
            self.highest - scale * swing.max(axis=0),
        )
        repaired = waves.ravel()
        for share in 1.0 - np.linspace(0.0, 1.0, 21):
            drawn = self.drawn_home(repaired, share)
            if (self.reserves(drawn) >= -NEGLIGIBLE).all():
                return drawn
        return self.drawn_home(repaired, 0.0)

    def drawn_home(self, point: np.ndarray, share: float) -> np.ndarray:
        """The motion scaled by `share` about the home pose; linear limits stay kept."""
        home = np.zeros_like(point)
        home[: len(self.joints)] = self.home
        return home + share * (point - home)

    def _motion(self, point: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Position, velocity, and where the position is not clipped, each (n, j).

        A search may look beyond Table 2, where a linkage may not exist.
        """
        coefficients = point.reshape(-1, len(self.joints))
        position = self.basis.position @ coefficients
        clipped = np.clip(position, self.lowest, self.highest)
        return clipped, self.basis.velocity @ coefficients, position == clipped

    def _reserves_of(self, position: np.ndarray, velocity: np.ndarray) -> np.ndarray:
        parts = [np.empty(0)]
        if self._flow_counts:
            flow = pump_flow(self.machine, self.joints, position, velocity)
            parts.append(1.0 - flow / self._flow_allowed)
        if self._sides:
            parts.append(self._clearance_left(position).T.ravel())
        return np.concatenate(parts)

    def _clearance_left(self, position: np.ndarray) -> np.ndarray:
        """(n, s): clearance beyond what is kept, on each side that counts [m]."""
        return self._tip_clearance.at(self.joints, position)[:, self._sides] - self._keep

    def _flow_slopes(
        self, position: np.ndarray, velocity: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        by_position, by_velocity = np.zeros_like(position), np.zeros_like(position)
        for i, joint in enumerate(self.joints):
            if joint not in self.machine.cylinders:
                continue
            cylinder = self.machine.cylinders[joint]
            _, lever, slope = self.machine.cylinder(joint, position[:, i]).T
            area = np.where(lever * velocity[:, i] > 0.0, cylinder.area_a, -cylinder.area_b)
            by_position[:, i] = area * slope * velocity[:, i]
            by_velocity[:, i] = area * lever
        return -by_position / self._flow_allowed, -by_velocity / self._flow_allowed

    @property
    def _flow_allowed(self) -> float:
        return self.machine.hydraulics.pump_flow * (1.0 - self.margins.flow)

    def _chain(self, functions: np.ndarray, slopes: np.ndarray) -> np.ndarray:
        """(n, v) from slopes (n, j) with respect to what `functions` (n, 2 N + 1) give."""
        return (functions[:, :, None] * slopes[:, None, :]).reshape(len(functions), -1)

    def _linear(self) -> tuple[np.ndarray, np.ndarray]:
        """A and b of A x <= b, a row a grid point, joint and finite bound."""
        one_sided = [
            (self.basis.position, self.highest),
            (-self.basis.position, -self.lowest),
            (self.basis.velocity, self.fastest),
            (-self.basis.velocity, -self.slowest),
            (self.basis.acceleration, self.acceleration),
            (-self.basis.acceleration, self.acceleration),
        ]
        matrix = np.vstack([np.kron(side, np.eye(len(self.joints))) for side, _ in one_sided])
        bound = np.concatenate([np.tile(bound, len(side)) for side, bound in one_sided])
        return matrix[np.isfinite(bound)], bound[np.isfinite(bound)]

    def _home_pose(self) -> np.ndarray:
        """The pose (j,) of a coarse grid that is farthest from limits of position and clearance."""
        count = poses_per_joint(len(self.joints), HOME_POSES, MOST_HOME_POSES)
        steps = (np.arange(count) + 0.5) / count
        shares = np.stack(np.meshgrid(*[steps] * len(self.joints)), axis=-1)
        shares = shares.reshape(-1, len(self.joints))
        poses = self.lowest + shares * (self.highest - self.lowest)
        distance = np.minimum(shares, 1.0 - shares).min(axis=1)
        if self._sides:
            distance = np.minimum(distance, self._clearance_left(poses).min(axis=1))
        if distance.max() <= 0.0:
            raise RangeError(
                f"{self.clearance}: no pose within the joint limits keeps the boom tip clear by "
                f"this and a margin of {self.margins.clearance} m; lower clearance or margin"
            )
        return poses[distance.argmax()]


def poses_per_joint(joints: int, wanted: int, most: int) -> int:
    """As many as `wanted`, or fewer where a grid of all joints would have more than `most`."""
    return max(2, min(wanted, int(most ** (1.0 / joints) + 1e-9)))
