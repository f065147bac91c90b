"""What looks wrong in a recording, and what could not be looked at."""

from dataclasses import dataclass
from enum import StrEnum


class Verdict(StrEnum):
    """What a recording looks like: right only if all was checked, and nothing was found."""

    RIGHT = "right"
    DOUBTFUL = "doubtful"
    WRONG = "wrong"


@dataclass(frozen=True)
class Suspicion:
    """`where` (joint, sensor or topic) something looks wrong, the `evidence` for it, numbers with
    units, and the likeliest `cause`. A `decisive` one makes every result wrong.
    """

    where: str
    evidence: str
    cause: str
    decisive: bool

    def __str__(self) -> str:
        return f"{self.where}: {self.cause} ({self.evidence})"


@dataclass(frozen=True)
class Checked:
    """What a check found in the recording `source`, and what was `unchecked`, with the reason.

    `notes` say what was mended when the recording was read.
    """

    source: str
    suspicions: tuple[Suspicion, ...]
    unchecked: tuple[str, ...]
    notes: tuple[str, ...] = ()

    @property
    def decisive(self) -> tuple[Suspicion, ...]:
        """Those that make every result wrong."""
        return tuple(one for one in self.suspicions if one.decisive)

    @property
    def verdict(self) -> Verdict:
        """What the recording looks like."""
        if self.decisive:
            return Verdict.WRONG
        return Verdict.DOUBTFUL if self.suspicions or self.unchecked else Verdict.RIGHT
