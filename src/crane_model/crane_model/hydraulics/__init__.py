"""The identified hydraulics of a machine: section `hydraulics` of the model file.

The equations that the values belong to are in `crane_model.hydraulics.stepping`.
"""

from typing import Annotated, ClassVar, Self

from pydantic import Field, model_validator

from crane_model.configuration import NonNegative, Schema

GAIN_UNIT = "m3/(s Pa^0.5)"
MIN_SPOOL_LAG_S = 1e-4  # the lag of a spool that cannot be told from none


class Measured(Schema):
    """A value with one standard deviation; without one it was assumed, not measured."""

    value: float
    std_dev: NonNegative | None = None
    unit: str


class _Values(Schema):
    """Values by name, each in the unit that its name has."""

    units: ClassVar[dict[str, str]]

    @model_validator(mode="after")
    def _in_their_units(self) -> Self:
        for name, measured in self.by_name.items():
            unit = self.units[name]
            if measured.unit != unit:
                raise ValueError(f"{name}: its unit must be {unit!r}, got {measured.unit!r}")
            low, high = _RANGES.get(name, (0.0, float("inf")))
            if not low <= measured.value <= high:
                raise ValueError(
                    f"{name}: must be {low:g} to {high:g} {unit}, got {measured.value:g}"
                )
        return self

    @property
    def by_name(self) -> dict[str, Measured]:
        return {name: getattr(self, name) for name in self.units}


_RANGES = {"dead_band_a": (0.0, 0.9), "dead_band_b": (0.0, 0.9), "hysteresis": (0.0, 1.0)}


class ValveValues(_Values):
    """Values of the valve: see `spool` for each.

    `lag` is `delay` + `spool_lag`, by which the spool follows a slow command late: it is known far
    better than either. `spool_lag` is 2 D/w, as far as the lag allows. Gains are those of the
    metering edges, by what an edge joins.
    """

    units: ClassVar[dict[str, str]] = {
        "dead_band_a": "1",
        "dead_band_b": "1",
        "hysteresis": "1",
        "lag": "s",
        "natural_frequency": "rad/s",
        "damping_ratio": "1",
        "supply_a": GAIN_UNIT,
        "a_tank": GAIN_UNIT,
        "supply_b": GAIN_UNIT,
        "b_tank": GAIN_UNIT,
    }

    dead_band_a: Measured
    dead_band_b: Measured
    hysteresis: Measured
    lag: Measured
    natural_frequency: Measured
    damping_ratio: Measured
    supply_a: Measured
    a_tank: Measured
    supply_b: Measured
    b_tank: Measured

    @property
    def spool_lag(self) -> float:
        """Delay of the spool behind its command [s]: no longer than the whole valve's."""
        slow = 2.0 * self.damping_ratio.value / self.natural_frequency.value
        return min(slow, max(self.lag.value, MIN_SPOOL_LAG_S))

    @property
    def spool_frequency(self) -> float:
        """The natural frequency [rad/s] that makes the spool lag by `spool_lag`."""
        return 2.0 * self.damping_ratio.value / self.spool_lag

    @property
    def delay(self) -> float:
        """From the stamp of a command until the spool is told [s]."""
        return max(0.0, self.lag.value - self.spool_lag)


class ChamberValues(_Values):
    """Values of oil and cylinder: see `chambers` for each."""

    units: ClassVar[dict[str, str]] = {
        "bulk_modulus": "Pa",
        "dead_volume_a": "m3",
        "dead_volume_b": "m3",
        "leakage": "m3/(s Pa)",
    }

    bulk_modulus: Measured
    dead_volume_a: Measured
    dead_volume_b: Measured
    leakage: Measured


class SupplyValues(_Values):
    """Values of the supply of all valves: p_S = pressure - droop times the flow drawn from it."""

    units: ClassVar[dict[str, str]] = {"pressure": "Pa", "droop": "Pa s/m3"}

    pressure: Measured
    droop: Measured


class JointHydraulics(Schema):
    """Valve and chambers of a joint.

    `undetermined` names the values that recordings did not tell, each with the experiment that
    would. `unexplained` is the share of the piston's flow (rms) beside these equations, and
    `lack_of_fit` how likely noise alone leaves as much (None: no period was repeated).
    A joint without pressure transducers has no `chambers`: its gains are those at no load.
    """

    units: ClassVar[dict[str, str]] = ValveValues.units | ChamberValues.units

    valve: ValveValues
    chambers: ChamberValues | None = None
    undetermined: dict[str, str] = {}
    unexplained: NonNegative
    lack_of_fit: Annotated[float, Field(ge=0, le=1)] | None = None

    @property
    def values(self) -> dict[str, Measured]:
        return self.valve.by_name | (self.chambers.by_name if self.chambers else {})


class HydraulicValues(Schema):
    """The hydraulics of a machine, where they are known, and where that is known from."""

    provenance: str
    joints: dict[str, JointHydraulics]
    supply: SupplyValues | None = None
    unknown: dict[str, str] = {}
    """Joints, or the supply, of which nothing could be told, and why."""
