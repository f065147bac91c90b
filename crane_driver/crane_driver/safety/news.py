"""What the driver has to say in its log."""

from enum import Enum, auto
from typing import NamedTuple


class Level(Enum):
    """How much it matters."""

    DEBUG = auto()  # a consequence of what was said
    INFO = auto()  # a state
    WARNING = auto()  # what was refused, and what devices report
    ERROR = auto()  # a fault


class News(NamedTuple):
    """One line of the log."""

    level: Level
    text: str
