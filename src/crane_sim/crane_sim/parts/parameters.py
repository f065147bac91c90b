"""Everything that the stand-in machine hides from the identification, from one YAML file."""

from pathlib import Path
from typing import Annotated, Any, Self

import numpy as np
import yaml
from pydantic import Field, model_validator

from crane_model.configuration import NonNegative, Positive, Schema, read_yaml, validate
from crane_model.errors import ConfigurationError
from crane_model.machine import JOINTS, PerJoint
from crane_model.machine_files import machine_file
from crane_model.sensors import SensorChain

Fraction = Annotated[float, Field(ge=0, lt=1)]


class Body(Schema):
    """A rigid body symmetric to the sagittal plane; axes as in `crane_sim.parts.rigid_bodies`."""

    mass: Positive  # kg
    centre_of_mass: tuple[float, float]  # m, along and normal
    principal_inertia: tuple[Positive, Positive, Positive]  # kg m2, along, normal, out of plane

    @model_validator(mode="after")
    def _realizable(self) -> Self:
        smallest, middle, largest = sorted(self.principal_inertia)
        if largest > smallest + middle:
            raise ValueError(
                f"principal_inertia {self.principal_inertia}: the largest may not exceed the sum "
                "of the other two; no mass distribution has these values"
            )
        return self


class CraneBodies(Schema):
    """The five bodies; the gripper is fixed to the telescope."""

    pillar: Body
    inner_boom: Body
    outer_boom: Body
    telescope: Body
    gripper: Body


class CoulombViscous(Schema):
    """Parameters of (13) of one joint [N m, N m s/rad; telescope N, N s/m]."""

    f_c: Positive
    df_c: float
    f_v: Positive
    df_v: float

    @model_validator(mode="after")
    def _dissipates(self) -> Self:
        for mean, difference in (("f_c", "df_c"), ("f_v", "df_v")):
            if abs(getattr(self, difference)) >= getattr(self, mean):
                raise ValueError(
                    f"{difference} = {getattr(self, difference)} must be smaller than "
                    f"{mean} = {getattr(self, mean)}: friction must brake in both directions"
                )
        return self


class Bristles(Schema):
    """What LuGre adds to (13) for one joint."""

    stiffness: Positive  # N m/rad or N/m
    damping: NonNegative  # N m s/rad or N s/m
    breakaway_ratio: Annotated[float, Field(ge=1)]  # breakaway over Coulomb friction
    stribeck_velocity: Positive  # rad/s or m/s


class Edges(Schema):
    """Flow through each metering edge of a valve, over the rated flow, by what the edge joins."""

    supply_a: Positive = 1.0
    a_tank: Positive = 1.0
    supply_b: Positive = 1.0
    b_tank: Positive = 1.0


class StandInValve(Schema):
    """A servo valve: second-order spool, overlap, four metering edges."""

    rated_flow: Positive  # m3/s, fully open
    rated_drop: Positive  # Pa over one metering edge
    natural_frequency: Positive  # Hz
    damping_ratio: Positive
    rate_limit: Positive  # strokes per s
    dead_zone: Fraction  # of the stroke, to either side of the null
    null_bias: float = 0.0  # of the stroke, positive moves the joint up: where the null lies
    edges: Edges = Edges()

    @model_validator(mode="after")
    def _closed_at_rest(self) -> Self:
        if abs(self.null_bias) > self.dead_zone:
            raise ValueError(
                f"null_bias is {self.null_bias}, at most dead_zone, {self.dead_zone}, to either "
                "side: the valve of a centred spool would be open"
            )
        return self


class CylinderInside(Schema):
    """What does not show outside of a cylinder."""

    dead_volume_a: Positive  # m3, with hose
    dead_volume_b: Positive
    leakage: NonNegative  # m3/s/Pa past the piston
    stop_stiffness: Positive  # N/m at the end of the stroke
    stop_damping: NonNegative  # s/m, Hunt and Crossley


class StandInOil(Schema):
    """How stiff the oil is, and below which pressure drop its flow is laminar."""

    bulk_modulus: Positive  # Pa, with hoses and air
    laminar_drop: Positive  # Pa, below it an orifice is laminar


class Supply(Schema):
    """Pump, supply line and relief valve, beside what the machine file says of them."""

    volume: Positive  # m3
    pump_droop: Positive  # Pa from no delivery to all of it
    relief_gain: Positive  # m3/s/Pa
    check_valve_gain: NonNegative  # m3/s/sqrt(Pa), make-up flow into a chamber below tank pressure


class StandIn(Schema):
    """The stand-in machine; geometry, linkages, areas and pump are in the machine file."""

    name: str
    rest_pose: PerJoint[float]  # rad, m
    bodies: CraneBodies
    friction: PerJoint[CoulombViscous]
    dynamic_friction: PerJoint[Bristles] | None = None
    valves: PerJoint[StandInValve]
    cylinders: PerJoint[CylinderInside]
    oil: StandInOil
    supply: Supply
    sensors: SensorChain
    jerk_density: PerJoint[Positive]  # (rad or m)^2/s^5, of the driver's velocity filter
    step: Annotated[float, Field(gt=0, le=5e-4)]  # s

    @property
    def start(self) -> np.ndarray:
        """(4,) the pose in which the crane rests before an experiment [rad, m]."""
        return np.array([self.rest_pose[joint] for joint in JOINTS])


def load_stand_in(path: Path | str | None = None) -> StandIn:
    """The stand-in in `path`, by default with friction (13); `ConfigurationError` if wrong.

    A file with the key `base` (another file, relative to this one) holds only what differs from
    that file; it may not have a base itself.
    """
    path = Path(path or machine_file("stand_in.yaml"))
    content = read_yaml(path)
    if isinstance(content, dict) and "base" in content:
        difference = {key: value for key, value in content.items() if key != "base"}
        base = read_yaml(path.parent / str(content["base"]))
        if not isinstance(base, dict) or "base" in base:
            raise ConfigurationError(
                f"{path}: key 'base': must name a complete stand-in file, one without a base; "
                f"got {content['base']!r}"
            )
        content = _merged(base, difference)
    return validate(content, StandIn, path)


def save_stand_in(path: Path | str, stand_in: StandIn) -> None:
    """As a complete file that `load_stand_in` reads."""
    text = yaml.safe_dump(stand_in.model_dump(mode="json", exclude_none=True), sort_keys=False)
    Path(path).write_text(text, encoding="utf-8")


def _merged(base: dict[str, Any], difference: dict[str, Any]) -> dict[str, Any]:
    """`base` with the values of `difference` in the place of its own, at any depth."""
    merged = dict(base)
    for key, value in difference.items():
        nested = isinstance(value, dict) and isinstance(merged.get(key), dict)
        merged[key] = _merged(merged[key], value) if nested else value
    return merged
