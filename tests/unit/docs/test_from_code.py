"""What the manual makes from the code is of the code as it is."""

import re

import pytest
from from_code import command_line
from from_code.files import KINDS, Kind
from from_code.files import pages as pages_of_files
from from_code.messages import pages as pages_of_messages

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
