"""YAML files: read into validated, immutable objects; every error names file, key and value."""

from importlib.resources import files
from pathlib import Path
from typing import Any, TypeVar

import yaml
from pydantic import BaseModel, ConfigDict, ValidationError

from crane_model.errors import ConfigurationError


class Schema(BaseModel):
    """Base of everything that is read from YAML: immutable, and unknown keys are errors."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


SchemaType = TypeVar("SchemaType", bound=BaseModel)


class _UniqueKeyLoader(yaml.SafeLoader):
    """Refuses a key that stands twice in one mapping, of which YAML would keep the last."""

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        seen = set()
        for key in (key for key, _ in node.value if isinstance(key, yaml.ScalarNode)):
            if key.value in seen:
                message = f"the key '{key.value}' stands twice in one mapping"
                raise yaml.constructor.ConstructorError(None, None, message, key.start_mark)
            seen.add(key.value)
        return super().construct_mapping(node, deep)


def packaged(package: str, name: str) -> Path:
    """Path of the file `name` in the `data` folder that ships with `package`."""
    return Path(str(files(package))) / "data" / name


def read_yaml(path: Path | str) -> Any:
    """The plain content of a YAML file; `ConfigurationError` if it is absent or not YAML."""
    path = Path(path)
    try:
        return yaml.load(path.read_text(encoding="utf-8"), _UniqueKeyLoader)
    except FileNotFoundError:
        raise ConfigurationError(f"{path}: no such file; check the path") from None
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigurationError(f"{path}: cannot be read: {error}") from None
    except yaml.YAMLError as error:
        raise ConfigurationError(f"{path}: not valid YAML: {error}") from None


def validate(content: Any, schema: type[SchemaType], source: Path | str) -> SchemaType:
    """`content` as a `schema`; `ConfigurationError` lists every wrong key of `source` at once."""
    try:
        return schema.model_validate(content)
    except ValidationError as error:
        raise ConfigurationError(_explain(error, source)) from None


def load(path: Path | str, schema: type[SchemaType]) -> SchemaType:
    """Read and validate one YAML file; `ConfigurationError` names file, key, limit and value."""
    return validate(read_yaml(path), schema, path)


def save(path: Path | str, instance: BaseModel) -> None:
    """Write a schema as YAML that `load` reads back unchanged."""
    content = instance.model_dump(mode="json", exclude_none=True)
    text = yaml.safe_dump(content, sort_keys=False, allow_unicode=True, width=100)
    Path(path).write_text(text, encoding="utf-8")


def _explain(error: ValidationError, source: Path | str) -> str:
    lines = []
    for problem in error.errors(include_url=False):
        parts = [str(part) for part in problem["loc"]]
        # in <> is not a key, but which kind of thing an entry was taken for
        key = ".".join(part for part in parts if not part.startswith("<")) or "(whole file)"
        message = problem["msg"].removeprefix("Value error, ")
        if problem["type"] == "model_type":
            message = "must be a mapping of keys to values"
        given = "" if problem["type"] in {"missing", "value_error"} else _shown(problem["input"])
        lines.append(f"{source}: key '{key}': {message}{given}")
    return "\n".join(lines)


def _shown(value: Any) -> str:
    text = repr(value)
    return f" (got {text if len(text) <= 80 else text[:77] + '...'})"
