"""Arguments, places of results and progress, as all command lines have them."""

import argparse
import itertools
import re
import sys
from collections.abc import Callable
from enum import StrEnum
from importlib import import_module
from importlib.abc import MetaPathFinder
from pathlib import Path

import pytest

from crane_model import ConfigurationError, cli
from crane_model import progress_bar as shown
from crane_model.cli import above, between, check_out, command_line, one_of, whole
from crane_model.progress_bar import progress_bar


class Fruit(StrEnum):
    APPLE = "apple"
    PEAR = "pear"


@pytest.mark.parametrize(
    ("kind", "right", "wrong", "told"),
    [
        (above(0.0), "0.5", ["0", "-1", "inf", "nan", "x", ""], "must be a number above 0, got "),
        (above(0.0, 1.0), "1", ["1.1"], "must be a number above 0 and at most 1, got 1.1"),
        (between(0.0), "0", ["-1", "inf", "1 s"], "must be a number at least 0, got "),
        (between(1.0, 5.0), "5", ["5.1"], "must be a number from 1 to 5, got 5.1"),
        (whole(1), "7", ["0", "1.5", "x"], "must be a whole number at least 1, got "),
        (whole(1, 50), "50", ["51", "9" * 5000], "must be a whole number from 1 to 50, got "),
        (one_of(Fruit), "pear", ["plum"], "there is no 'plum'; there are apple, pear"),
    ],
)
def test_arguments_say_what_they_accept(
    kind: Callable[[str], float | str], right: str, wrong: list[str], told: str
) -> None:
    """And no name of a function, as argparse says by itself."""
    assert str(kind(right)) in (right, f"{right}.0")
    for text in wrong:
        with pytest.raises(argparse.ArgumentTypeError) as caught:
            kind(text)
        assert str(caught.value).startswith(told)


def test_what_exists_is_written_over_by_wish_only(tmp_path: Path) -> None:
    there, absent = tmp_path / "model.yaml", tmp_path / "deep" / "model.yaml"
    there.write_text("a")
    check_out(absent)
    with pytest.raises(ConfigurationError, match="model.yaml: exists; .* or --replace to write ov"):
        check_out(absent, there)
    check_out(absent, there, replace=True)
    with pytest.raises(ConfigurationError, match="exists; name another place$"):
        check_out(tmp_path, replace=True)  # a folder is never one of the results
    with pytest.raises(ConfigurationError, match=r"model.yaml cannot be written to; name another"):
        check_out(there / "summary.json")


def test_a_log_gets_a_line_every_ten_seconds(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """However often a bar moves on, and however many bars there are one after the other."""
    clock = itertools.count(0.0, 0.01)
    monkeypatch.setattr(shown.time, "monotonic", lambda: next(clock))
    monkeypatch.setattr(shown._Lines, "told", 0.0)
    for name in ("first", "second"):
        with progress_bar(name, 2000) as bar:
            for _ in range(2000):
                bar.update()
                bar.refresh()
    assert list(progress_bar("third", over=range(100))) == list(range(100))
    told = capsys.readouterr().err
    assert "\r" not in told
    lines = told.splitlines()
    assert 3 <= len(lines) <= next(clock) / 10.0
    assert lines[0].startswith("first:  ")
    assert lines[-1].startswith("second:  ")


@pytest.mark.parametrize(
    ("given", "expected"),
    [
        ([], ["all"]),
        (["--names", "a", "b"], ["a", "b"]),
        (["--names", "a", "--more", "c", "--names", "b"], ["a", "b"]),
    ],
)
def test_values_given_in_several_places_add_up(given: list[str], expected: list[str]) -> None:
    """What is given takes the place of the default, which stays what it is."""
    parser, default = command_line(), ["all"]
    parser.add_argument("--names", nargs="+", default=default)
    parser.add_mutually_exclusive_group().add_argument("--more", nargs="+")
    for _ in range(2):
        assert parser.parse_args(given).names == expected
    assert default == ["all"]


def test_of_an_option_of_one_value_the_last_one_counts() -> None:
    parser = command_line()
    parser.add_argument("--name")
    parser.add_argument("place", nargs="+")
    told = parser.parse_args(["here", "there", "--name", "a", "--name", "b"])
    assert (told.name, told.place) == ("b", ["here", "there"])


@pytest.mark.parametrize("package", cli.EXTRAS)
def test_a_large_package_that_is_missing_is_named_with_its_target(
    package: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    class Absent(MetaPathFinder):
        def find_spec(self, name: str, path: object, target: object = None) -> None:
            if name == package:
                raise ModuleNotFoundError(f"No module named '{name}'", name=name)

    monkeypatch.setattr(sys, "meta_path", [Absent(), *sys.meta_path])
    monkeypatch.delitem(sys.modules, package, raising=False)
    assert cli.run(lambda: import_module(package) and None) == 1
    target = cli.EXTRAS[package]
    assert f"{package} is not installed" in (told := capsys.readouterr().err)
    assert told.endswith(f"make {target}\n")
    makefile = (Path(__file__).resolve().parents[3] / "Makefile").read_text()
    assert re.search(rf"^[\w ]*\b{target}\b[\w ]*:", makefile, re.MULTILINE)


def test_another_missing_module_is_a_fault_of_the_suite() -> None:
    with pytest.raises(ModuleNotFoundError):
        cli.run(lambda: import_module("there_is_no_such_module") and None)
