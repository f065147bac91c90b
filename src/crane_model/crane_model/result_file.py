"""Files that programs write for programs, in JSON: each is written and read by its one schema."""

import json
import math
from enum import StrEnum
from numbers import Real
from pathlib import Path
from typing import Annotated, Any, Self

from pydantic import BaseModel, BeforeValidator, ConfigDict, ValidationError

from crane_model.errors import DataError


def _finite(value: Any) -> Any:
    """JSON has neither NaN nor infinity."""
    if not isinstance(value, Real):
        return value
    return float(value) if math.isfinite(value) else None


Number = Annotated[float | None, BeforeValidator(_finite)]
"""A number, or null where there is none; NaN and infinity become null."""
NumberByJoint = dict[str, Number]


class ResultPart(BaseModel):
    """Base of everything that stands in such a file.

    The docstring of a field says what it means, and that of a number its unit: [m], [-] for a
    ratio, [unit] where a field beside it holds it.
    """

    model_config = ConfigDict(
        frozen=True, extra="forbid", allow_inf_nan=False, use_attribute_docstrings=True
    )

    def plain(self) -> dict[str, Any]:
        """The content as JSON has it: mappings, lists, texts, numbers, null."""
        return self.model_dump(mode="json")


class ResultFile(ResultPart):
    """Base of such a file.

    >>> class Weight(ResultFile):
    ...     mass: Number
    >>> Weight(mass=float("nan")).plain()
    {'mass': None}
    """

    def write(self, path: Path | str) -> None:
        """Write the file; what stands there is replaced."""
        text = json.dumps(self.plain(), indent=2, ensure_ascii=False, allow_nan=False)
        Path(path).write_text(text + "\n", encoding="utf-8")

    @classmethod
    def read(cls, path: Path | str) -> Self:
        """Read a file; `DataError` if it is absent, or is not of this kind."""
        try:
            return cls.model_validate_json(Path(path).read_text(encoding="utf-8"))
        except FileNotFoundError:
            folder, name = Path(path).parent, Path(path).name
            advice = (
                f"{folder} holds no {name}, give a folder that does"
                if folder.is_dir()
                else "check the path"
            )
            raise DataError(f"{path}: no such file; {advice}") from None
        except ValidationError as error:
            first = error.errors(include_url=False)[0]
            place = ".".join(map(str, first["loc"])) or "whole file"
            raise DataError(
                f"{path}: not what this version writes: key '{place}': {first['msg']}; write it "
                "again with this version"
            ) from None
        except (OSError, ValueError) as error:
            raise DataError(f"{path}: not readable: {error}; write it again") from None


# Open questions of a diagnosis, for the design of the experiment that discriminates them.


class QuestionKind(StrEnum):
    """Kind of a question."""

    AMBIGUOUS = "ambiguous"
    NEAREST = "nearest"
    UNDETERMINED = "undetermined"


class OpenMember(ResultPart):
    """One answer to a question: an effect with the size that the recordings give it."""

    effect: str
    """Its type."""
    name: str
    """Name of the effect in words."""
    joint: str
    """The joint, or `all`."""
    term: dict[str, Any]
    """As in a model file, with its shape."""
    values: list[float]
    """Values of its parameters [SI]."""
    separation: Number
    """Between it and the first member, as these recordings tell them apart; null for that [σ]."""
    discriminated_by: str
    """The experiment that tells it from what looks alike."""


class OpenQuestion(ResultPart):
    """Which of several effects is it; or, of one that is undetermined, is it there at all."""

    kind: QuestionKind
    """An ambiguity group; what comes nearest where nothing is named; an undetermined term."""
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
    """Open questions of a findings.json; `DataError` if there is none, or none of this version."""
    return _Holding.read(path).open
