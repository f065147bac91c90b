"""Breakaway: friction that grows while a joint stands and gives way once it slides."""

import math
from typing import ClassVar, Literal

import numpy as np
from numba import njit
from pydantic import Field
from typing_extensions import override

from crane_model.array import Array, Flags
from crane_model.record import Record
from crane_model.terms.effect import Effect, Shape
from crane_model.terms.memory_term import JointMemoryTerm
from crane_model.terms.term import Family, Parameter, Setting


class Stiction(JointMemoryTerm):
    """f_b w sgn(q'): stiction beyond (10), with w' = (1 - w)/dwell at rest and w' = -w|q'|/travel.

    A joint that stands for some `dwell` [s] holds f_b more than Coulomb friction; sliding over
    `travel` [rad or m] takes it away. A run begins at w = 1: the machine has stood before it.
    """

    type: Literal["stiction"] = "stiction"
    family: ClassVar[Family] = "friction"
    effect: ClassVar[Effect] = Effect(
        "stiction",
        "a peak of friction when a joint starts after it stood, and at no other time",
        ("stribeck",),
        "starts from rest after dwells of different lengths",
        follows=("way since it turned",),
    )
    shapes: ClassVar[dict[str, Shape]] = {
        "travel": Shape(3e-4, 3e-2, "rad or m", 7, "displacement over which it gives way"),
        "dwell": Shape(0.2, 5.0, "s", 3, "time at rest in which it grows"),
    }

    travel: float = Field(gt=0)
    dwell: float = Field(gt=0)

    @override
    def parameter(self, coordinate: str, force: str) -> Parameter:
        return Parameter("f_b", force, 0.0, "friction at breakaway beyond Coulomb friction")

    def start(self, record: Record, setting: Setting) -> Array:
        """w = 1."""
        return np.ones((len(record), 1))

    def advance(self, states: Array, before: Record, after: Record, setting: Setting) -> Array:
        """Exact for a step at rest or in one direction."""
        j = before.column(self.joint)
        way = (after.position[:, j] - before.position[:, j]) / self.travel
        rest = (after.time - before.time) / self.dwell
        stands = (before.direction[:, j] == 0.0) & (after.direction[:, j] == 0.0)
        return _advanced(states[:, 0], way, rest, stands)[:, np.newaxis]

    def column(self, states: Array, record: Record, j: int) -> Array:
        """w sgn(q')."""
        return states[:, 0] * record.direction[:, j]

    def trace(self, record: Record, setting: Setting) -> Array:
        """As `advance` from sample to sample, compiled."""
        j = record.column(self.joint)
        q, still = record.position[:, j], record.direction[:, j] == 0.0
        way = np.diff(q, prepend=q[:1]) / self.travel
        rest = np.diff(record.time, prepend=record.time[:1]) / self.dwell
        stands = still & np.roll(still, 1)
        return _traced(way, rest, stands, record.first_of_run)[:, np.newaxis]


@njit(cache=True)
def _grown(w: float, way: float, rest: float, stands: bool) -> float:
    """w after a way and a time in units of travel and dwell."""
    if stands:
        return 1.0 + (w - 1.0) * math.exp(-rest)
    return w * math.exp(-abs(way))


@njit(cache=True)
def _advanced(w: Array, way: Array, rest: Array, stands: Flags) -> Array:
    out = np.empty_like(w)
    for n in range(len(w)):
        out[n] = _grown(w[n], way[n], rest[n], stands[n])
    return out


@njit(cache=True)
def _traced(way: Array, rest: Array, stands: Flags, first: Flags) -> Array:
    w = np.ones(len(way))
    for k in range(1, len(way)):
        if not first[k]:
            w[k] = _grown(w[k - 1], way[k], rest[k], stands[k])
    return w
