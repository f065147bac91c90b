"""What a balance of flow says of valves and oil, beside what is usual of them."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from pydantic import Field

from crane_model.configuration import Schema, load, packaged
from crane_model.flow import FlowTerm
from crane_model.terms import Effect

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
    """A value of the hydraulics with one standard deviation, and the limit of what is usual.

    With that limit in its place, `share` of the piston's flow (rms) more is unexplained, and the
    balance loses the `score` 2 dlogL; both are 0 where the value is usual.
    """

    kind: type[FlowTerm]
    value: float
    std_dev: float
    unit: str
    usual: float
    share: float
    score: float
    missing: bool

    @property
    def type(self) -> str:
        """Name of the effect in the catalogue."""
        return str(self.kind.model_fields["type"].default)

    @property
    def effect(self) -> Effect:
        """What people call it."""
        assert self.kind.effect is not None  # only such terms are quantities
        return self.kind.effect


@dataclass(frozen=True)
class Flow:
    """The hydraulics of one joint, and the share of the piston's flow (rms) left unexplained, with
    the most of it that is usual.
    """

    joint: str
    quantities: tuple[Quantity, ...]
    unexplained: float
    usual: float

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
        return self.unexplained > self.usual and named < EXPLAINED * beyond

    @property
    def _beyond(self) -> tuple[Quantity, ...]:
        found = sorted((q for q in self.quantities if q.missing), key=lambda q: -q.score)
        return tuple(q for q in found if q.share**2 >= FURTHER_SHARE * found[0].share ** 2)
