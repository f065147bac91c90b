"""Friction and play with a memory: presliding, breakaway, stick and slip, backlash."""

import math
from typing import Literal

import numpy as np
from numba import njit
from pydantic import Field

from crane_model.array import Array, Flags
from crane_model.record import Record
from crane_model.terms.joint_term import JointMemoryTerm, MemoryTerm, OneJointTerm
from crane_model.terms.term import Effect, Parameter, Setting, Shape

# Friction before a joint slides: its force builds up over a small displacement.


class Presliding(JointMemoryTerm):
    """f_h z with z' = (q' - |q'| z)/travel: hysteresis of Dahl (1968), |z| <= 1.

    In place of the jump of (13) at a reversal, friction changes over a displacement of about
    `travel` [rad or m], whatever the speed. A run begins at z = 0.
    """

    type: Literal["presliding"] = "presliding"
    family = "friction"
    effect = Effect(
        "presliding hysteresis",
        "a loop against displacement after every reversal, the same at all speeds",
        ("coulomb", "stribeck", "maxwell_slip", "backlash", "time_skew"),
        "small slow strokes about one position, to and fro",
        kin=("maxwell_slip",),
        follows=("displacement since the reversal",),
    )
    shapes = {
        "travel": Shape(3e-4, 3e-2, "rad or m", 9, "displacement over which friction builds up")
    }
    symbol = Parameter("f_h", "{force}", 0.0, "friction that builds up over a displacement")

    travel: float = Field(gt=0)

    def start(self, record: Record, setting: Setting) -> Array:
        return np.zeros((len(record), 1))

    def advance(self, states: Array, before: Record, after: Record, setting: Setting) -> Array:
        """Exact for a step in one direction."""
        j = before.column(self.joint)
        displacement = (after.position[:, j] - before.position[:, j]) / self.travel
        return _advanced(states[:, 0], displacement)[:, np.newaxis]

    def column(self, states: Array, record: Record, j: int) -> Array:
        return states[:, 0]

    def trace(self, record: Record, setting: Setting) -> Array:
        q = record.position[:, record.column(self.joint)]
        displacement = np.diff(q, prepend=q[:1]) / self.travel
        return _traced(displacement, record.first_of_run)[:, np.newaxis]


@njit(cache=True)
def _slid(z: float, displacement: float) -> float:
    end = 1.0 if displacement > 0.0 else -1.0
    return end + (z - end) * math.exp(-abs(displacement))


@njit(cache=True)
def _advanced(z: Array, displacement: Array) -> Array:
    out = np.empty_like(z)
    for n in range(len(z)):
        out[n] = _slid(z[n], displacement[n])
    return out


@njit(cache=True)
def _traced(displacement: Array, first: Flags) -> Array:
    z = np.zeros(len(displacement))
    for k in range(1, len(displacement)):
        if not first[k]:
            z[k] = _slid(z[k - 1], displacement[k])
    return z


# Breakaway: friction that grows while a joint stands and gives way once it slides.


class Stiction(JointMemoryTerm):
    """f_b w sgn(q'): stiction beyond (10), with w' = (1 - w)/dwell at rest and w' = -w|q'|/travel.

    A joint that stands for some `dwell` [s] holds f_b more than Coulomb friction; sliding over
    `travel` [rad or m] takes it away. A run begins at w = 1: the machine has stood before it.
    """

    type: Literal["stiction"] = "stiction"
    family = "friction"
    effect = Effect(
        "stiction",
        "a peak of friction when a joint starts after it stood, and at no other time",
        ("stribeck",),
        "starts from rest after dwells of different lengths",
        follows=("displacement since the reversal",),
    )
    shapes = {
        "travel": Shape(3e-4, 3e-2, "rad or m", 7, "displacement over which it gives way"),
        "dwell": Shape(0.2, 5.0, "s", 3, "time at rest in which it grows"),
    }
    symbol = Parameter("f_b", "{force}", 0.0, "friction at breakaway beyond Coulomb friction")

    travel: float = Field(gt=0)
    dwell: float = Field(gt=0)

    def start(self, record: Record, setting: Setting) -> Array:
        return np.ones((len(record), 1))

    def advance(self, states: Array, before: Record, after: Record, setting: Setting) -> Array:
        """Exact for a step at rest or in one direction."""
        j = before.column(self.joint)
        displacement = (after.position[:, j] - before.position[:, j]) / self.travel
        rest = (after.time - before.time) / self.dwell
        stands = (before.direction[:, j] == 0.0) & (after.direction[:, j] == 0.0)
        return _stiction_advanced(states[:, 0], displacement, rest, stands)[:, np.newaxis]

    def column(self, states: Array, record: Record, j: int) -> Array:
        return states[:, 0] * record.direction[:, j]

    def trace(self, record: Record, setting: Setting) -> Array:
        j = record.column(self.joint)
        q, still = record.position[:, j], record.direction[:, j] == 0.0
        displacement = np.diff(q, prepend=q[:1]) / self.travel
        rest = np.diff(record.time, prepend=record.time[:1]) / self.dwell
        stands = still & np.roll(still, 1)
        return _stiction_traced(displacement, rest, stands, record.first_of_run)[:, np.newaxis]


@njit(cache=True)
def _grown(w: float, displacement: float, rest: float, stands: bool) -> float:
    """w after a way and a time in units of travel and dwell."""
    if stands:
        return 1.0 + (w - 1.0) * math.exp(-rest)
    return w * math.exp(-abs(displacement))


@njit(cache=True)
def _stiction_advanced(w: Array, displacement: Array, rest: Array, stands: Flags) -> Array:
    out = np.empty_like(w)
    for n in range(len(w)):
        out[n] = _grown(w[n], displacement[n], rest[n], stands[n])
    return out


@njit(cache=True)
def _stiction_traced(displacement: Array, rest: Array, stands: Flags, first: Flags) -> Array:
    w = np.ones(len(displacement))
    for k in range(1, len(displacement)):
        if not first[k]:
            w[k] = _grown(w[k - 1], displacement[k], rest[k], stands[k])
    return w


# Hysteresis as several elements side by side that stick and slip.

SHARES = np.array([1 / 9, 1 / 3, 1.0])  # slip displacement of each element, per `travel`


class MaxwellSlip(MemoryTerm, OneJointTerm):
    """sum_i W_i z_i, z_i' = q'/d_i while |z_i| < 1 or it unloads: Maxwell slip (Iwan, GMS).

    Three springs k_i = W_i/d_i that slip at W_i, d_i = `travel` times 1/9, 1/3 and 1 [rad or m]:
    nested loops with the memory of turning points. A run begins relaxed, z = 0.
    """

    type: Literal["maxwell_slip"] = "maxwell_slip"
    family = "friction"
    effect = Effect(
        "Maxwell slip",
        "nested loops against displacement that remember the turning points",
        ("stribeck", "presliding", "backlash"),
        "small slow strokes of several lengths about one position",
        kin=("presliding",),
        follows=("displacement since the reversal",),
    )
    shapes = {
        "travel": Shape(1e-3, 5e-2, "rad or m", 7, "displacement at which the last element slips")
    }

    travel: float = Field(gt=0)

    def joint_parameters(self, setting: Setting) -> tuple[Parameter, ...]:
        force = setting.force_unit(self.joint)
        return tuple(
            Parameter(f"W_{i + 1}", force, 0.0, f"force at which element {i + 1} slips")
            for i in range(len(SHARES))
        )

    def start(self, record: Record, setting: Setting) -> Array:
        return np.zeros((len(record), len(SHARES)))

    def advance(self, states: Array, before: Record, after: Record, setting: Setting) -> Array:
        """Exact for a step in one direction."""
        j = before.column(self.joint)
        displacement = (after.position[:, j] - before.position[:, j]) / self.travel
        moved: Array = np.clip(states + displacement[:, np.newaxis] / SHARES, -1.0, 1.0)
        return moved

    def joint_columns(self, record: Record, setting: Setting, j: int) -> Array:
        return self.states(record, setting)

    def trace(self, record: Record, setting: Setting) -> Array:
        q = record.position[:, record.column(self.joint)]
        return _slip_traced(np.diff(q, prepend=q[:1]) / self.travel, SHARES, record.first_of_run)


@njit(cache=True)
def _slip_traced(displacement: Array, shares: Array, first: Flags) -> Array:
    z = np.zeros((len(displacement), len(shares)))
    for k in range(1, len(displacement)):
        if not first[k]:
            for i in range(len(shares)):
                z[k, i] = min(1.0, max(-1.0, z[k - 1, i] + displacement[k] / shares[i]))
    return z


# Play between a cylinder and its joint.


class Backlash(JointMemoryTerm):
    """f_g (z - c)/2, c = sgn(tau), z' = 2 c|q'|/clearance until z = c: load not yet taken up.

    z in [-1, 1] is where a pin stands in its clearance. After the load has reversed, the joint
    moves by `clearance` [rad or m] until the pin is seated again; on the way the drive lacks the
    force f_g on the new side. A run begins seated.
    """

    type: Literal["backlash"] = "backlash"
    family = "elasticity"
    effect = Effect(
        "backlash",
        "force is missing over a short displacement after the load, not the speed, reverses",
        ("presliding", "maxwell_slip"),
        "slow strokes with a load that does not reverse, then with one that does",
        follows=("force",),
    )
    shapes = {
        "clearance": Shape(5e-4, 2e-2, "rad or m", 7, "motion of the joint across the clearance")
    }
    symbol = Parameter(
        "f_g", "{force}", 0.0, "force that is missing until the clearance is crossed"
    )

    clearance: float = Field(gt=0)

    def start(self, record: Record, setting: Setting) -> Array:
        return np.sign(self._load(record))[:, np.newaxis]

    def advance(self, states: Array, before: Record, after: Record, setting: Setting) -> Array:
        j = before.column(self.joint)
        displacement = 2.0 * (after.position[:, j] - before.position[:, j]) / self.clearance
        return _play_advanced(states[:, 0], displacement, self._load(after))[:, np.newaxis]

    def column(self, states: Array, record: Record, j: int) -> Array:
        load = self._load(record)
        return np.where(load == 0.0, 0.0, (states[:, 0] - np.sign(load)) / 2.0)

    def trace(self, record: Record, setting: Setting) -> Array:
        q = record.position[:, record.column(self.joint)]
        displacement = 2.0 * np.diff(q, prepend=q[:1]) / self.clearance
        return _play_traced(displacement, self._load(record), record.first_of_run)[:, np.newaxis]

    def _load(self, record: Record) -> Array:
        return self.needed(record, "force")[:, record.column(self.joint)]


@njit(cache=True)
def _crossed(z: float, displacement: float, load: float) -> float:
    """z after a way in units of half the clearance, under a load."""
    if load == 0.0:
        return z
    side = 1.0 if load > 0.0 else -1.0
    return z + min(abs(displacement), max(-abs(displacement), side - z))


@njit(cache=True)
def _play_advanced(z: Array, displacement: Array, load: Array) -> Array:
    out = np.empty_like(z)
    for n in range(len(z)):
        out[n] = _crossed(z[n], displacement[n], load[n])
    return out


@njit(cache=True)
def _play_traced(displacement: Array, load: Array, first: Flags) -> Array:
    z = np.sign(load)
    for k in range(1, len(displacement)):
        if not first[k]:
            z[k] = _crossed(z[k - 1], displacement[k], load[k])
    return z
