"""Forward simulation of a model: motion from cylinder forces, many runs side by side.

Coulomb friction at standstill can take any value between its two branches, so each step asks for
the velocity at which the branch fits: sgn(v) where a joint moves, anything in [-1, 1] where it
stands. A joint whose load stays below breakaway therefore stands exactly still.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numba import njit

from crane_model.array import Array
from crane_model.cylinders import lever_arms
from crane_model.errors import RangeError
from crane_model.hydraulics.stepping import with_dry_friction
from crane_model.model_file import Model
from crane_model.record import Record
from crane_model.terms import Term


@dataclass(frozen=True)
class Simulation:
    """Motion of N runs of j joints at T instants."""

    time: Array  # (T,) s
    position: Array  # (T, N, j)
    velocity: Array  # (T, N, j)
    acceleration: Array  # (T, N, j) mean over the step that led here; 0 at the start
    force: Array  # (T, N, j) generalized force at these positions, N m or N


def simulate(
    model: Model,
    position: Array,
    velocity: Array,
    drive: Array,
    period: float,
    substeps: int = 2,
    beside: Mapping[str, Array] | None = None,
    memory: Mapping[Term, Array] | None = None,
) -> Simulation:
    """Move N runs of a model from a state (N, j), driven at T instants.

    Explicit midpoint steps of period / substeps: errors fall with the square of the step while the
    joints slide, and with the step itself where Coulomb friction turns round.

    Parameters
    ----------
    model
        The model with its values, of j joints.
    position, velocity
        (N, j) states in which the runs begin [rad, m; rad/s, m/s].
    drive
        (T, N, j) cylinder forces [N], positive extending, if the model has a machine, else
        generalized forces [N m, N]; interpolated between instants.
    period
        Between instants [s].
    substeps
        Steps from an instant to the next.
    beside
        (T, N, ...) further signals that terms ask of a record, by its field there (pressure_a,
        temperature, ...).
    memory
        (N, s) states in which terms with memory begin; by default as at the start of a run.

    Returns
    -------
    Simulation
        Time, motion and generalized forces at the T instants.

    Raises
    ------
    RangeError
        If the motion leaves the range in which a linkage can be assembled, the drive is not finite,
        or the mass matrix of the model is not positive definite.
    """
    if not np.isfinite(drive).all():
        raise RangeError(f"simulation of '{model.name}': the drive has samples that are not finite")
    step = period / substeps
    inputs = _Inputs(drive, beside or {}, period)
    q, v = np.array(position, dtype=float), np.array(velocity, dtype=float)
    now = _Instant(model, inputs, 0.0, q, v)
    begun = {term: term.start(now.record, model.setting) for term in model.terms}
    begun |= dict(memory or {})
    states = {term: state for term, state in begun.items() if state.shape[1]}
    _check_inertia(model, _split(now, states)[0])
    course = [(q, v, np.zeros_like(v))]
    for k in range(1, len(drive)):
        start = v
        for i in range(substeps):
            v_half = _next_velocity(now, states, v, step / 2)
            q_half = q + step / 4 * (v + v_half)
            middle = _Instant(model, inputs, k - 1 + (i + 0.5) / substeps, q_half, v_half)
            half = _advanced(states, now, middle)
            v_next = _next_velocity(middle, half, v, step)
            q_next = q + step / 2 * (v + v_next)
            after = _Instant(model, inputs, k - 1 + (i + 1) / substeps, q_next, v_next)
            states = _advanced(states, now, after)
            q, v, now = q_next, v_next, after
        course.append((q, v, (v - start) / period))
    positions, velocities, accelerations = (np.stack(parts) for parts in zip(*course, strict=True))
    arms = _lever_arms(model, positions.reshape(-1, drive.shape[-1]))
    force = drive * arms.reshape(drive.shape)
    time = period * np.arange(len(drive), dtype=float)
    return Simulation(time, positions, velocities, accelerations, force)


def _advanced(
    states: dict[Term, Array], before: "_Instant", after: "_Instant"
) -> dict[Term, Array]:
    """States of all terms that have some, one step on."""
    setting = before.model.setting
    return {
        term: term.advance(state, before.record, after.record, setting)
        for term, state in states.items()
    }


@dataclass(frozen=True)
class _Inputs:
    """Inputs of the runs, interpolated between instants; `at` counts instants."""

    drive: Array  # (T, N, j)
    beside: Mapping[str, Array]  # (T, N, ...)
    period: float

    def value(self, series: Array, at: float) -> Array:
        before = min(int(at), len(series) - 2)
        value: Array = series[before] + (series[before + 1] - series[before]) * (at - before)
        return value

    def value_within(self, series: Array, at: float) -> Array:
        """The same, and beyond both ends what it is there."""
        return self.value(series, min(max(at, 0.0), len(series) - 1.0))

    def rate(self, series: Array, at: float) -> Array:
        before = min(int(at), len(series) - 2)
        rate: Array = (series[before + 1] - series[before]) / self.period
        return rate


class _Instant:
    """The N runs in a state at one instant, all that acts on them, and records of motion there."""

    def __init__(self, model: Model, inputs: _Inputs, at: float, q: Array, v: Array):
        self.model, self.q, self.v = model, q, v
        self._inputs, self._at = inputs, at
        self._arms = _lever_arms(model, q)
        self.force = inputs.value(inputs.drive, at) * self._arms
        time = {"time": np.full(len(q), at * inputs.period)}  # unless it is given
        self._beside = time | {
            name: inputs.value(series, at) for name, series in inputs.beside.items()
        }

    @cached_property
    def record(self) -> Record:
        return self.moved(np.zeros_like(self.v))

    def moved(
        self,
        acceleration: Array,
        direction: Array | None = None,
        memory: Mapping[Term, Array] | None = None,
    ) -> Record:
        """The runs, stacked as often as `acceleration` (cases N, j) asks for."""
        cases = len(acceleration) // len(self.q)

        def stacked(values: Array) -> Array:
            return np.concatenate([values] * cases)

        def force_at(lead: float) -> Array:
            at = self._at + lead / self._inputs.period
            return stacked(self._inputs.value_within(self._inputs.drive, at) * self._arms)

        return Record(
            joints=self.model.joints,
            position=stacked(self.q),
            velocity=stacked(self.v),
            acceleration=acceleration,
            direction_known=direction,
            force=stacked(self.force),
            force_rate=stacked(self._inputs.rate(self._inputs.drive, self._at) * self._arms),
            force_at=force_at,
            memory={term: stacked(state) for term, state in (memory or {}).items()},
            **{name: stacked(values) for name, values in self._beside.items()},
        )


def _next_velocity(
    at: _Instant, memory: Mapping[Term, Array], v_start: Array, step: float
) -> Array:
    """v_start + step M^-1 (load - dry s) with s in Sgn(result); M and load at the instant."""
    mass, load, dry = _split(at, memory)
    inverse = _inverse(at.model, mass)
    free = v_start + step * np.einsum("nij,nj->ni", inverse, load)
    return with_dry_friction(free, step * inverse, np.maximum(dry, 0.0))


def _inverse(model: Model, mass: Array) -> Array:
    inverse, positive = _inverses(mass)
    if not positive:
        raise RangeError(
            f"simulation of '{model.name}': the mass matrix is not positive definite; either the "
            "inertial values of the model are not physical or the steps are too long for its "
            "friction and the motion has grown without bound"
        )
    return inverse


def _check_inertia(model: Model, mass: Array) -> None:
    """`RangeError` if a joint has none in mass matrices (N, j, j)."""
    least = np.einsum("njj->nj", mass).min(axis=0)
    for joint, inertia in zip(model.joints, least, strict=True):
        if not inertia > 0.0:
            raise RangeError(
                f"simulation of '{model.name}': the inertia of {joint} is {inertia:.3g} in the "
                "model, and must be above 0 to move; list a term with inertia, or record faster "
                "motion, which determines it"
            )


def _split(at: _Instant, memory: Mapping[Term, Array]) -> tuple[Array, Array, Array]:
    """M, load and dry of drive - model = load - M a - dry s, from one evaluation of the model.

    It is evaluated on j + 2 stacked cases of a and s, the directions of motion. Being linear in
    acceleration and in the direction of motion is all that is asked of a term.
    """
    runs, joints = at.q.shape
    cases = joints + 2
    acceleration = np.zeros((cases, runs, joints))
    direction = np.zeros((cases, runs, joints))
    for j in range(joints):
        acceleration[j, :, j] = 1.0
    direction[-1] = 1.0
    both = acceleration.reshape(-1, joints), direction.reshape(-1, joints)
    force = at.model.predict(at.moved(*both, memory)).reshape(cases, runs, joints)
    rest = force[-2]
    mass = (force[:joints] - rest).transpose(1, 2, 0)
    return mass, at.force - rest, force[-1] - rest


def _lever_arms(model: Model, q: Array) -> Array:
    """(n, j) from cylinder forces, or generalized forces, to generalized forces."""
    return np.ones_like(q) if model.machine is None else lever_arms(model.machine, q, model.joints)


@njit(cache=True)
def _inverses(mass: Array) -> tuple[Array, bool]:
    """Inverses of N symmetric matrices (N, j, j), and whether all are positive definite.

    Gauss-Jordan elimination: without exchange of rows, pivots are positive for such matrices only.
    """
    runs, joints, _ = mass.shape
    inverse = mass.copy()
    for n in range(runs):
        m = inverse[n]
        for k in range(joints):
            pivot = m[k, k]
            if not pivot > 0.0:
                return inverse, False
            m[k, k] = 1.0
            for j in range(joints):
                m[k, j] /= pivot
            for i in range(joints):
                if i != k:
                    factor = m[i, k]
                    m[i, k] = 0.0
                    for j in range(joints):
                        m[i, j] -= factor * m[k, j]
    return inverse, True
