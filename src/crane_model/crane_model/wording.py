"""What the suite says of a value that a schema does not accept."""

from collections.abc import Mapping
from typing import Any

LONGEST = 80  # characters of a value that is shown
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
OTHERWISE = "is not of the kind that belongs here"


def wording(kind: str, context: Mapping[str, Any], value: Any) -> str:
    """What is wrong with a `value`, and the value where that does not say it.

    `kind` is pydantic's type of the error, `context` what it tells of it.
    """
    said = WORDING.get(kind, OTHERWISE).format(**context)
    return said + ("" if kind in {"missing", "value_error"} else shown(value))


def shown(value: Any) -> str:
    """A value in brackets, shortened if it is long."""
    text = repr(value)
    return f" (got {text if len(text) <= LONGEST else text[: LONGEST - 3] + '...'})"
