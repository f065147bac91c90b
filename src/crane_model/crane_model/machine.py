"""The machine: Table 1, Table 2, linkages, areas and pump, from one validated YAML file."""

import math
from collections.abc import Mapping
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any, Generic, Self, SupportsIndex, TypeVar

import numpy as np
from pydantic import Field, model_validator

from crane_model import linkages
from crane_model.array import Array
from crane_model.configuration import Positive, Schema, load
from crane_model.errors import RangeError
from crane_model.machine_files import machine_file

JOINTS = ("slew", "inner_boom", "outer_boom", "telescope")
PLANAR_JOINTS = JOINTS[1:]
JOINT_UNITS = {"slew": "rad", "inner_boom": "rad", "outer_boom": "rad", "telescope": "m"}

SMALLEST_LEVER_ARM = 0.02  # m; below it a cylinder cannot turn its joint

Entry = TypeVar("Entry", bound=Schema | float)


class PerJoint(Schema, Generic[Entry]):
    """One entry a joint."""

    slew: Entry
    inner_boom: Entry
    outer_boom: Entry
    telescope: Entry

    def __getitem__(self, joint: str) -> Entry:
        entry: Entry = getattr(self, joint)
        return entry

    def __reduce_ex__(self, protocol: SupportsIndex) -> Any:
        """A class such as `PerJoint[float]` is in no module, where pickle looks for classes."""
        kinds = type(self).__pydantic_generic_metadata__["args"]
        return (_per_joint, (*kinds, dict(self))) if kinds else super().__reduce_ex__(protocol)

    def array(self, key: str) -> np.ndarray:
        """(4,) the value `key` of every entry, in the order of JOINTS."""
        return np.array([getattr(self[joint], key) for joint in JOINTS], dtype=float)


def _per_joint(kind: Any, entries: dict[str, Any]) -> Any:
    return PerJoint[kind](**entries)


class DenavitHartenberg(Schema):
    """The constants of Table 1 [m, rad]."""

    base_height: Positive
    theta_2_0: float
    inner_boom_length: Positive
    telescope_offset: float
    telescope_length: Positive

    @cached_property
    def table(self) -> Array:
        """(4, 4): theta offset, d offset, a, alpha of each link, to which q is added (Table 1)."""
        half = math.pi / 2
        return np.array(
            [
                [0.0, self.base_height, 0.0, half],
                [self.theta_2_0, 0.0, self.inner_boom_length, 0.0],
                [half - self.theta_2_0, 0.0, self.telescope_offset, half],
                [0.0, self.telescope_length, 0.0, 0.0],
            ]
        )


class JointLimits(Schema):
    """A row of Table 2 [rad or m, and per s]."""

    position_min: float
    position_max: float
    velocity_min: Annotated[float, Field(lt=0)]
    velocity_max: Positive

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        if not self.position_min < self.position_max:
            raise ValueError(
                f"position_min {self.position_min} must be below position_max {self.position_max}"
            )
        return self


class InnerBoomLinkage(Schema):
    """Fig. 5: the triangle of (20) [m, rad]."""

    j1: Positive
    j2: Positive
    phi_3: float
    phi_4: float

    def cylinder(self, q: Array) -> Array:
        """(n,) q2 to (n, 3): x2, dx2/dq2, d2x2/dq2^2 (20) [m, rad]."""
        return linkages.inner_boom_samples(q, self.j1, self.j2, self.angle_0)

    @property
    def angle_0(self) -> float:
        """The constant part of the angle in (20)."""
        return math.pi / 2 - self.phi_4 + self.phi_3


class OuterBoomLinkage(Schema):
    """Figs. 6-7: the four-bar linkage of (21)-(26) [m, rad]."""

    s22: Positive
    s23: Positive
    c1: Positive
    c2: Positive
    s31: Positive
    s32: Positive
    beta_1: float
    gamma_25: float
    pin_rise: float

    @model_validator(mode="after")
    def _triangle(self) -> Self:
        if not abs(self.s31 - self.s23) < self.s32 < self.s31 + self.s23:
            raise ValueError(
                f"s31 = {self.s31}, s23 = {self.s23} and s32 = {self.s32} must form a triangle: "
                f"s32 between {abs(self.s31 - self.s23):.6g} and {self.s31 + self.s23:.6g}"
            )
        return self

    @property
    def gamma_21_0(self) -> float:
        """The constant part of (21)."""
        return math.pi / 2 - self.beta_1 + self.gamma_25

    @cached_property
    def gamma_32(self) -> float:
        """(26), with the two lengths in their places."""
        return linkages.gamma_32(self.s31, self.s23, self.s32)

    def cylinder(self, q: Array) -> Array:
        """(n,) q3 to (n, 3): x3, dx3/dq3, d2x3/dq3^2 (24) [m, rad]."""
        return linkages.outer_boom_samples(
            q, self.gamma_21_0, self.gamma_32, self.s22, self.s23, self.c1, self.c2, self.s31
        )


class HydraulicCylinder(Schema):
    """Areas of chambers A and B [m2] and the range of the length [m]."""

    area_a: Positive
    area_b: Positive
    length_min: float
    length_max: float
    pressure_sensors: bool
    rack_radius: Positive | None = None

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        if not self.length_min < self.length_max:
            raise ValueError(
                f"length_min {self.length_min} must be below length_max {self.length_max}"
            )
        return self


class Cylinders(PerJoint[HydraulicCylinder]):
    """One cylinder a joint; the slew drive is a rack on a pinion of `rack_radius`."""

    @model_validator(mode="after")
    def _rack(self) -> Self:
        if self.slew.rack_radius is None:
            raise ValueError("slew: rack_radius [m] is missing; the slew cylinder needs it")
        return self


class Hydraulics(Schema):
    """Supply of all cylinders [Pa gauge, m3/s]."""

    supply_pressure: Positive
    relief_pressure: Positive
    tank_pressure: Annotated[float, Field(ge=0)]
    pump_flow: Positive


WEIGHED = ("S_FL_along", "S_SL_along", "m_TL")
"""Base parameters that gravity shows: mass moments of the two booms, mass of the telescope."""


class Machine(Schema):
    """Everything about the crane that is known before anything is identified."""

    name: str
    gravity: Positive
    denavit_hartenberg: DenavitHartenberg
    limits: PerJoint[JointLimits]  # Table 2
    inner_boom_linkage: InnerBoomLinkage
    outer_boom_linkage: OuterBoomLinkage
    cylinders: Cylinders
    hydraulics: Hydraulics
    plausible: dict[str, tuple[float, float]] = {}
    """[least, most] of masses [kg] and moments [kg m] without a load, to check recordings."""

    @property
    def joint_names(self) -> tuple[str, ...]:
        """The joints from the base to the tip."""
        return JOINTS

    @property
    def units(self) -> Mapping[str, str]:
        """Unit of each joint's coordinate: rad or m."""
        return JOINT_UNITS

    def index(self, joint: str) -> int:
        """Place of a joint in `joint_names`; `RangeError` if there is no such joint."""
        if joint not in self.joint_names:
            raise RangeError(
                f"{self.name}: no joint '{joint}'; the joints are {', '.join(self.joint_names)}"
            )
        return self.joint_names.index(joint)

    def cylinder(self, joint: str, q: Array) -> Array:
        """(n,) coordinates of `joint` to (n, 3): cylinder length x, dx/dq, d2x/dq2."""
        q = np.ascontiguousarray(q, dtype=float)
        if joint == "inner_boom":
            return self.inner_boom_linkage.cylinder(q)
        if joint == "outer_boom":
            return self.outer_boom_linkage.cylinder(q)
        radius = 1.0 if joint == "telescope" else self.cylinders.slew.rack_radius
        assert radius is not None  # the slew drive has one
        return np.stack([radius * q, np.full_like(q, radius), np.zeros_like(q)], axis=1)

    @model_validator(mode="after")
    def _plausible_ranges(self) -> Self:
        if unknown := self.plausible.keys() - set(WEIGHED):
            raise ValueError(
                f"plausible {', '.join(sorted(unknown))}: must be of {', '.join(WEIGHED)}"
            )
        for name, (low, high) in self.plausible.items():
            if not 0.0 < low < high:
                raise ValueError(f"plausible {name}: must be 0 < least < most, got [{low}, {high}]")
        return self

    @model_validator(mode="after")
    def _linkages_cover_table_2(self) -> Self:
        """The loop closes, the lever arm keeps its sign and the stroke suffices over Table 2."""
        for joint in JOINTS:
            limits, cylinder = self.limits[joint], self.cylinders[joint]
            grid = np.linspace(limits.position_min, limits.position_max, 201)
            x, lever = self.cylinder(joint, grid)[:, :2].T
            where = f"linkage of {joint} over its range of Table 2"
            if np.isnan(lever).any():
                q = grid[np.isnan(lever)][0]
                raise ValueError(f"{where}: the loop does not close at q = {q:.4g} rad")
            if np.abs(lever).min() < SMALLEST_LEVER_ARM or np.ptp(np.sign(lever)) > 0:
                q = grid[np.abs(lever).argmin()]
                raise ValueError(
                    f"{where}: the lever arm must keep its sign and exceed "
                    f"{SMALLEST_LEVER_ARM} m, got {lever[np.abs(lever).argmin()]:.4g} m "
                    f"at q = {q:.4g} rad"
                )
            if x.min() < cylinder.length_min or x.max() > cylinder.length_max:
                raise ValueError(
                    f"{where}: the cylinder's length must stay within "
                    f"[{cylinder.length_min}, {cylinder.length_max}] m, "
                    f"but runs from {x.min():.4f} to {x.max():.4f} m"
                )
        return self


def load_machine(machine: Path | str | None = None) -> Machine:
    """A shipped machine by its name, or that of a folder or file; `ConfigurationError` if wrong.

    By default it is the laboratory crane.

    >>> load_machine().limits["telescope"].position_max  # m
    1.55
    """
    return load(machine_file("machine.yaml", machine), Machine)
