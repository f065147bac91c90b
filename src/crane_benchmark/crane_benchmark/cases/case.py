"""What a case is: what is hidden in which of its recordings, in which world, how well excited."""

from enum import StrEnum

from pydantic import ConfigDict

from crane_benchmark.cases.motions import Richness
from crane_model.configuration import Schema
from crane_model.result_file import ResultFile
from crane_sim.hiding.label import LabelledEffect


class CaseKind(StrEnum):
    """What sort of case it is; the value is what tables say."""

    NOTHING = "nothing"
    OUTSIDE = "outside the catalogue"
    PAIR = "pair"
    CLASS = "twins"  # effects that no data of this kind tell apart
    INSUFFICIENT = "too little data"
    LENGTHS = "lengths that are not the file's"  # nothing else is hidden
    SINGLE = "single"


class Story(StrEnum):
    """What goes on in a case of the strangers; the value is what tables say."""

    LOAD = "a load, on and off"
    WARMING = "oil that warms up over the session"
    STRONG = "a strong effect"
    ONCE = "an effect in one recording alone"
    SPOOLS = "valves with unequal edges"
    NOTHING = "nothing"


class Site(StrEnum):
    """Whose machine makes the recordings of a case."""

    HOME = "home"  # the stand-in machine, which the diagnosis grew up with
    AWAY = "away"  # one of other make, with families of laws of its own


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
    """An effect to hide in a form that the machines of its site have."""

    model_config = ConfigDict(use_attribute_docstrings=True)

    effect: str
    """Its type in the catalogue, or in that of the stand-in machine."""
    joint: str | None
    """The joint; null: the whole machine."""
    form: str
    """Law that it follows in the machine."""
    strength: float
    """Rms of its force over that of the drive, that is asked for [-]."""
    parameters: dict[str, float] = {}
    """Of that law [SI]; those that are not given are drawn."""
    carried: Carried = Carried.ALL
    """Which recordings carry it."""


class HiddenInRecording(ResultFile):
    """What one recording of a case hides."""

    effects: list[LabelledEffect]
    """As in a label."""


class Case(Schema):
    """One case. `seed` is that of machine, motions and sensors; `lacks` are types of terms that
    the model to diagnose lacks on the telescope.

    A machine that is `off` is up to 3 % longer or shorter, link by link, than its file says; others
    were surveyed. Its valves have equal edges, or `spools` made for differential cylinders. In the
    field, the session begins with oil that is `warm` or cold.
    """

    name: str  # tells nothing
    kind: CaseKind
    site: Site = Site.HOME
    seed: tuple[int, int]
    effects: tuple[EffectToHide, ...] = ()
    excitation: Richness = Richness.RICH
    lacks: tuple[str, ...] = ()
    world: World = World.LABORATORY
    warm: bool = False
    spools: bool = False
    off: bool = False
    story: Story | None = None
