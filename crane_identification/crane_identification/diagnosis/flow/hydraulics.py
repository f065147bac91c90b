"""What a balance of flow says of valves and oil, beside what is usual of them."""

from dataclasses import dataclass
from typing import NamedTuple

from crane_identification.thresholds import Method
from crane_model.flow import FLOW_EFFECTS
from crane_model.terms import Effect


@dataclass(frozen=True)
class Quantity:
    """A value of the hydraulics with one standard deviation, and the limit of what is usual, which
    is the machine's `own` where it was identified; `type` is its name in FLOW_EFFECTS. Of what
    changes `along_stroke`, it is the mean.

    With that limit in its place, `share` of the piston's flow (rms) more is unexplained, and the
    balance loses the `score` 2 dlogL; both are 0 where the value is usual. It is `determined` where
    the recordings tell a usual value from one that is not.
    """

    type: str
    value: float
    std_dev: float
    usual: float
    own: bool
    determined: bool
    share: float = 0.0
    score: float = 0.0
    missing: bool = False
    along_stroke: bool = False

    @property
    def limit(self) -> str:
        """What the limit is of, in words."""
        return "what was identified of it" if self.own else "what is usual"

    @property
    def effect(self) -> Effect:
        """What people call it."""
        return FLOW_EFFECTS[self.type].effect

    @property
    def unit(self) -> str:
        """Of the value."""
        return FLOW_EFFECTS[self.type].unit


class Gain(NamedTuple):
    """Gain of a metering edge with one standard deviation [m3/(s Pa^0.5)], and whether the edge was
    used enough to tell.
    """

    edge: str
    value: float
    std_dev: float
    determined: bool


@dataclass(frozen=True)
class Flow:
    """The hydraulics of one joint, and the share of the piston's flow (rms) left unexplained, with
    the most of it that is `usual`, the correlation of neighbouring rows of it, and the share of its
    energy that `air` in the oil would explain.

    `quantities` is empty where too much is left for any value to be good. All that the balance
    needs is `known` for that time [s] of what was `recorded`. `method`: what of it counts.
    """

    joint: str
    quantities: tuple[Quantity, ...]
    gains: tuple[Gain, ...]
    unexplained: float
    usual: float
    correlation: float
    air: float
    known: float
    recorded: float
    method: Method

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
        beyond, method = named + self.unexplained**2, self.method
        # air acts in moments that are too short for neighbouring rows to be alike
        law = self.correlation >= method.flow_law_correlation or self.airy
        return law and self.unexplained > self.usual and named < method.flow_named_share * beyond

    @property
    def worn(self) -> bool:
        """Whether the leakage changes along the stroke, as of a piston that is worn."""
        return any(one.along_stroke for one in self.quantities)

    @property
    def airy(self) -> bool:
        """Whether air in the oil would explain most of what is left."""
        return self.air > self.method.flow_named_share

    @property
    def _beyond(self) -> tuple[Quantity, ...]:
        found = sorted((q for q in self.quantities if q.missing), key=lambda q: -q.score)
        least = self.method.flow_further_share
        return tuple(q for q in found if q.share**2 >= least * found[0].share ** 2)


@dataclass(frozen=True)
class Flows:
    """The hydraulics `found` of each joint whose flow was recorded, and of effects and the other
    joints why they are `unobservable`.
    """

    found: tuple[Flow, ...]
    unobservable: dict[tuple[str, str], str]
