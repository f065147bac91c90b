"""The decentralized PD controller with dead-band compensation (36), its gains, and their tuning."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Generic, NamedTuple, Self, TypeVar

import numpy as np
from numba import njit
from pydantic import ConfigDict, Field, RootModel, model_validator

from crane_model.configuration import Schema, load
from crane_model.errors import RangeError
from crane_model.joint_tables import of_every_joint
from crane_model.machine import Machine
from crane_trajectory.control.flow_feedforward import BUMP, STOP_RATE
from crane_trajectory.control.interface import ControlCondition, SensorReading, Wanted, conditions

# Decentralized PD control with dead-zone compensation (36): valve commands from tracking errors.
#
#     u = -Kp (q - q_ref) - Kd (q' - q'_ref) + F_f,   limited to [-1, 1]
#
# F_f = d+ max(s, 0) + d- min(s, 0) carries the command across the dead zone (d+ upwards, d-
# downwards) of the valve in the direction s, a continuous number from -1 to 1. With v0 the
# standstill speed and e0 the position tolerance of the joint,
#
# - outside the standstill band, |q'| >= v0: s = sgn(q'), as (36) has it;
# - at standstill, q' = 0: s = q'_ref / v0 - (e beyond its tolerance) / e0, limited to [-1, 1]: the
#   direction in which the reference moves and, where the reference rests, the one that lowers an
#   error e = q - q_ref larger than e0;
# - in between the two are blended smoothly over the measured speed.
#
# So at rest, with the reference at rest and |e| <= e0, F_f = 0 and u = -Kp e is inside the dead
# zone: the valve stays closed and the crane is held still, without a command that switches sign.
# The controller has no state.

DeadZone = Annotated[float, Field(ge=0.0, le=0.99)]
Small = Annotated[float, Field(ge=1e-6, le=1.0)]
T = TypeVar("T")


class JointGains(Schema):
    """Gains of (36) of one joint; units in `controller.yaml`."""

    kp: Annotated[float, Field(ge=1e-6, le=1000.0)]
    kd: Annotated[float, Field(ge=0.0, le=100.0)]
    dead_zone_positive: DeadZone
    dead_zone_negative: DeadZone
    standstill_speed: Small
    position_tolerance: Small

    @model_validator(mode="after")
    def _closed_at_rest(self) -> Self:
        rest = self.kp * self.position_tolerance
        for name in ("dead_zone_positive", "dead_zone_negative"):
            dead_zone = getattr(self, name)
            if 0.0 < dead_zone < rest:
                raise ValueError(
                    f"kp times position_tolerance is {rest:.6g}, more than {name} {dead_zone:.6g}: "
                    "the valve of a crane at rest would be open; lower either of the two"
                )
        return self


class GainFields(NamedTuple, Generic[T]):
    """The fields of `JointGains` for compiled code: numbers of one joint, or arrays of several."""

    kp: T
    kd: T
    dead_zone_positive: T
    dead_zone_negative: T
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
    """(36) of one joint for compiled loops.

    NaN where an input is not finite.
    """
    if not np.isfinite(q - q_ref + velocity - velocity_ref):
        return np.nan
    tolerance = gains.position_tolerance
    error = q - q_ref
    excess = error - min(max(error, -tolerance), tolerance)
    wanted = min(max(velocity_ref / gains.standstill_speed - excess / tolerance, -1.0), 1.0)
    share = min(abs(velocity) / gains.standstill_speed, 1.0)
    moving = share * share * (3.0 - 2.0 * share)
    direction = moving * np.sign(velocity) + (1.0 - moving) * wanted
    dead_zone = gains.dead_zone_positive if direction > 0.0 else gains.dead_zone_negative
    u = -gains.kp * error - gains.kd * (velocity - velocity_ref) + dead_zone * direction
    return min(max(u, -1.0), 1.0)


@njit(cache=True)
def gains_of(gains: GainArrays, i: int) -> GainFields[float]:
    """Those of joint i, for compiled loops."""
    return GainFields(
        kp=gains.kp[i],
        kd=gains.kd[i],
        dead_zone_positive=gains.dead_zone_positive[i],
        dead_zone_negative=gains.dead_zone_negative[i],
        standstill_speed=gains.standstill_speed[i],
        position_tolerance=gains.position_tolerance[i],
    )


@njit(cache=True)
def _commands(
    gains: GainArrays,
    q: np.ndarray,
    velocity: np.ndarray,
    q_ref: np.ndarray,
    velocity_ref: np.ndarray,
) -> np.ndarray:
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


# What of the controller may be changed while the crane moves, without a jump.

BLEND = 1.0  # s, in which new gains take the place of the old
OF_TOLERANCE = 0.1  # of the tracking tolerance: for joints that the model keeps that much nearer


@dataclass(frozen=True, eq=False)
class Tuning:
    """Gains of (36), largest command (0, 1], tracking tolerance (j,) [rad, m]."""

    gains: GainArrays
    saturation: float
    tolerance: np.ndarray

    def tightened(self, by_model: np.ndarray) -> "Tuning":
        """With the tolerances of joints (j,) that the model leads at `OF_TOLERANCE`."""
        share = np.where(by_model, OF_TOLERANCE, 1.0)
        return replace(self, tolerance=share * self.tolerance)


class Blend:
    """A tuning that follows what it is given: gains and saturation linearly within `BLEND`, so that
    the command does not jump; the tolerance, which moves nothing, at once.
    """

    def __init__(self, tuning: Tuning):
        self._old = self._new = tuning
        self._share = 1.0

    def to(self, tuning: Tuning) -> None:
        """Go to `tuning` from what holds now."""
        self._old, self._new, self._share = self.now, tuning, 0.0

    def advance(self, dt: float) -> Tuning:
        """What holds `dt` [s] later."""
        self._share = min(1.0, self._share + dt / BLEND)
        return self.now

    @property
    def now(self) -> Tuning:
        """What holds now."""
        old, new, share = self._old, self._new, self._share
        if share == 1.0:
            return new
        return Tuning(
            GainFields(
                *((1.0 - share) * a + share * b for a, b in zip(old.gains, new.gains, strict=True))
            ),
            (1.0 - share) * old.saturation + share * new.saturation,
            new.tolerance,
        )


# `pd_dead_zone`: the controller (36) of the report behind the interface of all controllers.

SATURATED, FOLLOWING = int(ControlCondition.SATURATED), int(ControlCondition.FOLLOWING)
AT_REST, NOT_MEASURED = int(ControlCondition.AT_REST), int(ControlCondition.NOT_MEASURED)
NOT_INITIALISED = int(ControlCondition.NOT_INITIALISED)  # the first that stops


class PdDeadZone:
    """(36): needs no model, no transducers and no preview."""

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
        """As `Controller` has it."""
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
        """Of each joint, after the last command."""
        return conditions(self._codes)


@njit(cache=True)
def _cycle(
    gains: GainArrays,
    dt: float,
    inputs: np.ndarray,
    largest: float,
    begun: bool,
    u: np.ndarray,
    bump: np.ndarray,
    codes: np.ndarray,
) -> bool:
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
        one = gains_of(gains, i)
        q, velocity, q_ref, velocity_ref = inputs[0, i], inputs[1, i], inputs[2, i], inputs[3, i]
        asked = joint_command(one, q, velocity, q_ref, velocity_ref)
        bump[i] = bump[i] * math.exp(-dt / BUMP) if begun else u[i] - asked
        u[i] = min(max(asked + bump[i], -largest), largest)
        if abs(u[i]) >= largest:
            codes[i] = SATURATED
        else:
            moves = velocity_ref != 0.0 or abs(q_ref - q) > one.position_tolerance
            codes[i] = FOLLOWING if moves else AT_REST
    return True
