"""Periodic trajectories of every kind, as a motion runs them and as files hold them.

Fourier references (32)-(34) have analytic derivatives. In sweeps a joint goes from one position to
the next at constant speed, or dwells where two positions are equal. Corners are rounded by a moving
average over `corner` seconds with a parabolic weight: speed and acceleration are continuous, no
position and no speed is passed that the corners do not have, and half of `corner` away from them
the motion is exactly uniform.

A small pseudo-random command on top of a motion tells of valves what slow motion alone does not:
how fast a valve is shows where its command changes faster than the crane moves. Half of the steps
open a valve a little more, the others a little less, at random but the same in all periods, so that
these still repeat.
"""

import json
import math
import resource
import subprocess
import sys
from collections.abc import Callable
from functools import cached_property, lru_cache, partial
from pathlib import Path
from typing import Annotated, Any, Literal, Protocol, Self

import numpy as np
from numba import njit
from pydantic import Field, model_validator

from crane_model.configuration import Schema, read_document, validate
from crane_model.errors import ConfigurationError
from crane_trajectory.motion.points import MotionSamples, PointsTrajectory

LARGEST_PROBE = 0.05  # [-1..1]: no dead band is narrower, so that a valve at rest stays shut
SHORTEST_HOLD = 0.01  # s: two cycles of the controller
MOST_HARMONICS = 50
SHORTEST_PERIOD, LONGEST_PERIOD = 1.0, 3600.0  # s: what a crane can follow, and one waits for
Period = Annotated[float, Field(ge=SHORTEST_PERIOD, le=LONGEST_PERIOD)]
Coefficients = Annotated[tuple[float, ...], Field(min_length=1, max_length=MOST_HARMONICS)]
Knots = Annotated[tuple[float, ...], Field(min_length=2, max_length=500)]

READING_TIME = 10  # s, of the processor
LONGEST_WAIT = 60  # s, by the clock: a busy computer gives little time to what is not urgent
READING_MEMORY = 2**32  # bytes
LARGEST_ANSWER = 1_000_000  # characters
REFUSED = 3  # exit status: standard output says why

Instants = Callable[[float], np.ndarray]
"""Position, velocity and acceleration of j joints (3, j) at one time [s]."""


class Probe(Schema):
    """Commands of plus and minus `amplitude` [-1..1], held for `hold` [s] each."""

    amplitude: Annotated[float, Field(gt=0.0, le=LARGEST_PROBE)]
    hold: Annotated[float, Field(ge=SHORTEST_HOLD, le=0.2)] = 0.015

    def course(self, time: np.ndarray, period: float, joints: int) -> np.ndarray:
        """(n, j) at time (n,) [s] of a trajectory of that period."""
        steps = _steps(max(int(period / self.hold), 1), joints)
        at = (np.mod(time, period) / self.hold).astype(int)
        return np.asarray(self.amplitude * steps[np.minimum(at, len(steps) - 1)])


@lru_cache
def _steps(count: int, joints: int) -> np.ndarray:
    """(count, j) of 1 and -1, different for each joint."""
    steps: np.ndarray = np.random.default_rng(joints).choice((-1.0, 1.0), (count, joints))
    return steps


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


def harmonic_basis(time: np.ndarray, period: float, harmonics: int) -> MotionSamples:
    """The functions that multiply [q_{i,0}, a_{i,1..N}, b_{i,1..N}] in (32)-(34).

    time (n,) [s]; returns three arrays (n, 2 N + 1): (32), (33), (34) are products with them.
    """
    frequency = 2 * np.pi / period * np.arange(1, harmonics + 1)
    angle = np.outer(time, frequency)
    sine, cosine = np.sin(angle), np.cos(angle)
    constant, zero = np.ones((len(angle), 1)), np.zeros((len(angle), 1))
    return MotionSamples(
        np.hstack([constant, sine, -cosine]),
        np.hstack([zero, frequency * cosine, frequency * sine]),
        np.hstack([zero, -(frequency**2) * sine, frequency**2 * cosine]),
    )


class FourierTrajectory(Schema):
    """A periodic trajectory (32) of one or more joints; joints that it does not name are held.

    Parameters
    ----------
    name
        For messages.
    period
        Its period [s], 1 to 3600.
    joints
        Coefficients of (32) by joint [rad, m].
    probe
        A pseudo-random command on top of the motion.
    figures_of_merit, provenance
        How well it determines a model, and how it was found.

    Raises
    ------
    pydantic.ValidationError
        A value is out of its range; `load_trajectory` turns it into `ConfigurationError`.
    """

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
        return tuple(
            (series.offset, *padded(series.sine), *padded(series.cosine)) for series in rows
        )

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
        """Evaluate (32), (33) and (34).

        Parameters
        ----------
        time
            Times (n,) [s], any.

        Returns
        -------
        MotionSamples
            Position, velocity and acceleration, each (n, j) [SI]; columns as in `joint_names`.
        """
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


class JointCourse(Schema):
    """Positions [rad or m] of one joint at increasing times [s], from 0 to the period."""

    time: Knots
    position: Knots

    @model_validator(mode="after")
    def _periodic(self) -> Self:
        if len(self.time) != len(self.position):
            raise ValueError(
                f"time has {len(self.time)} entries and position {len(self.position)}; "
                "give a position for every time"
            )
        if self.time[0] != 0.0 or np.diff(self.time).min() <= 0.0:
            raise ValueError(f"time: must begin with 0 and increase, got {list(self.time)}")
        if self.position[0] != self.position[-1]:
            raise ValueError(
                f"position: the last must be the first, {self.position[0]:g}, for the motion is "
                f"periodic; got {self.position[-1]:g}"
            )
        return self


class SweepTrajectory(Schema):
    """A periodic trajectory of sweeps and dwells; joints that it does not name are held.

    Parameters
    ----------
    kind
        Always "sweep".
    name
        For messages.
    period
        Its period [s], 1 to 3600.
    corner
        Time over which corners are rounded [s].
    joints
        Positions at times by joint [rad, m].
    probe
        A pseudo-random command on top of the motion.
    provenance
        How it was found.

    Raises
    ------
    pydantic.ValidationError
        A value is out of its range; `load_trajectory` turns it into `ConfigurationError`.
    """

    kind: Literal["sweep"]
    name: str
    period: Period
    corner: Annotated[float, Field(ge=0.1)]  # s, over which corners are rounded
    joints: Annotated[dict[str, JointCourse], Field(min_length=1)]
    probe: Probe | None = None
    provenance: str = ""

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        for joint, course in self.joints.items():
            if course.time[-1] != self.period:
                raise ValueError(
                    f"joints.{joint}.time: must end with the period {self.period:g} s, "
                    f"got {course.time[-1]:g} s"
                )
        if self.corner > self.period:
            raise ValueError(f"corner: at most the period {self.period:g} s, got {self.corner:g} s")
        return self

    @property
    def joint_names(self) -> tuple[str, ...]:
        """The joints that move, in the order of the columns of `evaluate`."""
        return tuple(self.joints)

    @property
    def harmonics(self) -> int:
        """Harmonics of a Fourier series (32) whose half waves are as short as two corners."""
        return int(np.ceil(self.period / (4.0 * self.corner)))

    def evaluate(self, time: np.ndarray) -> MotionSamples:
        """Evaluate the motion.

        Parameters
        ----------
        time
            Times (n,) [s], any.

        Returns
        -------
        MotionSamples
            Position, velocity and acceleration, each (n, j) [SI]; columns as in `joint_names`.
        """
        phase = np.mod(np.atleast_1d(time), self.period)
        columns = [self._course(self.joints[joint], phase) for joint in self.joint_names]
        return MotionSamples(*np.stack(columns, axis=-1))

    def instants(self) -> Instants:
        """Return what gives the rows of `evaluate` (3, j) at one time [s], compiled."""
        courses = [self.joints[joint] for joint in self.joint_names]
        ends = np.cumsum([0, *(len(course.time) for course in courses)])
        knots = np.concatenate([course.time for course in courses])
        positions = np.concatenate([course.position for course in courses])
        return partial(_courses, ends, knots, positions, self.corner)

    def _course(self, course: JointCourse, phase: np.ndarray) -> np.ndarray:
        """(3, n): the polygon, corrected within half of `corner` of every change of its speed."""
        knots, positions = np.array(course.time), np.array(course.position)
        speeds = np.diff(positions) / np.diff(knots)
        segment = np.clip(np.searchsorted(knots, phase, side="right") - 1, 0, len(speeds) - 1)
        motion = np.stack(
            [
                positions[segment] + speeds[segment] * (phase - knots[segment]),
                speeds[segment],
                np.zeros_like(phase),
            ]
        )
        changes = speeds - np.roll(speeds, 1)
        since = phase - knots[:-1, np.newaxis] + self.period / 2
        since = np.mod(since, self.period) - self.period / 2
        motion += np.einsum("k,ckn->cn", changes, np.stack(_rounding(since, self.corner)))
        return motion


def _rounding(time: np.ndarray, corner: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A unit step of speed at time 0, averaged over `corner`, less the step itself."""
    s = np.minimum(np.maximum(time / corner + 0.5, 0.0), 1.0)
    near = np.abs(time) < corner / 2
    return (
        near * (corner * s**3 * (1.0 - s / 2.0) - np.maximum(time, 0.0)),
        near * (s**2 * (3.0 - 2.0 * s) - (time >= 0.0)),
        6.0 * s * (1.0 - s) / corner,
    )


_rounding_once = njit(cache=True)(_rounding)  # at one time


@njit(cache=True)
def _courses(
    ends: np.ndarray, knots: np.ndarray, positions: np.ndarray, corner: float, time: float
) -> np.ndarray:
    """Courses at one time [s]: (3, j); those of joint i have the knots ends[i]:ends[i + 1]."""
    motion = np.zeros((3, len(ends) - 1))
    for i in range(len(ends) - 1):
        t, p = knots[ends[i] : ends[i + 1]], positions[ends[i] : ends[i + 1]]
        period, last = t[-1], len(t) - 1
        phase = time % period
        before = (p[last] - p[last - 1]) / (t[last] - t[last - 1])
        position = speed_now = 0.0
        for k in range(last):
            speed = (p[k + 1] - p[k]) / (t[k + 1] - t[k])
            if phase >= t[k]:
                position, speed_now = p[k] + speed * (phase - t[k]), speed
            since = (phase - t[k] + period / 2) % period - period / 2
            rounded = _rounding_once(since, corner)
            for c in range(3):
                motion[c, i] += (speed - before) * rounded[c]
            before = speed
        motion[0, i] += position
        motion[1, i] += speed_now
    return motion


class PeriodicTrajectory(Protocol):
    """A periodic motion of some joints; the others are held."""

    @property
    def name(self) -> str:
        """For messages."""

    @property
    def period(self) -> float:
        """[s]."""

    @property
    def harmonics(self) -> int:
        """Number of harmonics of (32) that its finest details correspond to."""

    @property
    def joint_names(self) -> tuple[str, ...]:
        """The joints that move, in the order of the columns of `evaluate`."""

    @property
    def probe(self) -> Probe | None:
        """Signal added to the commands, if any."""

    def evaluate(self, time: np.ndarray) -> MotionSamples:
        """Position, velocity and acceleration at any time (n,) [s]."""


def instants(trajectory: PeriodicTrajectory) -> Instants:
    """Return what gives the rows of `evaluate` (3, j) at one time [s]: compiled, if it can be."""
    if isinstance(trajectory, FourierTrajectory | SweepTrajectory):
        return trajectory.instants()
    return lambda time: np.concatenate(trajectory.evaluate(np.array([time])))


FileTrajectory = FourierTrajectory | SweepTrajectory | PointsTrajectory
KINDS: dict[Any, type[FileTrajectory]] = {"sweep": SweepTrajectory, "points": PointsTrajectory}


def load_trajectory(path: Path | str) -> FileTrajectory:
    """Load the trajectory of a YAML file.

    Parameters
    ----------
    path
        The file; `kind: sweep` in it marks sweeps and dwells, `kind: points` a motion through
        points that does not repeat; without a kind it is a Fourier series (32).

    Returns
    -------
    FourierTrajectory, SweepTrajectory or PointsTrajectory
        The trajectory.

    Raises
    ------
    ConfigurationError
        The file cannot be read, or a value in it is wrong.
    """
    document = read_document(path)
    return document.validated(schema_of(document.content))


def schema_of(content: Any) -> type[FileTrajectory]:
    """Schema of the plain content of a trajectory file."""
    kind = content.get("kind") if isinstance(content, dict) else None
    return KINDS.get(kind, FourierTrajectory) if isinstance(kind, str) else FourierTrajectory


def read_apart(path: Path | str) -> FileTrajectory:
    """As `load_trajectory`, in a process of its own; `ConfigurationError` too if it takes more time
    or memory than any trajectory does.

    A few kB of YAML with aliases take a second to check, and hold the lock of the interpreter all
    the time: a node that leads a crane cannot afford that.
    """
    reader = sys.executable, "-m", __name__, str(path)
    try:
        done = subprocess.run(reader, capture_output=True, text=True, timeout=LONGEST_WAIT)
    except subprocess.TimeoutExpired:
        raise ConfigurationError(
            f"{path}: cannot be read within {LONGEST_WAIT} s; is it the right file?"
        ) from None
    except (ValueError, OSError) as error:  # no path at all, or longer than any
        raise ConfigurationError(f"{path!r}: cannot be read: {error}") from None
    if done.returncode == REFUSED:
        raise ConfigurationError(done.stdout)
    if done.returncode or len(done.stdout) > LARGEST_ANSWER:
        why = (done.stderr.strip().splitlines() or ["it is too large"])[-1]
        raise ConfigurationError(f"{path}: cannot be read: {why}")
    content = json.loads(done.stdout)
    return validate(content, schema_of(content), path)


def main() -> int:
    """Tell the content of a trajectory file as JSON, or why it is none."""
    resource.setrlimit(resource.RLIMIT_CPU, (READING_TIME, READING_TIME))
    resource.setrlimit(resource.RLIMIT_AS, (READING_MEMORY, READING_MEMORY))
    try:
        trajectory = load_trajectory(sys.argv[1])
    except ConfigurationError as error:
        sys.stdout.write(str(error)[:LARGEST_ANSWER])
        return REFUSED
    sys.stdout.write(json.dumps(trajectory.model_dump(mode="json", exclude_none=True)))
    return 0


if __name__ == "__main__":
    sys.exit(main())
