"""The actuators of joints, chosen by `type` in machine files: cylinders, motors, and none.

A new type is one new class, registered by being defined; those of other packages are found by their
entry points `crane_model.actuators`.
"""

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping
from functools import cached_property
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal, NamedTuple, Self

import numpy as np
from pydantic import Field, model_validator

from crane_model import linkages
from crane_model.array import Array
from crane_model.configuration import (
    Direction,
    NonNegative,
    Positive,
    Schema,
    load_entry_points,
    of_type,
)
from crane_model.linkages import FOUR_BAR, PROPORTIONAL, TRIANGLE, Linkage, samples, tabulated

# Pictures of an actuator: lines between pins, in the plane across the joint's axis.
#
# x of the plane is that of the joint's frame, before it moves; the joint is at its origin.


class Bar(NamedTuple):
    """A part between two pins (2,) [m]: a cylinder, or a link."""

    begin: Array
    end: Array
    is_cylinder: bool


def direction(angle: float) -> Array:
    """Unit vector (2,)."""
    return np.array([math.cos(angle), math.sin(angle)])


def meeting(centre: Array, radius: float, other_centre: Array, other_radius: float) -> Array:
    """Intersection of two circles, to the right of the line between them; nan without any."""
    line = other_centre - centre
    distance = math.hypot(*line)
    along = (radius**2 - other_radius**2 + distance**2) / (2.0 * distance)
    square = radius**2 - along**2
    across = math.sqrt(square) if square >= 0.0 else math.nan
    unit = line / distance
    found: Array = centre + along * unit + across * np.array([unit[1], -unit[0]])
    return found


TABLE_POINTS = 501  # places; quintic between them, errors fall with the sixth power

ACTUATOR_TYPES: dict[str, type["Actuator"]] = {}


class Actuator(Schema, ABC):
    """Actuator of a joint: its own coordinate x(q), and so its force F as tau = dx/dq F (18).

    A subclass gives its `type` in machine files and is registered by being defined. x is a length
    [m] if it pushes, an angle [rad] if it turns. `has_chambers` if F follows from two pressures
    (19): then it is a `HydraulicActuator`; `has_rotor` if it is a motor that turns with x = gear
    ratio times q; not `drives` if the joint is passive; `bounded_by_pins` if it is a cylinder whose
    length runs from pin to pin.
    """

    type: str
    has_chambers: ClassVar[bool] = False
    has_rotor: ClassVar[bool] = False
    drives: ClassVar[bool] = True
    bounded_by_pins: ClassVar[bool] = False

    @classmethod
    def __pydantic_init_subclass__(cls, **kwargs: Any) -> None:
        name = cls.model_fields["type"].default
        if isinstance(name, str):  # a base class has none
            ACTUATOR_TYPES[name] = cls

    @abstractmethod
    def motion(self, q: Array) -> Array:
        """(n,) coordinates of the joint to (n, 3): x, dx/dq, d2x/dq2; nan where it cannot be."""

    def linkage(self, low: float, high: float) -> Linkage:
        """The same for compiled code, from `low` to `high`: here, of a class of one's own."""
        return tabulated(low, high, self.motion(np.linspace(low, high, TABLE_POINTS)))

    def bars(self, q: float) -> tuple[Bar, ...]:
        """Bars that pictures show; none if it is within the joint."""
        return ()

    def check(self, low: float, high: float) -> None:
        """`ValueError` unless it can drive its joint from `low` to `high`."""
        return


class BuiltIn(Actuator):
    """An actuator that `crane_model.linkages` has compiled."""

    @property
    @abstractmethod
    def compiled(self) -> Linkage:
        """Its kind and constants there."""

    def motion(self, q: Array) -> Array:
        return samples(*self.compiled, q)

    def linkage(self, low: float, high: float) -> Linkage:
        """Exact, wherever it is."""
        return self.compiled


def proportional(ratio: float) -> Linkage:
    """x = `ratio` q."""
    return Linkage(PROPORTIONAL, np.array([ratio]))


def actuator_from_mapping(content: Mapping[str, Any] | Actuator) -> Actuator:
    """The actuator that an entry of a machine file describes; ValueError as pydantic wants it."""
    if isinstance(content, Actuator):
        return content
    return of_type(content, ACTUATOR_TYPES, "actuator", "those of installed packages included")


# Common parts of hydraulic actuators: two chambers, their areas, and the range of x.

MIN_LEVER_ARM = 0.02  # m/rad, or 1; below it a cylinder cannot move its joint


class Chambers(NamedTuple):
    """How the volumes of both chambers grow with x, beyond the dead ones."""

    growth_a: float  # m2
    growth_b: float
    empty_a: float  # m, x at which nothing but the dead volume is left
    empty_b: float

    @property
    def grow(self) -> bool:
        return self.growth_a > 0.0

    def swept(self, x: Array) -> tuple[Array, Array]:
        """Volumes (n,) [m3] of A and B at x (n,)."""
        return self.growth_a * (x - self.empty_a), self.growth_b * (self.empty_b - x)


class HydraulicActuator(Actuator):
    """F = A_A p_A - A_B p_B (19); areas are those of all chambers A, and of all B, together.

    `pressure_sensors` says whether both pressures are measured.
    """

    has_chambers = True
    pressure_sensors: bool

    @property
    @abstractmethod
    def area_a(self) -> float:
        """dV_A/dx [m2; m3/rad where it turns]."""

    @property
    @abstractmethod
    def area_b(self) -> float:
        """-dV_B/dx [m2; m3/rad where it turns]."""

    @property
    def chambers(self) -> Chambers:
        return Chambers(self.area_a, self.area_b, self.length_min, self.length_max)

    if TYPE_CHECKING:  # fields of cylinders

        @property
        def length_min(self) -> float:
            """Least x [m; rad where it turns]."""

        @property
        def length_max(self) -> float:
            """Largest x [m; rad where it turns]."""


class CylinderActuator(HydraulicActuator):
    """`count` equal cylinders side by side: areas of each one's chambers, range of its length."""

    area_a_of_one: Positive = Field(alias="area_a")  # m2
    area_b_of_one: Positive = Field(alias="area_b")  # m2
    count: Annotated[int, Field(ge=1)] = 1
    length_min: float
    length_max: float

    @property
    def area_a(self) -> float:
        return self.count * self.area_a_of_one

    @property
    def area_b(self) -> float:
        return self.count * self.area_b_of_one

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        if not self.length_min < self.length_max:
            raise ValueError(
                f"length_min {self.length_min} must be below length_max {self.length_max}"
            )
        return self

    def check(self, low: float, high: float) -> None:
        """The loop closes, the lever arm keeps its sign and the stroke suffices."""
        if self.bounded_by_pins and high - low >= 2.0 * math.pi:
            raise ValueError(
                f"they span {high - low:.3g} rad, but no linkage goes all the way round; are they "
                "in degrees?"
            )
        grid = np.linspace(low, high, 201)
        x, lever, _ = self.motion(grid).T
        if np.isnan(lever).any():
            q = grid[np.isnan(lever)][0]
            raise ValueError(f"the loop does not close at q = {q:.4g} rad")
        if np.abs(lever).min() < MIN_LEVER_ARM or np.ptp(np.sign(lever)) > 0:
            least = np.abs(lever).argmin()
            raise ValueError(
                f"the lever arm must keep its sign and exceed {MIN_LEVER_ARM} m, "
                f"got {lever[least]:.4g} m at q = {grid[least]:.4g} rad"
            )
        if x.min() < self.length_min or x.max() > self.length_max:
            raise ValueError(
                f"the cylinder's length must stay within [{self.length_min}, {self.length_max}] m, "
                f"but runs from {x.min():.4f} to {x.max():.4f} m"
            )


class DirectCylinder(BuiltIn, CylinderActuator):
    """x = `ratio` q: 1 for a telescope, 0.5 where a chain makes the joint go twice as far."""

    type: Literal["direct_cylinder"] = "direct_cylinder"
    ratio: Positive = 1.0

    @property
    def compiled(self) -> Linkage:
        return proportional(self.ratio)


class FourBarCylinder(BuiltIn, CylinderActuator):
    """The four-bar linkage of (21)-(26) [m, rad]; letters as in `crane_model.linkages`.

    Extending lowers q; where it raises q, the linkage is `mirrored`: x(-q) of the same lengths.
    `pin_rise` is the direction of the cylinder's base seen from the joint, for pictures alone.
    """

    bounded_by_pins = True
    type: Literal["four_bar_cylinder"] = "four_bar_cylinder"
    s22: Positive
    s23: Positive
    c1: Positive
    c2: Positive
    s31: Positive
    s32: Positive
    beta_1: Direction
    gamma_25: Direction
    pin_rise: Direction
    mirrored: bool = False

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

    @property
    def compiled(self) -> Linkage:
        lengths = self.s22, self.s23, self.c1, self.c2, self.s31
        sense = -1.0 if self.mirrored else 1.0
        return Linkage(FOUR_BAR, np.array([self.gamma_21_0, self.gamma_32, *lengths, sense]))

    def bars(self, q: float) -> tuple[Bar, ...]:
        """The cylinder from its base B to the eye K, and the links from there to P and R."""
        sense = -1.0 if self.mirrored else 1.0
        to_rocker = math.pi - self.pin_rise + self.gamma_32
        base = self.s31 * direction(math.pi - self.pin_rise)
        rocker = self.s23 * direction(to_rocker)
        lever = self.s22 * direction(to_rocker - self.gamma_21_0 + sense * q)
        eye = meeting(lever, self.c1, rocker, self.c2)
        pins = [np.array([1.0, sense]) * pin for pin in (base, eye, lever, rocker)]
        return (
            Bar(pins[0], pins[1], True),
            Bar(pins[1], pins[2], False),
            Bar(pins[1], pins[3], False),
        )


class TriangleCylinder(BuiltIn, CylinderActuator):
    """The triangle of (20) between the joint and the cylinder's two pins [m, rad].

    In the plane across the joint's axis: the pin on the link before lies `j1` from the joint,
    `phi_4` from minus y of the joint's frame; the pin on the link itself `j2` from the joint,
    `phi_3` from x of the frame that turns with it. Both angles count the joint's way round.
    """

    bounded_by_pins = True
    type: Literal["triangle_cylinder"] = "triangle_cylinder"
    j1: Positive
    j2: Positive
    phi_3: Direction
    phi_4: Direction

    @property
    def compiled(self) -> Linkage:
        return Linkage(TRIANGLE, np.array([self.j1, self.j2, self.angle_0]))

    @property
    def angle_0(self) -> float:
        """The constant part of the angle in (20)."""
        return math.pi / 2 - self.phi_4 + self.phi_3

    def bars(self, q: float) -> tuple[Bar, ...]:
        base = self.j1 * direction(self.phi_4 - math.pi / 2)
        return (Bar(base, self.j2 * direction(self.phi_3 + q), True),)


class RackAndPinion(BuiltIn, CylinderActuator):
    """x = `rack_radius` q [m], 0 in the middle of the rack; areas as of a piston on either end."""

    type: Literal["rack_and_pinion"] = "rack_and_pinion"
    rack_radius: Positive  # m, of the pinion

    @property
    def compiled(self) -> Linkage:
        return proportional(self.rack_radius)


class ElectricDrive(BuiltIn):
    """x = `gear_ratio` q, the rotor's angle [rad]; a negative ratio reverses."""

    has_rotor = True
    type: Literal["electric_drive"] = "electric_drive"
    gear_ratio: float  # rad of the rotor per rad or m of the joint
    rotor_inertia: NonNegative | None = None  # kg m2, where the data sheet gives it
    largest_torque: Positive | None = None  # N m of the motor

    @property
    def compiled(self) -> Linkage:
        return proportional(self.gear_ratio)


class RotaryMotor(BuiltIn, HydraulicActuator):
    """x = `gear_ratio` q [rad] of the motor's shaft; its torque is `displacement` (p_A - p_B)."""

    has_rotor = True
    type: Literal["rotary_motor"] = "rotary_motor"
    displacement: Positive  # m3/rad
    gear_ratio: Positive = 1.0  # turns of the motor a turn of the joint

    @property
    def compiled(self) -> Linkage:
        return proportional(self.gear_ratio)

    @property
    def area_a(self) -> float:
        return self.displacement

    @property
    def area_b(self) -> float:
        return self.displacement

    @property
    def chambers(self) -> Chambers:
        return Chambers(0.0, 0.0, 0.0, 0.0)

    @property
    def length_min(self) -> float:
        return -math.inf

    @property
    def length_max(self) -> float:
        return math.inf


class Passive(BuiltIn):
    """Nothing drives the joint, or nothing is known of what does: x = q."""

    drives = False
    type: Literal["passive"] = "passive"

    @property
    def compiled(self) -> Linkage:
        return proportional(1.0)


load_entry_points("crane_model.actuators", ACTUATOR_TYPES, "an actuator")
