"""What a balance of flow says of valves and oil, beside what is usual of them."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, NamedTuple

from pydantic import Field

from crane_model.configuration import Schema, load, packaged
from crane_model.flow import FLOW_EFFECTS
from crane_model.terms import Effect

SIGMAS = 3.0  # by which a value must lie outside of what is usual
LAW = 0.4
"""Correlation of neighbouring rows from which what is left is a law; filtered noise has 0.2."""
FURTHER_SHARE = 0.05  # of the energy that the strongest explains, at least of a further one
EXPLAINED = 0.7  # of the energy beyond the usual must be named, or what is there is unknown
Positive = Annotated[float, Field(gt=0)]


class Usual(Schema):
    """What is usual of valves and oil; `hydraulics.yaml` says what each is."""

    dead_zone: dict[str, Positive]
    hysteresis: Positive
    asymmetry: Positive
    leakage: Positive
    bulk_modulus: Positive
    smallest_share: Positive
    unexplained: Positive


def load_usual(path: Path | None = None) -> Usual:
    """The packaged values, or those of a file; `ConfigurationError` names what is wrong in it."""
    return load(path or packaged("crane_identification", "hydraulics.yaml"), Usual)


@dataclass(frozen=True)
class Quantity:
    """A value of the hydraulics with one standard deviation, and the limit of what is usual; `type`
    is its name in FLOW_EFFECTS.

    With that limit in its place, `share` of the piston's flow (rms) more is unexplained, and the
    balance loses the `score` 2 dlogL; both are 0 where the value is usual.
    """

    type: str
    value: float
    std_dev: float
    usual: float
    share: float
    score: float
    missing: bool

    @property
    def effect(self) -> Effect:
        """What people call it."""
        return FLOW_EFFECTS[self.type].effect

    @property
    def unit(self) -> str:
        """Of the value."""
        return FLOW_EFFECTS[self.type].unit

    @property
    def determined(self) -> bool:
        """Whether the recordings tell a usual value from one that is not."""
        return SIGMAS * self.std_dev <= max(abs(self.value), self.usual)


class Gain(NamedTuple):
    """Gain of a metering edge with one standard deviation [m3/(s Pa^0.5)]."""

    edge: str
    value: float
    std_dev: float

    @property
    def determined(self) -> bool:
        """Whether the edge was used enough to tell."""
        return abs(self.value) >= SIGMAS * self.std_dev


@dataclass(frozen=True)
class Flow:
    """The hydraulics of one joint, and the share of the piston's flow (rms) left unexplained, with
    the most of it that is usual, and the correlation of neighbouring rows of it.

    `quantities` is empty where too much is left for any value to be good. All that the balance
    needs is `known` for that time [s] of what was `recorded`.
    """

    joint: str
    quantities: tuple[Quantity, ...]
    gains: tuple[Gain, ...]
    unexplained: float
    usual: float
    correlation: float
    known: float
    recorded: float

    @property
    def undetermined(self) -> tuple[str, ...]:
        """What the recordings do not tell, as people call it."""
        edges = (f"gain of the edge {one.edge}" for one in self.gains if not one.determined)
        return (*edges, *(one.effect.name for one in self.quantities if not one.determined))

    @property
    def missing(self) -> tuple[Quantity, ...]:
        """What is not as usual, strongest first; nothing where that is `unknown`.

        A law that is not quite its own takes others along: they explain little beside it.
        """
        return () if self.unknown else self._beyond

    @property
    def unknown(self) -> bool:
        """Whether most of what is left has a law that is none of the quantities'."""
        named = sum(one.share**2 for one in self._beyond)
        beyond = named + self.unexplained**2
        law = self.unexplained > self.usual and self.correlation >= LAW
        return law and named < EXPLAINED * beyond

    @property
    def _beyond(self) -> tuple[Quantity, ...]:
        found = sorted((q for q in self.quantities if q.missing), key=lambda q: -q.score)
        return tuple(q for q in found if q.share**2 >= FURTHER_SHARE * found[0].share ** 2)
