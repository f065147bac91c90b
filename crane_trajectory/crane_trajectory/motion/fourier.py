"""Fourier references (32)-(34): periodic trajectories of any joints, with analytic derivatives."""

import math
from collections.abc import Callable
from functools import cached_property, partial
from typing import Annotated, NamedTuple, Self

import numpy as np
from numba import njit
from pydantic import Field, model_validator

from crane_model.configuration import Schema
from crane_trajectory.motion.probe import Probe

MOST_HARMONICS = 50
SHORTEST_PERIOD, LONGEST_PERIOD = 1.0, 3600.0  # s: what a crane can follow, and one waits for
Period = Annotated[float, Field(ge=SHORTEST_PERIOD, le=LONGEST_PERIOD)]
Coefficients = Annotated[tuple[float, ...], Field(min_length=1, max_length=MOST_HARMONICS)]


class JointSeries(Schema):
    """Coefficients of (32) for one joint [rad or m]: q_{i,0}, a_{i,k} and b_{i,k}, k = 1..N."""

    offset: float
    sine: Coefficients
    cosine: Coefficients

    @model_validator(mode="after")
    def _paired(self) -> Self:
        if len(self.sine) != len(self.cosine):
            raise ValueError(
                f"sine has {len(self.sine)} coefficients and cosine {len(self.cosine)}; "
                "give both for every harmonic"
            )
        return self


class MotionSamples(NamedTuple):
    """Position, velocity and acceleration at n times of j joints, each (n, j) [SI]."""

    position: np.ndarray
    velocity: np.ndarray
    acceleration: np.ndarray


Instants = Callable[[float], np.ndarray]
"""Position, velocity and acceleration of j joints (3, j) at one time [s]."""


def harmonic_basis(time: np.ndarray, period: float, harmonics: int) -> MotionSamples:
    """The functions that multiply [q_{i,0}, a_{i,1..N}, b_{i,1..N}] in (32)-(34).

    time (n,) [s]; returns three arrays (n, 2 N + 1): (32), (33), (34) are products with them.
    """
    frequency = 2 * np.pi / period * np.arange(1, harmonics + 1)
    angle = np.outer(time, frequency)
    sine, cosine = np.sin(angle), np.cos(angle)
    one, zero = np.ones((len(angle), 1)), np.zeros((len(angle), 1))
    return MotionSamples(
        np.hstack([one, sine, -cosine]),
        np.hstack([zero, frequency * cosine, frequency * sine]),
        np.hstack([zero, -(frequency**2) * sine, frequency**2 * cosine]),
    )


class FourierTrajectory(Schema):
    """A periodic trajectory (32) of one or more joints; joints that it does not name are held."""

    name: str
    period: Period
    joints: Annotated[dict[str, JointSeries], Field(min_length=1)]
    probe: Probe | None = None
    figures_of_merit: dict[str, float] = {}
    provenance: str = ""

    @cached_property
    def joint_names(self) -> tuple[str, ...]:
        """The joints that move, in the order of the columns of `evaluate`."""
        return tuple(self.joints)

    @cached_property
    def harmonics(self) -> int:
        """N, the highest harmonic of any joint."""
        return max(len(series.sine) for series in self.joints.values())

    @property
    def coefficients(self) -> np.ndarray:
        """(2 N + 1, j): per joint [q_0, a_1..a_N, b_1..b_N], shorter series padded with zeros."""
        return np.array(self._columns).T

    @cached_property  # as tuples, so that trajectories can be compared
    def _columns(self) -> tuple[tuple[float, ...], ...]:
        def padded(values: tuple[float, ...]) -> tuple[float, ...]:
            return values + (0.0,) * (self.harmonics - len(values))

        rows = (self.joints[joint] for joint in self.joint_names)
        return tuple((one.offset, *padded(one.sine), *padded(one.cosine)) for one in rows)

    @classmethod
    def from_coefficients(
        cls, name: str, period: float, joints: tuple[str, ...], coefficients: np.ndarray
    ) -> Self:
        """The trajectory whose `coefficients` (2 N + 1, j) belong to `joints`."""
        harmonics = len(coefficients) // 2
        return cls(
            name=name,
            period=period,
            joints={
                joint: JointSeries(
                    offset=column[0],
                    sine=tuple(column[1 : harmonics + 1]),
                    cosine=tuple(column[harmonics + 1 :]),
                )
                for joint, column in zip(joints, coefficients.T.tolist(), strict=True)
            },
        )

    def evaluate(self, time: np.ndarray) -> MotionSamples:
        """(32), (33), (34) at time (n,) [s]; columns as in `joint_names`."""
        basis = harmonic_basis(np.atleast_1d(time), self.period, self.harmonics)
        return MotionSamples(*(functions @ self.coefficients for functions in basis))

    def instants(self) -> Instants:
        """Return what gives the rows of `evaluate` (3, j) at one time [s], compiled."""
        return partial(_series, self.coefficients.copy(), 2 * np.pi / self.period)


@njit(cache=True)
def _series(coefficients: np.ndarray, frequency: float, time: float) -> np.ndarray:
    """(32)-(34) of j joints at one time [s]: (3, j); `frequency` of the period in rad/s."""
    harmonics = len(coefficients) // 2
    motion = np.zeros((3, coefficients.shape[1]))
    motion[0] = coefficients[0]
    for k in range(1, harmonics + 1):
        omega = k * frequency
        sine, cosine = math.sin(omega * time), math.cos(omega * time)
        for i in range(coefficients.shape[1]):
            a, b = coefficients[k, i], coefficients[harmonics + k, i]
            motion[0, i] += a * sine - b * cosine
            motion[1, i] += omega * (a * cosine + b * sine)
            motion[2, i] -= omega * omega * (a * sine - b * cosine)
    return motion
