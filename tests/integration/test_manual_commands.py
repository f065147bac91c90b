"""Every command of the manual: the program knows its arguments, and the files are there."""

import re
import shlex
from collections.abc import Iterator
from pathlib import Path

import pytest
from ament_index_python.packages import get_package_share_directory
from from_code.command_line import executables, parser_of
from integration.test_launch_files import declared
from manual import PAGES, ROOT, text

BLOCK = re.compile(r"```(?:bash|\{code-cell\} \w+\n%%bash)\n(.*?)```", re.DOTALL)
VARIABLE = re.compile(r"\$\{(\w+)[^}]*\}|\$(\w+)")
OF_THE_SUITE = ("src/", "scripts/", "tests/", "crane_")
TARGET = re.compile(r"^(\w[\w-]*):", re.MULTILINE)


def lines(page: str, unknown: str = "1") -> Iterator[list[str]]:
    """The words of every line of the shell, with variables put in; that of a loop is `unknown`.

    AssertionError if a page uses a variable that it has not set.
    """
    variables = {"PWD": str(ROOT)}

    def value(found: re.Match[str]) -> str:
        name = found[1] or found[2]
        assert name in variables, f"{page}: ${name} is not set"
        return variables[name]

    for block in BLOCK.findall(text(page)):
        for line in re.sub(r"\\\n", " ", block).splitlines():
            words = shlex.split(VARIABLE.sub(value, line), comments=True)
            if words[:1] == ["for"]:
                variables[words[1]] = unknown
            for word in words:
                name, sign, given = word.partition("=")
                if sign and name.isidentifier() and "$" not in given:
                    variables[name] = given
            yield words


def commands(words: tuple[str, ...]) -> list[tuple[str, list[str]]]:
    """Page and arguments of every command of the manual that begins with `words`."""
    return [
        (page, line[len(words) :])
        for page in PAGES
        for line in lines(page)
        if tuple(line[: len(words)]) == words
    ]


def run(page: str, arguments: list[str]) -> None:
    """`ros2 run` with `arguments` would start; AssertionError or SystemExit if not."""
    package, name, *given = arguments
    given = given[: next((i for i, word in enumerate(given) if word[0] in "<>|"), len(given))]
    parser = parser_of(executables(package)[name])
    at = given.index("--ros-args") if "--ros-args" in given else len(given)
    parser.parse_args(given[:at])
    for parameter in re.findall(r"(\S+):=", " ".join(given[at:])):
        told = re.search(rf"\b{re.escape(parameter)}\b", parser.epilog or "")
        assert told, f"{page}: {name} has no parameter {parameter}"


RUNS = commands(("ros2", "run"))


@pytest.mark.parametrize(("page", "arguments"), RUNS, ids=map(" ".join, [one for _, one in RUNS]))
def test_programs_know_their_arguments(page: str, arguments: list[str]) -> None:
    run(page, arguments)


@pytest.mark.parametrize(
    "wrong",
    [
        "crane_sim make_bag --trajectory x.yaml --periods 5 --output there",
        "crane_sim make_bag --trajectory x.yaml --periods 2",
        "crane_driver jog --ros-args -p largest:=0.15",
    ],
)
def test_a_wrong_command_would_be_found(wrong: str) -> None:
    with pytest.raises((SystemExit, AssertionError)):
        run("", wrong.split())


def test_launch_files_know_their_arguments() -> None:
    for page, (package, name, *given) in commands(("ros2", "launch")):
        names = declared(Path(get_package_share_directory(package)) / "launch" / name)
        assert {word.partition(":=")[0] for word in given} <= set(names), page


def test_files_of_the_suite_are_there() -> None:
    for page in PAGES:
        for line in lines(page, unknown="*"):
            for word in line:
                if word.startswith(OF_THE_SUITE) and "/" in word:
                    # a type is named without the suffix of its file
                    assert [*ROOT.glob(word), *ROOT.glob(f"{word}.srv")], f"{page}: {word}"


def test_targets_of_make_are_there() -> None:
    targets = set(TARGET.findall((ROOT / "Makefile").read_text()))
    for page, (target, *_) in commands(("make",)):
        assert target in targets, page


def test_commands_are_found() -> None:
    assert len(RUNS) > 35
