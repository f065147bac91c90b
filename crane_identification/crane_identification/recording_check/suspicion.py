"""Findings of a check of a recording."""

from dataclasses import dataclass
from enum import StrEnum


class RecordingVerdict(StrEnum):
    """Verdict on a recording: right only if all was checked, and nothing was found."""

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
    decisive: bool = False

    def __str__(self) -> str:
        return f"{self.where}: {self.cause} ({self.evidence})"


@dataclass(frozen=True)
class Checked:
    """Result of the check of the recording `source`, with the reasons of `unchecked` parts.

    `notes` list repairs made when the recording was read.
    """

    source: str
    suspicions: tuple[Suspicion, ...]
    unchecked: tuple[str, ...]
    notes: tuple[str, ...] = ()

    @property
    def decisive(self) -> tuple[Suspicion, ...]:
        return tuple(suspicion for suspicion in self.suspicions if suspicion.decisive)

    @property
    def verdict(self) -> RecordingVerdict:
        if self.decisive:
            return RecordingVerdict.WRONG
        return (
            RecordingVerdict.DOUBTFUL
            if self.suspicions or self.unchecked
            else RecordingVerdict.RIGHT
        )
