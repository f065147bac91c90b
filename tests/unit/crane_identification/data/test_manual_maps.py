"""Every column map and every line of one that the manual shows is one."""

import re
from typing import Any

import pytest
import yaml
from manual import text

from crane_identification import ColumnMap

TEXT = text("docs/how_to/record.md") + text("docs/reference/column_map.md")
BLOCKS = re.findall(r"```yaml\n(.*?)```", TEXT, re.DOTALL)
TABLE = "\n".join(line for line in TEXT.splitlines() if line.startswith("|"))
SNIPPETS = re.findall(r"`((?:\{|\w+: )[^`]*)`", TABLE)
BAR = {"column": "p", "unit": "bar"}


@pytest.mark.parametrize("block", BLOCKS)
def test_maps(block: str) -> None:
    assert ColumnMap.model_validate(yaml.safe_load(block)).joints


@pytest.mark.parametrize("snippet", SNIPPETS)
def test_lines_of_maps(snippet: str) -> None:
    if snippet.startswith("{"):
        quantity = "pressure_a" if "bar" in snippet else "position"
        parts = {quantity: yaml.safe_load(snippet)}
    else:
        parts = yaml.safe_load(snippet)
    joint: dict[str, Any] = {"position": {"column": "q", "unit": "m"}}
    joint |= {"pressure_a": BAR, "pressure_b": BAR}
    content: dict[str, Any] = {"rate": 1.0, "separator": ";"}
    for key, value in parts.items():
        if key == "time":
            content |= {"rate": None, "time": value}
        elif key in ColumnMap.model_fields:
            content[key] = value
        else:
            joint[key] = value
    ColumnMap.model_validate(content | {"joints": {"axis": joint}})


def test_they_are_found() -> None:
    assert len(BLOCKS) == 2
    assert len(SNIPPETS) >= 9
