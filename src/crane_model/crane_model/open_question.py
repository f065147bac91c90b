"""What a diagnosis leaves open, for the design of the experiment that settles it."""

from enum import StrEnum
from pathlib import Path
from typing import Any

from pydantic import ConfigDict

from crane_model.result_file import Number, NumberByJoint, ResultFile, ResultPart


class QuestionKind(StrEnum):
    """What is asked."""

    CLASS = "class"
    NEAREST = "nearest"
    UNDETERMINED = "undetermined"


class OpenMember(ResultPart):
    """One answer to a question: an effect with the size that the recordings give it."""

    effect: str
    """Its type."""
    name: str
    """What people call it."""
    joint: str
    """The joint, or `all`."""
    term: dict[str, Any]
    """As in a model file, with its shape."""
    values: list[float]
    """Of its parameters [SI]."""
    separation: Number
    """Between it and the first member, as these recordings tell them apart; null for that [σ]."""
    settled_by: str
    """The experiment that tells it from what looks alike."""


class OpenQuestion(ResultPart):
    """Which of several effects is it; or, of one that is undetermined, is it there at all."""

    kind: QuestionKind
    """Members of a class; what comes nearest where nothing is named; an undetermined term."""
    members: list[OpenMember]
    """The answers; a single one where the other is that it is not there."""
    needed: Number
    """Separation at which one is ruled out [σ]."""
    needed_share: Number
    """The same, over how clearly the effect itself shows: the larger of both counts [-]."""


class OpenQuestions(ResultPart):
    """All that is open, and how well the machine is known."""

    row_rate: Number
    """Rows of force a second [1/s]."""
    noise: NumberByJoint
    """White noise of the force in such a row, which tells as much as that of the recordings
    [N m, N]."""
    questions: list[OpenQuestion]
    """None where nothing is open."""


class _Holding(ResultFile):
    """The part of findings.json that is read here."""

    model_config = ConfigDict(extra="ignore")

    open: OpenQuestions


def read_open(path: Path | str) -> OpenQuestions:
    """What is open by a findings.json; `DataError` if there is none, or none of this version."""
    return _Holding.read(path).open
