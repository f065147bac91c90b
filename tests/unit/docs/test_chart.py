"""The chart of commands names commands and pages that exist."""

import re

from from_code.chart import ENTRIES, STAGES, pages
from from_code.command_line import executables
from manual import ROOT, text


def test_commands_and_pages_exist() -> None:
    for stage in STAGES:
        assert (ROOT / "docs" / stage.page.partition("#")[0].replace(".html", ".md")).is_file()
        for command in stage.commands:
            package, name = command.split()
            assert name in executables(package), command


def test_every_stage_is_reached_and_in_the_table_of_commands() -> None:
    assert {entry.stage for entry in ENTRIES} >= {0, len(STAGES) - 1}
    table = text("docs/which_command.md")
    for stage in STAGES:
        names = [command.split()[1] for command in stage.commands]
        assert any(re.search(rf"`(\w+ )?{name}`", table) for name in names), stage.task


def test_it_is_a_picture_with_a_link_for_each_command() -> None:
    (chart,) = pages().values()
    assert chart.count("<rect") == len(STAGES)
    assert chart.count("commands_") == sum(len(stage.commands) for stage in STAGES)
