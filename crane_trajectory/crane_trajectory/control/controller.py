"""Decentralized PD control with dead-zone compensation (36): valve commands from tracking errors.

    u = -Kp (q - q_ref) - Kd (q' - q'_ref) + F_f,   limited to [-1, 1]

F_f = d+ max(s, 0) + d- min(s, 0) carries the command across the dead zone (d+ upwards, d-
downwards) of the valve in the direction s, a continuous number from -1 to 1. With v0 the
standstill speed and e0 the position tolerance of the joint,

- outside the standstill band, |q'| >= v0: s = sgn(q'), as (36) has it;
- at standstill, q' = 0: s = q'_ref / v0 - (e beyond its tolerance) / e0, limited to [-1, 1]: the
  direction in which the reference moves and, where the reference rests, the one that lowers an
  error e = q - q_ref larger than e0;
- in between the two are blended smoothly over the measured speed.

So at rest, with the reference at rest and |e| <= e0, F_f = 0 and u = -Kp e is inside the dead zone:
the valve stays closed and the crane is held still, without a command that switches sign. The
controller has no state.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Generic, NamedTuple, Self, TypeVar

import numpy as np
from numba import njit
from pydantic import ConfigDict, Field, RootModel, model_validator

from crane_model.configuration import Schema, load
from crane_model.errors import RangeError
from crane_model.joint_tables import of_every_joint
from crane_model.machine import Machine

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
