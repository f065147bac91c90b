"""YAML files: read into validated, immutable objects; every error names file, key and value."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from typing import Annotated, Any, Self, TypeVar, get_args

import yaml
from annotated_types import Ge, Le
from pydantic import (
    BaseModel,
    ConfigDict,
    Field,
    ModelWrapValidatorHandler,
    ValidationError,
    model_validator,
)
from pydantic_core import (
    ErrorDetails,
    InitErrorDetails,
    PydanticCustomError,
)
from pydantic_core.core_schema import ErrorType

from crane_model.errors import ConfigurationError
from crane_model.wording import UNKNOWN_KEY, wording
from crane_model.yaml_text import WrongYamlError, YamlText

BUILT_IN = frozenset(get_args(ErrorType))  # kinds of pydantic's own errors
LARGEST_FILE = 1_000_000  # bytes, a thousand times what the files of the suite have

Positive = Annotated[float, Field(gt=0)]
NonNegative = Annotated[float, Field(ge=0)]


class Schema(BaseModel):
    """Base of everything that is read from YAML: immutable, and unknown keys are errors."""

    model_config = ConfigDict(
        frozen=True, extra="forbid", allow_inf_nan=False, serialize_by_alias=True
    )

    def __eq__(self, other: object) -> bool:
        """By the fields alone; beside them stands what was computed from them."""
        if not isinstance(other, Schema) or type(self) is not type(other):
            return False
        return self._values() == other._values()

    def __hash__(self) -> int:
        return hash((type(self), *self._values()))

    def _values(self) -> list[Any]:
        return [getattr(self, name) for name in type(self).model_fields]

    def __copy__(self) -> Self:
        """Without what was computed from the fields, which `model_copy` changes."""
        copied = super().__copy__()
        for name in copied.__dict__.keys() - type(self).model_fields.keys():
            del copied.__dict__[name]
        return copied

    @model_validator(mode="wrap")
    @classmethod
    def _unknown_keys_beside_known(
        cls, content: Any, handler: ModelWrapValidatorHandler[Self]
    ) -> Self:
        """What pydantic says of an unknown key lacks the keys that there are."""
        try:
            return handler(content)
        except ValidationError as error:
            raise ValidationError.from_exception_data(
                error.title,
                [_beside_known(problem, cls) for problem in error.errors(include_url=False)],
            ) from None


SchemaType = TypeVar("SchemaType", bound=BaseModel)


@dataclass(frozen=True)
class Document:
    """The plain `content` of a YAML file, and where it stands in it."""

    path: Path
    text: YamlText

    @property
    def content(self) -> Any:
        """Mappings, lists and scalars."""
        return self.text.content

    def validated(self, schema: type[SchemaType]) -> SchemaType:
        """The content as a `schema`; `ConfigurationError` lists every wrong key with its line."""
        return _validate(
            self.content, schema, lambda place: f"{self.path}: line {self.text.line(place)}"
        )


def packaged(package: str, name: str) -> Path:
    """Path of the file `name` in the `data` folder that ships with `package`."""
    return Path(str(files(package))) / "data" / name


def read_document(path: Path | str) -> Document:
    """A YAML file; `ConfigurationError` if it is absent, too large or not YAML."""
    path = Path(path)
    try:
        if path.exists() and not path.is_file():  # a pipe would never end
            raise ConfigurationError(f"{path}: cannot be read: it is not a file")
        if (size := path.stat().st_size) > LARGEST_FILE:
            raise ConfigurationError(
                f"{path}: must have at most {LARGEST_FILE} bytes, got {size}; is it the right file?"
            )
        return Document(path, YamlText(path.read_text(encoding="utf-8")))
    except FileNotFoundError:
        raise ConfigurationError(f"{path}: no such file; check the path") from None
    except (OSError, ValueError) as error:  # not text in UTF-8, or no path at all
        raise ConfigurationError(f"{path}: cannot be read: {error}") from None
    except WrongYamlError as error:
        raise ConfigurationError(f"{path}: {error}") from None


def read_yaml(path: Path | str) -> Any:
    """The plain content of a YAML file; `ConfigurationError` as of `read_document`."""
    return read_document(path).content


def validate(content: Any, schema: type[SchemaType], source: Path | str) -> SchemaType:
    """`content` as a `schema`; `ConfigurationError` lists every wrong key of `source` at once."""
    return _validate(content, schema, lambda _: str(source))


def load(path: Path | str, schema: type[SchemaType]) -> SchemaType:
    """Read and validate one YAML file; `ConfigurationError` names file, line, key and value."""
    return read_document(path).validated(schema)


def save(path: Path | str, instance: BaseModel) -> None:
    """Write a schema as YAML that `load` reads back unchanged."""
    content = instance.model_dump(mode="json", exclude_none=True)
    text = yaml.safe_dump(content, sort_keys=False, allow_unicode=True, width=100)
    Path(path).write_text(text, encoding="utf-8")


def bounds(schema: type[BaseModel], field: str) -> tuple[float, float]:
    """Smallest and largest value that a schema allows a field which states both (ge, le)."""
    stated = {type(one): one for one in schema.model_fields[field].metadata}
    return stated[Ge].ge, stated[Le].le


def _beside_known(problem: ErrorDetails, schema: type[BaseModel]) -> InitErrorDetails:
    """A problem of a schema, or of one within it, as pydantic takes it back."""
    kind, text, context = problem["type"], problem["msg"], problem.get("ctx", {})
    if kind == "extra_forbidden" and len(problem["loc"]) == 1:
        kind, text = UNKNOWN_KEY, "there are {known}"
        context = {
            "known": ", ".join(one.alias or name for name, one in schema.model_fields.items())
        }
    return InitErrorDetails(
        type=kind if kind in BUILT_IN else PydanticCustomError(kind, text, context),
        loc=problem["loc"],
        input=problem["input"],
        ctx=context,
    )


def _named(content: Any, place: Sequence[int | str]) -> Iterator[str]:
    """Keys down to a place in the content; in lists, by name where their entries have names."""
    for part in place:
        try:
            content = content[part]
        except (LookupError, TypeError):  # what is missing, or of a part that is not in the file
            content = None
        name = content.get("name") if isinstance(content, dict) and isinstance(part, int) else None
        yield str(part if name is None else name)


def _validate(
    content: Any, schema: type[SchemaType], place_of: Callable[[Sequence[int | str]], str]
) -> SchemaType:
    try:
        return schema.model_validate(content)
    except ValidationError as error:
        problems = error.errors(include_url=False)
    lines = []
    for problem in problems:
        # in <> is not a key, but which kind of thing an entry was taken for
        parts = [one for one in problem["loc"] if not str(one).startswith("<")]
        key = ".".join(_named(content, parts)) or "(whole file)"
        told = wording(problem["type"], problem.get("ctx", {}), problem["input"])
        lines.append(f"{place_of(parts)}: key '{key}': {told}")
    raise ConfigurationError("\n".join(lines))
