"""The interface of all controllers, and the PD controller (36) with dead-band compensation.

A controller takes a state and gives a command; it knows no ROS and no clock. (36) has no state:

    u = -Kp (q - q_ref) - Kd (q' - q'_ref) + F_f,   limited to [-1, 1]

F_f = d+ max(s, 0) + d- min(s, 0) carries the command across the dead band (d+ upwards, d-
downwards) of the valve in the direction s, a continuous number from -1 to 1. With v0 the
standstill speed and e0 the position tolerance of the joint,

- outside the standstill band, |q'| >= v0: s = sgn(q'), as (36) has it;
- at standstill, q' = 0: s = q'_ref / v0 - (e beyond its tolerance) / e0, limited to [-1, 1]: the
  direction in which the reference moves and, where the reference rests, the one that lowers an
  error e = q - q_ref larger than e0;
- in between the two are blended smoothly over the measured speed.

So at rest, with the reference at rest and |e| <= e0, F_f = 0 and u = -Kp e is inside the dead band:
the valve stays closed and the crane is held still, without a command that switches sign.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from enum import IntEnum
from pathlib import Path
from typing import Annotated, Generic, NamedTuple, Protocol, Self, TypeVar

import numpy as np
from numba import njit
from pydantic import ConfigDict, Field, RootModel, model_validator

from crane_model.configuration import Schema, load
from crane_model.errors import RangeError
from crane_model.machine import Machine
from crane_model.machine_files import of_every_joint

BUMP = 0.2  # s, in which what a transition would make jump decays
STOP_RATE = 5.0  # 1/s, at which the command of a controller that stops goes to zero
BLEND = 1.0  # s, in which new gains take the place of the old
MODEL_TOLERANCE_SHARE = (
    0.1  # of the tracking tolerance: joints that the model keeps that much nearer
)


class SensorReading(NamedTuple):
    """Readings of the sensors of j joints, (j,) each [SI]; NaN if not measured."""

    position: np.ndarray  # rad, m
    velocity: np.ndarray  # rad/s, m/s
    pressure_a: np.ndarray  # Pa
    pressure_b: np.ndarray  # Pa
    supply: float  # Pa


class ChamberPressures(NamedTuple):
    """Readings of the transducers of j joints [Pa]; NaN if not measured."""

    a: np.ndarray  # (j,)
    b: np.ndarray
    supply: float

    @classmethod
    def none(cls, count: int) -> "ChamberPressures":
        """Nothing is measured of `count` joints."""
        nothing = np.full(count, np.nan)
        return cls(nothing, nothing, np.nan)


class Point(NamedTuple):
    """The reference of j joints at one instant, (j,) each [SI]."""

    position: np.ndarray
    velocity: np.ndarray
    acceleration: np.ndarray


class Wanted(NamedTuple):
    """The reference now, and `Controller.preview` later, as far as the reference knows."""

    now: Point
    ahead: Point
    phase: float = np.nan  # s since the period of a periodic motion began; NaN outside of one
    largest: float = 1.0  # command that is allowed: beyond it a controller is saturated


class ControlCondition(IntEnum):
    """How a joint, or a controller as its worst joint, is doing; the graver the larger."""

    AT_REST = 0
    FOLLOWING = 1
    ADAPTATION_AT_BOUND = 2
    PRESSURES_LOST = 3
    SATURATED = 4
    NOT_INITIALISED = 5
    NOT_MEASURED = 6
    NO_ANSWER = 7
    WRONG_MODEL = 8

    @property
    def text(self) -> str:
        return WORDS[self]

    @property
    def stops(self) -> bool:
        """Return whether the controller leads the command to zero until `start`."""
        return self >= ControlCondition.NOT_INITIALISED


WORDS = {
    ControlCondition.AT_REST: "at rest",
    ControlCondition.FOLLOWING: "following",
    ControlCondition.ADAPTATION_AT_BOUND: "adaptation at its bound: check valve and dead bands",
    ControlCondition.PRESSURES_LOST: "pressures lost: using the load of the model",
    ControlCondition.SATURATED: "saturated: lower the speed of the reference",
    ControlCondition.NOT_INITIALISED: "not initialised: valves closed",
    ControlCondition.NOT_MEASURED: "position not measured: valves closed",
    ControlCondition.NO_ANSWER: "valve does not answer: valves closed",
    ControlCondition.WRONG_MODEL: "wrong model, the joint moves against its command: valves closed",
}
CONDITIONS = tuple(ControlCondition)


def conditions(codes: np.ndarray) -> tuple[ControlCondition, ...]:
    """By their numbers (j,)."""
    return tuple([CONDITIONS[code] for code in codes.tolist()])


def gravest(conditions: tuple[ControlCondition, ...], joints: tuple[str, ...]) -> str:
    """The gravest condition, in words, and the joints that have it."""
    worst = max(conditions)
    if worst <= ControlCondition.FOLLOWING:
        return worst.text
    pairs = zip(joints, conditions, strict=True)
    return f"{', '.join(joint for joint, found in pairs if found == worst)}: {worst.text}"


class Controller(Protocol):
    """Commands the valves of j joints in the machine's order.

    `start` comes first; before it, and where `ControlCondition.stops`, the command goes to zero. A
    reading that is not finite moves nothing.
    """

    @property
    def preview(self) -> float:
        """How far ahead it wants the reference [s]: the lag of loop and valves."""

    @property
    def by_model(self) -> np.ndarray:
        """(j,) whether the model controls a joint: it is kept nearer to the reference."""

    def start(self, command: np.ndarray) -> None:
        """Take over where `command` (j,) -1..1 was in force, without a jump."""

    def command(self, dt: float, reading: SensorReading, wanted: Wanted) -> np.ndarray:
        """Commands (j,) in -1..1 that answer a reading `dt` [s] after the last one."""

    @property
    def conditions(self) -> tuple[ControlCondition, ...]:
        """Conditions of each joint, after the last command."""


class WrappedController:
    """A controller that does all as the `inner` one does; what differs, another class overrides."""

    def __init__(self, inner: Controller):
        self.inner = inner

    @property
    def preview(self) -> float:
        return self.inner.preview

    @property
    def by_model(self) -> np.ndarray:
        return self.inner.by_model

    @property
    def conditions(self) -> tuple[ControlCondition, ...]:
        return self.inner.conditions

    def start(self, command: np.ndarray) -> None:
        self.inner.start(command)

    def command(self, dt: float, reading: SensorReading, wanted: Wanted) -> np.ndarray:
        return self.inner.command(dt, reading, wanted)


DeadBand = Annotated[float, Field(ge=0.0, le=0.99)]
Small = Annotated[float, Field(ge=1e-6, le=1.0)]
T = TypeVar("T")


class JointGains(Schema):
    """Gains of (36) of one joint; units in `controller.yaml`."""

    kp: Annotated[float, Field(ge=1e-6, le=1000.0)]
    kd: Annotated[float, Field(ge=0.0, le=100.0)]
    dead_band_positive: DeadBand
    dead_band_negative: DeadBand
    standstill_speed: Small
    position_tolerance: Small

    @model_validator(mode="after")
    def _closed_at_rest(self) -> Self:
        rest = self.kp * self.position_tolerance
        for name in ("dead_band_positive", "dead_band_negative"):
            dead_band = getattr(self, name)
            if 0.0 < dead_band < rest:
                raise ValueError(
                    f"kp times position_tolerance is {rest:.6g}, more than {name} {dead_band:.6g}: "
                    "the valve of a crane at rest would be open; lower either of the two"
                )
        return self


class GainFields(NamedTuple, Generic[T]):
    """The fields of `JointGains` for compiled code: numbers of one joint, or arrays of several."""

    kp: T
    kd: T
    dead_band_positive: T
    dead_band_negative: T
    standstill_speed: T
    position_tolerance: T


GainArrays = GainFields[np.ndarray]  # (j,) each, in the order of the machine's joints


class Gains(RootModel[dict[str, JointGains]]):
    """Gains of (36) by joint."""

    model_config = ConfigDict(frozen=True)

    def __getitem__(self, joint: str) -> JointGains:
        return self.root[joint]

    @property
    def arrays(self) -> GainArrays:
        """The gains of all joints by field, for `command`."""
        rows = self.root.values()
        return GainFields(
            **{name: np.array([getattr(row, name) for row in rows]) for name in GainFields._fields}
        )


def load_gains(path: Path | str, machine: Machine) -> Gains:
    """The gains in `path`, in the order of the machine's joints; `ConfigurationError` if wrong."""
    return Gains(of_every_joint(load(path, Gains).root, machine.joint_names, str(path)))


@njit(cache=True)
def joint_command(
    gains: GainFields[float], q: float, velocity: float, q_ref: float, velocity_ref: float
) -> float:
    """(36) of one joint for compiled loops; NaN where an input is not finite."""
    if not np.isfinite(q - q_ref + velocity - velocity_ref):
        return np.nan
    tolerance = gains.position_tolerance
    error = q - q_ref
    excess = error - min(max(error, -tolerance), tolerance)
    wanted = min(max(velocity_ref / gains.standstill_speed - excess / tolerance, -1.0), 1.0)
    share = min(abs(velocity) / gains.standstill_speed, 1.0)
    moving = share * share * (3.0 - 2.0 * share)
    direction = moving * np.sign(velocity) + (1.0 - moving) * wanted
    dead_band = gains.dead_band_positive if direction > 0.0 else gains.dead_band_negative
    u = -gains.kp * error - gains.kd * (velocity - velocity_ref) + dead_band * direction
    return min(max(u, -1.0), 1.0)


@njit(cache=True)
def gains_of(gains: GainArrays, i: int) -> GainFields[float]:
    """Those of joint i, for compiled loops."""
    return GainFields(
        kp=gains.kp[i],
        kd=gains.kd[i],
        dead_band_positive=gains.dead_band_positive[i],
        dead_band_negative=gains.dead_band_negative[i],
        standstill_speed=gains.standstill_speed[i],
        position_tolerance=gains.position_tolerance[i],
    )


@njit(cache=True)
def _commands(
    gains: GainArrays, q: np.ndarray, velocity: np.ndarray, q_ref: np.ndarray,
    velocity_ref: np.ndarray,
) -> np.ndarray:  # fmt: skip
    u = np.empty(len(q))
    for i in range(len(q)):
        u[i] = joint_command(gains_of(gains, i), q[i], velocity[i], q_ref[i], velocity_ref[i])
    return u


def command(
    gains: GainArrays,
    q: np.ndarray,
    velocity: np.ndarray,
    q_ref: np.ndarray,
    velocity_ref: np.ndarray,
    units: Mapping[str, str],
) -> np.ndarray:
    """Valve commands (j,) in [-1, 1] of (36); `gains` is `Gains.arrays`, the others (j,) in SI.

    `units` of the joints are those of their machine. Raises `RangeError` where an input is not
    finite: a crane is never moved on a guess.
    """
    u: np.ndarray = _commands(gains, q, velocity, q_ref, velocity_ref)
    if np.isnan(u).any():
        inputs = np.array([q, velocity, q_ref, velocity_ref])
        kind, place = np.unravel_index(np.argmin(np.isfinite(inputs)), inputs.shape)
        joint, unit = tuple(units.items())[place]
        quantity = ("position", "velocity", "reference position", "reference velocity")[kind]
        rate = "" if kind % 2 == 0 else "/s"
        raise RangeError(
            f"{joint}: {quantity} must be finite, got {inputs[kind, place]} {unit}{rate}; "
            "no command is given, close the valves"
        )
    return u


def compile_command(gains: GainArrays) -> None:
    """Once, before the crane moves: the first `command` takes seconds."""
    zero = np.zeros_like(gains.kp)
    _commands(gains, q=zero, velocity=zero, q_ref=zero, velocity_ref=zero)


@dataclass(frozen=True, eq=False)
class Tuning:
    """Gains of (36), largest command (0, 1], tracking tolerance (j,) [rad, m]; changeable."""

    gains: GainArrays
    saturation: float
    tolerance: np.ndarray

    def tightened(self, by_model: np.ndarray) -> "Tuning":
        """With the tolerances of joints (j,) that the model controls at `MODEL_TOLERANCE_SHARE`."""
        share = np.where(by_model, MODEL_TOLERANCE_SHARE, 1.0)
        return replace(self, tolerance=share * self.tolerance)


class Blend:
    """A tuning that follows what it is given: gains and saturation linearly within `BLEND`, so that
    the command does not jump; the tolerance, which moves nothing, at once.
    """

    def __init__(self, tuning: Tuning):
        self._old = self._new = tuning
        self._share = 1.0

    def to(self, tuning: Tuning) -> None:
        self._old, self._new, self._share = self.now, tuning, 0.0

    def advance(self, dt: float) -> Tuning:
        self._share = min(1.0, self._share + dt / BLEND)
        return self.now

    @property
    def now(self) -> Tuning:
        old, new, share = self._old, self._new, self._share
        if share == 1.0:
            return new
        pairs = zip(old.gains, new.gains, strict=True)
        gains = GainFields(*((1.0 - share) * a + share * b for a, b in pairs))
        saturation = (1.0 - share) * old.saturation + share * new.saturation
        return Tuning(gains, saturation, new.tolerance)


SATURATED, FOLLOWING = int(ControlCondition.SATURATED), int(ControlCondition.FOLLOWING)
AT_REST, NOT_MEASURED = int(ControlCondition.AT_REST), int(ControlCondition.NOT_MEASURED)
NOT_INITIALISED = int(ControlCondition.NOT_INITIALISED)  # the first that stops


class PdDeadBand:
    """(36) as a `Controller`: needs no model, no transducers and no preview."""

    preview = 0.0

    def __init__(self, gains: GainArrays):
        self._gains = gains
        self._begun = False  # a command has been given since `start`
        self._last, self._bump = np.zeros((2, len(gains.kp)))
        self._codes = np.full(len(gains.kp), NOT_INITIALISED)
        self.by_model = np.zeros(len(gains.kp), dtype=bool)

    def start(self, command: np.ndarray) -> None:
        """Take over where `command` (j,) was in force, without a jump."""
        self._last[:], self._begun = command, False
        self._codes[:] = AT_REST

    def command(self, dt: float, reading: SensorReading, wanted: Wanted) -> np.ndarray:
        if self._begun or np.isfinite(reading.velocity).all():  # else the filter has only begun
            now = wanted.now
            inputs = np.array([reading.position, reading.velocity, now.position, now.velocity])
            self._begun = _cycle(
                *(self._gains, dt, inputs, wanted.largest, self._begun),
                *(self._last, self._bump, self._codes),
            )
        return self._last.copy()

    @property
    def conditions(self) -> tuple[ControlCondition, ...]:
        """Conditions of each joint, after the last command."""
        return conditions(self._codes)


@njit(cache=True)
def _cycle(
    gains: GainArrays, dt: float, inputs: np.ndarray, largest: float, begun: bool, u: np.ndarray,
    bump: np.ndarray, codes: np.ndarray,
) -> bool:  # fmt: skip
    """Commands u (j,) that answer the inputs (4, j) of (36); whether one was given by (36)."""
    stop = False
    for code in codes:
        stop |= code >= NOT_INITIALISED
    if not stop and not np.isfinite(inputs).all():
        for i in range(len(u)):
            codes[i] = AT_REST if np.isfinite(inputs[:, i]).all() else NOT_MEASURED
        stop = True
    if stop:
        for i in range(len(u)):
            u[i] = math.copysign(max(abs(u[i]) - STOP_RATE * dt, 0.0), u[i])
        return begun
    for i in range(len(u)):
        joint_gains = gains_of(gains, i)
        q, velocity, q_ref, velocity_ref = inputs[0, i], inputs[1, i], inputs[2, i], inputs[3, i]
        asked = joint_command(joint_gains, q, velocity, q_ref, velocity_ref)
        bump[i] = bump[i] * math.exp(-dt / BUMP) if begun else u[i] - asked
        u[i] = min(max(asked + bump[i], -largest), largest)
        if abs(u[i]) >= largest:
            codes[i] = SATURATED
        else:
            moves = velocity_ref != 0.0 or abs(q_ref - q) > joint_gains.position_tolerance
            codes[i] = FOLLOWING if moves else AT_REST
    return True
