"""YAML files: read within limits into validated, immutable objects; errors name file and key."""

import ast
import math
import operator
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from importlib.metadata import EntryPoint, entry_points
from importlib.resources import files
from pathlib import Path
from typing import Annotated, Any, Self, TypeVar, get_args

import yaml
from annotated_types import Ge, Le
from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    ModelWrapValidatorHandler,
    ValidationError,
    model_validator,
)
from pydantic_core import ErrorDetails, InitErrorDetails, PydanticCustomError
from pydantic_core.core_schema import ErrorType
from yaml.composer import ComposerError
from yaml.constructor import ConstructorError

from crane_model.errors import ConfigurationError

# Messages about values that a schema does not accept.

MAX_SHOWN_CHARACTERS = 80  # of a value that is shown
MAPPING, NUMBER = "must be a mapping of keys to values", "must be a number"
WHOLE, LIST = "must be a whole number", "must be a list"
UNKNOWN_KEY = "unknown_key"  # beside those of pydantic
WORDING = {
    "missing": "is required, but absent",
    UNKNOWN_KEY: "no such key; there are {known}",
    "invalid_key": "no such key; check its spelling",
    "none_required": "must be left out",
    "greater_than": "must be greater than {gt}",
    "greater_than_equal": "must be at least {ge}",
    "less_than": "must be less than {lt}",
    "less_than_equal": "must be at most {le}",
    "multiple_of": "must be a multiple of {multiple_of}",
    "finite_number": "must be a finite number",
    "float_type": NUMBER,
    "float_parsing": NUMBER,
    "int_type": WHOLE,
    "int_parsing": WHOLE,
    "int_parsing_size": f"{WHOLE} of fewer digits",
    "int_from_float": WHOLE,
    "bool_type": "must be true or false",
    "bool_parsing": "must be true or false",
    "string_type": "must be text",
    "string_too_short": "must have at least {min_length} characters",
    "string_too_long": "must have at most {max_length} characters",
    "string_pattern_mismatch": "must match the pattern {pattern}",
    "enum": "must be {expected}",
    "literal_error": "must be {expected}",
    "too_short": "must have at least {min_length} entries",
    "too_long": "must have at most {max_length} entries",
    "list_type": LIST,
    "tuple_type": LIST,
    "set_type": LIST,
    "frozen_set_type": LIST,
    "dict_type": MAPPING,
    "mapping_type": MAPPING,
    "model_type": MAPPING,
    "model_attributes_type": MAPPING,
    "union_tag_not_found": "lacks the key {discriminator}",
    "union_tag_invalid": "{discriminator} must be one of {expected_tags}",
    "value_error": "{error}",
}
OTHER_WORDING = "is not of the kind that belongs here"


def wording(kind: str, context: Mapping[str, Any], value: Any) -> str:
    """Fault of a `value`, and the value if the fault does not show it.

    `kind` is pydantic's type of the error, `context` its details.
    """
    said = WORDING.get(kind, OTHER_WORDING).format(**context)
    return said + ("" if kind in {"missing", "value_error"} else shown(value))


def shown(value: Any) -> str:
    """A value in brackets, shortened if it is long."""
    text = repr(value)
    if len(text) > MAX_SHOWN_CHARACTERS:
        text = text[: MAX_SHOWN_CHARACTERS - 3] + "..."
    return f" (got {text})"


# YAML text to plain content, within limits: a small text that grows without end is refused.

MAX_YAML_DEPTH = 40  # mappings and lists within each other
MAX_YAML_VALUES = 200_000  # values, those behind an alias counted wherever it stands
MAX_NUMBER_CHARACTERS = (
    100  # characters of a number or a date: the arithmetic of long ones takes hours
)


class WrongYamlError(Exception):
    """Fault of the text, with line and key if it has them."""


class YamlText:
    """Parsed YAML: its plain `content`, and the line on which each part of it stands.

    Raises `WrongYamlError` if the text is not YAML, a value is not what its tag says, a key stands
    twice in one mapping, or a limit is passed.
    """

    def __init__(self, text: str):
        self._root: yaml.Node | None = None
        self._parts: dict[yaml.Node | None, dict[str, yaml.Node]] = {}
        try:
            loader = _Loader(text)
            self._root = loader.get_single_node()
            self.content: Any = None
            if self._root is not None:
                _count(self._root, {})
                self.content = loader.construct_document(self._root)
        except yaml.MarkedYAMLError as error:
            raise WrongYamlError(self._told(error)) from None
        except yaml.YAMLError as error:  # of a single character
            raise WrongYamlError(f"not valid YAML: {' '.join(str(error).split())}") from None

    def line(self, place: Sequence[int | str]) -> int:
        """Line, from 1, of what stands at `place` (keys and indices), or of what would hold it."""
        node = self._root
        for part in place:
            if node not in self._parts:
                self._parts[node] = dict(_parts(node))
            inner = self._parts[node].get(str(part))
            if inner is None:
                break
            node = inner
        return 1 if node is None else node.start_mark.line + 1

    def _told(self, error: yaml.MarkedYAMLError) -> str:
        mark = error.problem_mark or error.context_mark
        if error.context == "while scanning a simple key":  # it is found out on the next line
            mark = error.context_mark
        assert mark is not None  # that is what PyYAML means by marked
        key = ".".join(_way(self._root, mark.index)) if self._root else ""
        place = f"line {mark.line + 1}: " + (f"key '{key}': " if key else "")
        if isinstance(error, _RefusedError):
            return f"{place}{error.problem}"
        what = "; ".join(text for text in (error.context, error.problem) if text)
        return f"{place}not valid YAML: {what}"


class _RefusedError(ConstructorError):
    """Valid YAML that the suite does not accept."""

    def __init__(self, problem: str, node: yaml.Node):
        super().__init__(None, None, problem, node.start_mark)


class _Loader(yaml.SafeLoader):
    _depth = 0

    def compose_node(self, parent: yaml.Node | None, index: Any) -> yaml.Node | None:
        self._depth += 1
        if self._depth > MAX_YAML_DEPTH:
            problem = f"nested deeper than {MAX_YAML_DEPTH} levels; write it flatter"
            event = self.peek_event()  # type: ignore[no-untyped-call]
            raise ComposerError(None, None, problem, event.start_mark)
        node = super().compose_node(parent, index)
        self._depth -= 1
        return node

    def construct_object(self, node: yaml.Node, deep: bool = False) -> Any:
        kind = node.tag.rpartition(":")[2]
        try:
            if kind in {"int", "float", "timestamp"} and len(node.value) > MAX_NUMBER_CHARACTERS:
                raise ValueError
            return super().construct_object(node, deep)
        except yaml.YAMLError:
            raise
        except Exception:  # whatever Python says of a month 13 or a number without digits
            raise _RefusedError(f"no valid {kind}{shown(node.value)}", node) from None

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        seen = set()
        for key in (key for key, _ in node.value if isinstance(key, yaml.ScalarNode)):
            if key.value in seen:
                raise _RefusedError(f"the key '{key.value}' appears twice in one mapping", key)
            seen.add(key.value)
        return super().construct_mapping(node, deep)


def _parts(node: yaml.Node | None) -> Iterator[tuple[str, yaml.Node]]:
    """Key or index, and node, of all that stands right within a node."""
    if isinstance(node, yaml.MappingNode):
        yield from ((str(key.value), value) for key, value in node.value)
    elif isinstance(node, yaml.SequenceNode):
        yield from ((str(i), value) for i, value in enumerate(node.value))


def _way(node: yaml.Node, index: int) -> Iterator[str]:
    """Keys and indices down to the character `index` of the text."""
    for key, inner in _parts(node):
        begin, end = inner.start_mark.index, inner.end_mark.index
        if node.start_mark.index < begin <= index <= end:  # an alias stands elsewhere
            yield key
            yield from _way(inner, index)
            return


def _count(node: yaml.Node, counted: dict[int, int]) -> int:
    """Values in a node, aliases followed; `counted` holds those of the nodes that were met."""
    if id(node) not in counted:
        counted[id(node)] = MAX_YAML_VALUES + 1  # until it is known: of a node that holds itself
        total = 1
        for _, inner in _parts(node):
            total += _count(inner, counted)
            if total > MAX_YAML_VALUES:
                raise _RefusedError(
                    f"holds more than {MAX_YAML_VALUES} values, those of aliases counted wherever "
                    "they stand; write fewer",
                    node,
                )
        counted[id(node)] = total
    return counted[id(node)]


# YAML files: read into validated, immutable objects; every error names file, key and value.

BUILT_IN = frozenset(get_args(ErrorType))  # kinds of pydantic's own errors
MAX_FILE_BYTES = 1_000_000  # a thousand times what the files of the suite have

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
        """Add the known keys to pydantic's message about an unknown key."""
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
        if (size := path.stat().st_size) > MAX_FILE_BYTES:
            raise ConfigurationError(
                f"{path}: must have at most {MAX_FILE_BYTES} bytes, got {size}; is it the right "
                "file?"
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
    stated = {type(limit): limit for limit in schema.model_fields[field].metadata}
    return stated[Ge].ge, stated[Le].le


def _beside_known(problem: ErrorDetails, schema: type[BaseModel]) -> InitErrorDetails:
    """A problem of a schema, or of one within it, as pydantic takes it back."""
    kind, text, context = problem["type"], problem["msg"], problem.get("ctx", {})
    if kind == "extra_forbidden" and len(problem["loc"]) == 1:
        kind, text = UNKNOWN_KEY, "there are {known}"
        context = {
            "known": ", ".join(field.alias or name for name, field in schema.model_fields.items())
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
        parts = [part for part in problem["loc"] if not str(part).startswith("<")]
        key = ".".join(_named(content, parts)) or "(whole file)"
        told = wording(problem["type"], problem.get("ctx", {}), problem["input"])
        lines.append(f"{place_of(parts)}: key '{key}': {told}")
    raise ConfigurationError("\n".join(lines))


# Angles in files: numbers in rad, or sums and products with pi, as `pi/2 - 0.1192`.

MAX_DIRECTION_RAD = 4.0 * math.pi  # of a direction: two turns
_OPERATIONS: dict[type[ast.operator], Callable[[float, float], float]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
}


def _read(given: Any) -> Any:
    if not isinstance(given, str):
        return given
    try:
        return _value(ast.parse(given.strip(), mode="eval").body)
    except (SyntaxError, ValueError, ZeroDivisionError, OverflowError, RecursionError):
        raise ValueError(
            f"must be an angle in rad, a number or like pi/2 - 0.1, got {given!r}"
        ) from None


def _value(node: ast.expr) -> float:
    match node:
        case ast.Constant(value=int() | float() as number):
            return float(number)
        case ast.Name(id="pi"):
            return math.pi
        case ast.UnaryOp(op=ast.USub(), operand=operand):
            return -_value(operand)
        case ast.BinOp(left=left, op=sign, right=right) if type(sign) in _OPERATIONS:
            return _OPERATIONS[type(sign)](_value(left), _value(right))
    raise ValueError


def _within(angle: float) -> float:
    if abs(angle) > MAX_DIRECTION_RAD:
        raise ValueError(
            f"must be an angle in rad, within {MAX_DIRECTION_RAD:.3g} either way, got {angle:g}; "
            "is it in degrees?"
        )
    return angle


Angle = Annotated[float, BeforeValidator(_read)]
Direction = Annotated[Angle, AfterValidator(_within)]
"""An angle of the geometry, which is no joint's coordinate."""


# Kinds of things that other packages may add to: found by their entry points, chosen by `type`.

Kind = TypeVar("Kind", bound=Schema)


def load_entry_points(
    group: str, registry: dict[str, type[Kind]], what: str
) -> tuple[type[Kind], ...]:
    """Register what every installed package with an entry point of `group` has; `what` names it.

    An entry point names a module, whose classes are registered by being imported, or one class of
    it. One that cannot be imported, or takes a type that exists, is left out with a warning, so
    that it stops nobody who does not need it.
    """
    before = set(registry)
    for point in sorted(entry_points(group=group)):
        if reason := _refused(point, registry, what):
            package = point.dist.name if point.dist else "a package"
            warnings.warn(
                f"{package}: entry point '{point.name}' of {group} is left out: {reason}; "
                "repair or uninstall it",
                stacklevel=2,
            )
    return tuple(registry[name] for name in registry if name not in before)


def of_type(content: Any, registry: Mapping[str, type[Kind]], what: str, more: str) -> Kind:
    """The entry of a file that names its `type`; raises ValueError as pydantic wants it.

    `what` it is, and where `more` types come from, is for the message.
    """
    name = content.get("type") if isinstance(content, Mapping) else None
    if not isinstance(name, str) or name not in registry:
        known = ", ".join(sorted(registry))
        raise ValueError(f"no {what} of type {name!r}; there are {known}, {more}")
    return registry[name].model_validate(content)


def _refused(point: EntryPoint, registry: dict[str, type[Kind]], what: str) -> str:
    """Why its classes were not registered; empty if they were."""
    before = dict(registry)
    try:
        point.load()
    except Exception as error:  # whatever stands in the package
        reason = f"{type(error).__name__}: {error}"
    else:
        taken = [name for name, known in before.items() if registry[name] is not known]
        if not taken:
            return ""
        reason = f"there is {what} of type '{taken[0]}' already"
    registry.clear()
    registry.update(before)
    return reason
