"""A record: samples of motion and force as every term of the model receives them."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import Self

import numpy as np

from crane_model.array import Array, Flags
from crane_model.errors import DataError

REMEDIES = {
    "force": "record chamber pressures or forces of every joint",
    "pressure_a": "record the chamber pressures",
    "pressure_b": "record the chamber pressures",
    "slew_velocity": "record the encoder of the slew joint",
    "command": "record the valve commands",
    "temperature": "record the temperature of the oil",
    "supply_pressure": "record the supply pressure",
    "tank_pressure": "record the tank pressure",
}
"""Remedies if a signal that a term needs is not in a record."""


@dataclass(frozen=True)
class Record:
    """n samples of j joints. SI units; arrays that a machine does not log are None.

    `run` numbers the recordings that the samples come from: memory of an effect ends where the run
    changes. `memory` holds the states of terms that have some, where a simulation brings them
    along; `force_rate` is d force/dt and `force_at` the force (n, j) so many seconds later, by the
    same lever arms, where these are known better than from `force`.
    `velocity_resolution` (j,) is the speed below which the sign of the velocity is not
    known. `direction_known` overrides the sign convention where a simulation knows better.
    """

    joints: tuple[str, ...]
    time: Array  # (n,) s
    position: Array  # (n, j)
    velocity: Array  # (n, j)
    acceleration: Array  # (n, j)
    run: Array | None = None  # (n,) whole numbers; None: one run
    force: Array | None = None  # (n, j) measured generalized force, N m or N
    pressure_a: Array | None = None  # (n, j) Pa
    pressure_b: Array | None = None  # (n, j) Pa
    slew_position: Array | None = None  # (n,) rad
    slew_velocity: Array | None = None  # (n,) rad/s
    slew_acceleration: Array | None = None  # (n,) rad/s2
    command: Array | None = None  # (n, j) valve command, -1..1
    temperature: Array | None = None  # (n,) deg C
    supply_pressure: Array | None = None  # (n,) Pa
    tank_pressure: Array | None = None  # (n,) Pa
    velocity_resolution: Array | None = None  # (j,)
    direction_known: Array | None = None  # (n, j)
    force_rate: Array | None = None  # (n, j) N m/s or N/s
    force_at: Callable[[float], Array] | None = None
    memory: Mapping[object, Array] | None = None  # term: (n, states)

    def __post_init__(self) -> None:
        shape = self.position.shape
        if len(shape) != 2 or shape[1] != len(self.joints):
            raise DataError(
                f"record: position has shape {shape}, but {len(self.joints)} joints "
                f"({', '.join(self.joints)}) need (samples, {len(self.joints)})"
            )
        for name in ("velocity", "acceleration", "force", "pressure_a", "pressure_b", "command"):
            value = getattr(self, name)
            if value is not None and value.shape != shape:
                raise DataError(f"record: {name} has shape {value.shape}, position has {shape}")

    def __len__(self) -> int:
        return len(self.position)

    @cached_property
    def direction(self) -> Array:
        """sgn(q') of (10)-(13), (n, j).

        sgn(0) = 0, and speeds below `velocity_resolution` count as 0: there (13) allows any force
        between its two branches, and a sign read off noise would make the torque jump.
        """
        if self.direction_known is not None:
            return self.direction_known
        direction = np.sign(self.velocity)
        if self.velocity_resolution is not None:
            direction[np.abs(self.velocity) < self.velocity_resolution] = 0.0
        return direction

    @cached_property
    def first_of_run(self) -> Flags:
        """Return whether a recording begins with the sample, (n,) bool."""
        first = np.zeros(len(self), dtype=bool)
        first[:1] = True
        if self.run is not None:
            first[1:] = np.diff(self.run) != 0
        return first

    def needed(self, signal: str, by: str) -> Array:
        """The field `signal`; `DataError` naming who needs it and what to do if it is None."""
        value: Array | None = getattr(self, signal)
        if value is None:
            raise DataError(f"{by}: needs {signal}, which was not recorded; {REMEDIES[signal]}")
        return value

    def rate(self, values: Array) -> Array:
        """d values/dt by central differences that do not cross runs; 0 in a run of one sample."""
        rate = np.zeros_like(values, dtype=float)
        begins = np.flatnonzero(self.first_of_run)
        for begin, end in zip(begins, [*begins[1:], len(self)], strict=True):
            if end - begin > 1:
                part = slice(begin, end)
                rate[part] = np.gradient(values[part], self.time[part], axis=0)
        return rate

    def shifted(self, values: Array, lead: float) -> Array:
        """Values (n,) `lead` [s] later, by straight lines within runs; constant at their ends."""
        shifted = np.empty_like(values, dtype=float)
        begins = np.flatnonzero(self.first_of_run)
        for begin, end in zip(begins, [*begins[1:], len(self)], strict=True):
            part = slice(begin, end)
            shifted[part] = np.interp(self.time[part] + lead, self.time[part], values[part])
        return shifted

    def take(self, samples: slice | Array) -> Self:
        """The record of these samples alone."""
        kept = {
            field.name: getattr(self, field.name)[samples]
            for field in fields(self)
            if field.name in PER_SAMPLE and getattr(self, field.name) is not None
        }
        if self.memory is not None:
            kept["memory"] = {term: states[samples] for term, states in self.memory.items()}
        if (known := self.force_at) is not None:
            kept["force_at"] = lambda lead: known(lead)[samples]
        return replace(self, **kept)

    def column(self, joint: str) -> int:
        """Index of `joint`; `DataError` if the record does not have it."""
        return column_of(self.joints, joint)

    def at_rest(self) -> Self:
        """The same positions without motion: what is left of the force is gravity."""
        still = np.zeros_like(self.position)
        return replace(self, velocity=still, acceleration=still, direction_known=still)


def column_of(joints: tuple[str, ...], joint: str) -> int:
    """Index of `joint` in a record of `joints`; `DataError` if it does not have it."""
    try:
        return joints.index(joint)
    except ValueError:
        raise DataError(f"record: no joint '{joint}'; it has {', '.join(joints)}") from None


PER_SAMPLE = frozenset(
    field.name
    for field in fields(Record)
    if field.name not in ("joints", "velocity_resolution", "memory", "force_at")
)
