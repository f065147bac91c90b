"""What the manual makes from the code is of the code as it is."""

import re
from typing import Any

import pytest
from from_code import command_line
from from_code.files import KINDS, Kind
from from_code.files import pages as pages_of_files
from from_code.messages import pages as pages_of_messages
from from_code.result_files import KINDS as RESULT_FILES
from from_code.result_files import Kind as ResultKind
from from_code.result_files import pages as pages_of_result_files

from crane_interfaces import action, msg
from crane_model.configuration import load

SHIPPED = [kind for kind in KINDS if kind.ships]


@pytest.mark.parametrize("kind", SHIPPED, ids=lambda kind: kind.title)
def test_files_that_ship_are_of_the_schema_shown(kind: Kind) -> None:
    assert kind.ships is not None
    assert load(kind.ships, kind.schema)


def test_tables_of_files_tell_bounds_and_defaults() -> None:
    page = pages_of_files()["files.md"]
    assert "| `gravity` | number, > 0 or list of number, number, number |  |" in page
    assert "| `supply_pressure` | number, > 0 |  |" in page
    assert "| `sign` | `-1`, `1` | `1` |" in page
    assert "| `heartbeat_period` | number, ≥ 0.001, ≤ 65.535 | `absent` |" in page


def _numeric(part: dict[str, Any]) -> bool:
    """Whether a part of a schema is a number, may be one, or holds numbers alone."""
    inner = [*part.get("anyOf", ()), *part.get("prefixItems", ())]
    more = part.get("additionalProperties")  # True where it may be anything
    inner += [more] if isinstance(more, dict) else []
    numbers = {"number", "integer"}
    values = {type(one) for one in part.get("enum", ())} & {int, float}
    return bool(values) or part.get("type") in numbers or any(map(_numeric, inner))


@pytest.mark.parametrize("kind", RESULT_FILES, ids=lambda kind: kind.title)
def test_every_field_of_a_result_file_says_what_it_is_and_in_which_unit(kind: ResultKind) -> None:
    schema = kind.schema.model_json_schema(mode="serialization")
    parts = [schema, *schema.get("$defs", {}).values()]
    fields = [pair for part in parts for pair in part.get("properties", {}).items()]
    assert [key for key, part in fields if not part.get("description")] == []
    numbers = {key: part["description"] for key, part in fields if _numeric(part)}
    assert numbers
    assert [key for key, text in numbers.items() if not re.search(r"\[\S.*?\]", text)] == []


def test_result_files_show_nested_parts_and_units() -> None:
    page = pages_of_result_files()["result_files.md"]
    assert "| `value` | number | Estimate [unit]. |" in page
    assert "| `frequency` | number | Frequency of the line [Hz]. |" in page
    assert "One of `named`, `named_and_more`, `ambiguous`, `none`" in page
    assert "| `polarity` | `-1`, `1` |" in page


def test_every_field_of_every_message_is_shown() -> None:
    page = pages_of_messages()["messages.md"]
    shown = dict(re.findall(r"^## (\w+)\n(.*?)(?=^## |\Z)", page, re.MULTILINE | re.DOTALL))
    made = {name: getattr(msg, name) for name in dir(msg) if name[0].isupper()}
    assert made
    for name, message in made.items():
        if hasattr(message, "get_fields_and_field_types"):
            for field in message.get_fields_and_field_types():
                assert re.search(rf"^\S+ {field}\b", shown[name], re.MULTILINE), f"{name}.{field}"
    for part in (action.RunExcitation.Goal, action.RunExcitation.Result):
        for field in part.get_fields_and_field_types():
            assert re.search(rf"^\S+ {field}\b", shown["RunExcitation"], re.MULTILINE), field


def test_every_option_of_a_command_is_shown() -> None:
    page = command_line.pages()["commands_crane_sim.md"]
    program = command_line.executables("crane_sim")["make_bag"]
    section = page.split("## make_bag\n")[1].split("\n## ")[0]
    options = command_line.parser_of(program)._option_string_actions
    for option in options.keys() - {"-h", "--help", "--version"}:
        assert f":::{{option}} {option} " in section
    assert "(must be given)" in section
