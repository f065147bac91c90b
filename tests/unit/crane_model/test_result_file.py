"""Files for programs: what is written is read again, and anything else is refused by name."""

import json
import math
from pathlib import Path

import pytest
from pydantic import ValidationError

from crane_model import DataError
from crane_model.result_file import Number, NumberByJoint, ResultFile


class Weights(ResultFile):
    mass: Number
    """Of all [kg]."""
    parts: NumberByJoint
    """Of each [kg]."""


def test_it_is_read_as_it_was_written(tmp_path: Path) -> None:
    written = Weights(mass=1.0 / 3.0, parts={"slew": math.nan, "telescope": math.inf})
    written.write(tmp_path / "weights.json")
    text = (tmp_path / "weights.json").read_text(encoding="utf-8")
    expected = {"mass": 1.0 / 3.0, "parts": {"slew": None, "telescope": None}}
    assert json.loads(text) == expected
    assert text == json.dumps(expected, indent=2) + "\n"
    assert Weights.read(tmp_path / "weights.json") == written


def test_a_key_that_the_schema_lacks_is_not_written() -> None:
    with pytest.raises(ValidationError, match="colour"):
        Weights(mass=1.0, parts={}, colour="red")  # type: ignore[call-arg]


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (None, "no such file"),
        ("{", "not what this version writes: key 'whole file'"),
        ('{"mass": 1.0}', "key 'parts'"),
        ('{"mass": 1.0, "parts": {"slew": "heavy"}}', "key 'parts.slew'"),
        ('{"mass": 1.0, "parts": {}, "colour": 3}', "key 'colour'"),
        (b"\xff", "not readable"),
    ],
)
def test_what_is_no_such_file_is_refused_by_name(
    tmp_path: Path, text: str | bytes | None, said: str
) -> None:
    path = tmp_path / "weights.json"
    if text is not None:
        path.write_bytes(text.encode() if isinstance(text, str) else text)
    with pytest.raises(DataError, match=said) as caught:
        Weights.read(path)
    assert str(path) in str(caught.value)
