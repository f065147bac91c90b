"""Files that programs write for programs, in JSON: each is written and read by its one schema."""

import json
import math
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
