"""Resistance near the ends of the range of a joint."""

from collections.abc import Mapping
from types import MappingProxyType
from typing import ClassVar, Literal, Self

import numpy as np
from pydantic import Field
from typing_extensions import override

from crane_model.array import Array, Flags
from crane_model.errors import ConfigurationError
from crane_model.record import Record
from crane_model.terms.effect import Effect, Shape
from crane_model.terms.joint_term import OneJointTerm
from crane_model.terms.term import Family, Parameter, Setting

End = Literal["lower", "upper"]
FLOWS = 2  # laminar and turbulent: parameters of each end


class EndCushioning(OneJointTerm):
    """(f + h |q'|) q' d/zone, with d how deep the joint stands within a `zone` before a limit.

    Cushions throttle the oil on the last part of the stroke: a gap does in proportion to the speed,
    an orifice to its square. Each of the `ends` has f and h of its own; of others nothing is known.
    Limits are those of Table 2.
    """

    type: Literal["end_cushioning"] = "end_cushioning"
    family: ClassVar[Family] = "hydraulics"
    effect: ClassVar[Effect] = Effect(
        "end cushioning",
        "resistance to motion near the ends of the range only",
        ("position_friction",),
        "sweeps into both ends of the range at several speeds",
        follows=("position",),
    )
    shapes: ClassVar[dict[str, Shape]] = {
        "zone": Shape(0.02, 0.3, "rad or m", 6, "length of the zone before each limit")
    }
    former: ClassVar[Mapping[str, str]] = MappingProxyType(
        {"f_e": "each end has a laminar and a turbulent resistance of its own"}
    )

    zone: float = Field(gt=0)
    ends: tuple[End, ...] = Field(default=("lower", "upper"), min_length=1)

    @override
    def joint_parameters(self, setting: Setting) -> tuple[Parameter, ...]:
        if setting.machine is None or self.joint not in setting.machine.limits:
            raise ConfigurationError(
                f"term '{self.type}': needs a machine with limits of joint '{self.joint}'"
            )
        force, coordinate = setting.force_unit(self.joint), setting.units[self.joint]
        laminar, turbulent = f"{force} s/{coordinate}", f"{force} s2/{coordinate}2"
        return tuple(
            one
            for end in self.ends
            for one in (
                Parameter(f"f_{end}", laminar, 0.0, f"viscous resistance at the {end} end"),
                Parameter(f"h_{end}", turbulent, 0.0, f"turbulent resistance at the {end} end"),
            )
        )

    def joint_columns(self, record: Record, setting: Setting, j: int) -> Array:
        """q' d/zone and q'|q'| d/zone of each of the ends: (n, parameters)."""
        assert setting.machine is not None  # parameters() refuses such a model
        limits, q = setting.machine.limits[self.joint], record.position[:, j]
        to_end = {"lower": q - limits.position_min, "upper": limits.position_max - q}
        v = record.velocity[:, j]
        columns = np.empty((len(q), FLOWS * len(self.ends)))
        for k, end in enumerate(self.ends):
            columns[:, FLOWS * k] = v * np.maximum(0.0, 1.0 - to_end[end] / self.zone)
            columns[:, FLOWS * k + 1] = columns[:, FLOWS * k] * np.abs(v)
        return columns

    @override
    def showing(self, shown: Flags) -> Self:
        """Without ends that were not visited; as it is where neither was."""
        visited = np.flatnonzero(shown.reshape(-1, FLOWS).any(axis=1))
        ends = tuple(self.ends[k] for k in visited)
        return self.model_copy(update={"ends": ends}) if ends else self
