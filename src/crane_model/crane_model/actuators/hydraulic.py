"""What hydraulic actuators share: two chambers, their areas, and the range of x."""

import math
from abc import abstractmethod
from typing import TYPE_CHECKING, Annotated, ClassVar, NamedTuple, Self

import numpy as np
from pydantic import Field, model_validator

from crane_model.actuators.actuator import Actuator
from crane_model.array import Array
from crane_model.configuration import Positive

SMALLEST_LEVER_ARM = 0.02  # m/rad, or 1; below it a cylinder cannot move its joint


class Chambers(NamedTuple):
    """How the volumes of both chambers grow with x, beyond the dead ones."""

    growth_a: float  # m2
    growth_b: float
    empty_a: float  # m, x at which nothing but the dead volume is left
    empty_b: float

    @property
    def grow(self) -> bool:
        """Whether they do at all."""
        return self.growth_a > 0.0

    def swept(self, x: Array) -> tuple[Array, Array]:
        """Volumes (n,) [m3] of A and B at x (n,)."""
        return self.growth_a * (x - self.empty_a), self.growth_b * (self.empty_b - x)


class HydraulicActuator(Actuator):
    """F = A_A p_A - A_B p_B (19); areas are those of all chambers A, and of all B, together.

    `pressure_sensors` says whether both pressures are measured.
    """

    has_chambers: ClassVar[bool] = True
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
        """How they grow as the piston goes."""
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
        """Of all cylinders together [m2]."""
        return self.count * self.area_a_of_one

    @property
    def area_b(self) -> float:
        """Of all cylinders together [m2]."""
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
        if np.abs(lever).min() < SMALLEST_LEVER_ARM or np.ptp(np.sign(lever)) > 0:
            least = np.abs(lever).argmin()
            raise ValueError(
                f"the lever arm must keep its sign and exceed {SMALLEST_LEVER_ARM} m, "
                f"got {lever[least]:.4g} m at q = {grid[least]:.4g} rad"
            )
        if x.min() < self.length_min or x.max() > self.length_max:
            raise ValueError(
                f"the cylinder's length must stay within [{self.length_min}, {self.length_max}] m, "
                f"but runs from {x.min():.4f} to {x.max():.4f} m"
            )
