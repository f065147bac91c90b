"""What a case is: what is hidden in which of its recordings, in which world, how well excited."""

from enum import StrEnum

from crane_benchmark.cases.motions import Richness
from crane_model.configuration import Schema


class CaseKind(StrEnum):
    """What sort of case it is; the value is what tables say."""

    NOTHING = "nothing"
    OUTSIDE = "outside the catalogue"
    PAIR = "pair"
    CLASS = "twins"  # effects that no data of this kind tell apart
    INSUFFICIENT = "too little data"
    SINGLE = "single"


class Story(StrEnum):
    """What goes on in a case of the strangers; the value is what tables say."""

    LOAD = "a load, on and off"
    WARMING = "oil that warms up over the session"
    STRONG = "a strong effect"
    ONCE = "an effect in one recording alone"
    SPOOLS = "valves with unequal edges"
    NOTHING = "nothing"


class World(StrEnum):
    """Where a case comes from."""

    LABORATORY = "laboratory"  # designed motions; each recording is of a cold machine
    FIELD = "field"  # motions as they come, some without a period; recordings of one session


class Carried(StrEnum):
    """Which recordings of a case carry an effect."""

    ALL = "all"
    LATER = "later"  # half of those to train on
    SOME = "some"  # on and off at random, to train and to validate on, not always as strong
    ONE = "one"  # of those to train on


class EffectToHide(Schema):
    """An effect to hide in a form of the stand-in machine; `joint` None is the whole machine.

    Of its `parameters`, those that are not given are drawn.
    """

    effect: str
    joint: str | None
    form: str
    strength: float
    parameters: dict[str, float] = {}
    carried: Carried = Carried.ALL


class Case(Schema):
    """One case. `seed` is that of machine, motions and sensors; `lacks` are types of terms that
    the model to diagnose lacks on the telescope.

    In the field, the session begins with oil that is `warm` or cold, and the valves have equal
    edges or `spools` made for differential cylinders.
    """

    name: str  # tells nothing
    kind: CaseKind
    seed: tuple[int, int]
    effects: tuple[EffectToHide, ...] = ()
    excitation: Richness = Richness.RICH
    lacks: tuple[str, ...] = ()
    world: World = World.LABORATORY
    warm: bool = False
    spools: bool = False
    story: Story | None = None
