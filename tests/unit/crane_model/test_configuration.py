"""Reading YAML into schemas: what each kind of wrong file is told."""

import os
from pathlib import Path
from typing import Annotated, get_args

import pytest
from pydantic import Field, ValidationError
from pydantic_core import core_schema

from crane_model import ConfigurationError, CraneError, DataError, RangeError
from crane_model.cli import run
from crane_model.configuration import Schema, load, read_yaml, save, wording
from crane_model.machine_files import machine_file

LIMITS = (
    *("gt", "ge", "lt", "le", "multiple_of", "min_length", "max_length", "pattern", "expected"),
    *("discriminator", "expected_tags", "error"),
)


class Spring(Schema):
    stiffness: Annotated[float, Field(gt=0)]
    rest: float = 0.0


class Bench(Schema):
    name: str
    springs: tuple[Spring, ...]
    note: str | None = None


@pytest.fixture
def file(tmp_path: Path) -> Path:
    return tmp_path / "bench.yaml"


def complaint(file: Path, text: str) -> str:
    file.write_text(text, encoding="utf-8")
    with pytest.raises(ConfigurationError) as caught:
        load(file, Bench)
    assert str(file) in str(caught.value)
    return str(caught.value)


WRONG = {
    "value past its limit": (
        "name: a\nsprings: [{stiffness: 2.0}, {stiffness: -1.5}]",
        ["'springs.1.stiffness'", "greater than 0", "-1.5"],
    ),
    "not a number": (
        "name: a\nsprings: [{stiffness: soft}]",
        ["line 2: key 'springs.0.stiffness': must be a number (got 'soft')"],
    ),
    "not finite": ("name: a\nsprings: [{stiffness: .inf}]", ["'springs.0.stiffness'", "finite"]),
    "missing key": ("springs: []", ["'name'", "required"]),
    "unknown key": (
        "name: a\nsprings: []\nnaem: b",
        ["line 3: key 'naem': no such key; there are name, springs, note (got 'b')"],
    ),
    "unknown key further in": (
        "name: a\nsprings: [{stiffness: -1, stifness: 2}]",
        ["'springs.0.stifness': no such key; there are stiffness, rest (got 2)", "greater than 0"],
    ),
    "wrong shape": ("name: a\nsprings: 3", ["'springs'", "list", "3"]),
    "number instead of a mapping": ("name: a\nsprings: [3]", ["'springs.0'", "mapping", "3"]),
    "list instead of a mapping": ("- a\n- b", ["whole file", "mapping", "['a', 'b']"]),
    "empty file": ("", ["whole file", "mapping", "None"]),
    "not YAML": ("name: [a", ["not valid YAML", "line 1"]),
    "key without a colon": (
        "name: a\nsprings\nnote: b",
        ["line 2: not valid YAML", "could not find expected ':'"],
    ),
    "date that is none": (
        "name: 2024-13-45\nsprings: []",
        ["line 1: key 'name': no valid timestamp"],
    ),
    "number without digits": (
        "name: a\nsprings: [{stiffness: !!int ''}]",
        ["line 2: key 'springs.0.stiffness': no valid int (got '')"],
    ),
    "number of too many digits": (f"name: {'9' * 5000}", ["line 1: key 'name': no valid int"]),
    "number base 60 without end": (f"name: 1{':1' * 5000}", ["line 1: key 'name': no valid int"]),
    "tag that is unknown": ("name: !mine a", ["line 1: key 'name': not valid YAML"]),
    "character that is none": ("name: \0", ["not valid YAML", "special characters"]),
    "lists in lists without end": ("name: " + "[" * 3000, ["line 1", "deeper than 40 levels"]),
    "alias of what it stands in": ("name: &a [*a]", ["line 1: key 'name'", "more than 200000"]),
    "aliases of aliases": (
        "name: a\nx0: &x0 [1, 1, 1, 1]\n"
        + "\n".join(f"x{i}: &x{i} [{', '.join([f'*x{i - 1}'] * 10)}]" for i in range(1, 9)),
        ["line 7: key 'x5'", "more than 200000"],
    ),
    "key twice": ("name: a\nsprings: []\nname: b", ["'name'", "twice", "line 3"]),
    "key twice further in": (
        "name: a\nsprings: [{stiffness: 1.0, rest: 1.0, rest: 2.0}]",
        ["'rest'", "twice", "line 2"],
    ),
}


@pytest.mark.parametrize(("text", "parts"), WRONG.values(), ids=WRONG)
def test_wrong_file_is_told_key_limit_and_value(file: Path, text: str, parts: list[str]) -> None:
    message = complaint(file, text)
    for part in parts:
        assert part in message


def test_every_wrong_key_is_listed_at_once(file: Path) -> None:
    message = complaint(file, "springs: [{stiffness: 0}, {rest: x, stiffness: 1}]")
    assert len(message.splitlines()) == 3
    for key in ("'name'", "'springs.0.stiffness'", "'springs.1.rest'"):
        assert key in message


def test_a_key_is_named_with_the_line_on_which_it_stands(file: Path) -> None:
    message = complaint(file, "springs:\n- stiffness: 1\n-\n  rest: 2\n  stiffness: -3\n")
    assert f"{file}: line 5: key 'springs.1.stiffness': must be greater than 0" in message
    assert f"{file}: line 1: key 'name': is required" in message


def test_no_wording_of_a_library_is_told() -> None:
    """Not even for what no schema of the suite asks today."""
    for kind in get_args(core_schema.ErrorType):
        context = dict.fromkeys(LIMITS, 3)
        told = wording(kind, context, 5)
        assert told and "{" not in told and "Input" not in told


def test_endless_messages_are_shortened(file: Path) -> None:
    """The beginning tells of file and key, the end what to do."""
    message = complaint(file, "name: a\nsprings: []\n? " + "k" * 100_000 + "\n: 3")
    assert len(message) < 2500
    assert message.endswith("there are name, springs, note (got 3)")
    many = complaint(file, "name: a\nsprings:\n" + "- 3\n" * 3000)
    assert len(many.splitlines()) == 51
    assert many.endswith("\nand 2950 more")


def test_a_file_too_large_and_what_is_no_file(file: Path) -> None:
    message = complaint(file, "name: " + "x" * 1_000_000)
    assert "must have at most 1000000 bytes, got 1000006" in message
    file.unlink()
    os.mkfifo(file)
    with pytest.raises(ConfigurationError, match="it is not a file"):
        load(file, Bench)


def test_long_values_are_shortened(file: Path) -> None:
    message = complaint(file, f"name: a\nsprings: {'x' * 500}")
    assert "xxx..." in message
    assert len(message) - len(str(file)) < 200


def test_absent_file_and_folder(tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError, match=r"gone\.yaml: no such file"):
        load(tmp_path / "gone.yaml", Bench)
    with pytest.raises(ConfigurationError, match="cannot be read"):
        load(tmp_path, Bench)


def test_file_that_is_not_text(file: Path) -> None:
    file.write_bytes(b"\xff\xfe\x00name")
    with pytest.raises(ConfigurationError, match="cannot be read"):
        load(file, Bench)


def test_round_trip_keeps_every_digit(file: Path) -> None:
    springs = tuple(Spring(stiffness=k, rest=-k) for k in (1e-300, 1 / 3, 1e5, 6.02e23))
    bench = Bench(name="länge: 1 µm", springs=springs)
    save(file, bench)
    assert load(file, Bench) == bench
    assert "note" not in read_yaml(file)


def test_schemas_are_immutable() -> None:
    with pytest.raises(ValidationError, match="frozen"):
        Spring(stiffness=1.0).stiffness = 2.0  # type: ignore[misc]


def test_packaged_file_is_found() -> None:
    assert machine_file("machine.yaml").is_file()


@pytest.mark.parametrize("kind", [CraneError, ConfigurationError, DataError, RangeError])
def test_command_line_turns_errors_into_one_line(kind: type[CraneError], capsys) -> None:
    def body() -> None:
        raise kind("q = 3 is above 2; lower it")

    assert run(body) == 1
    output = capsys.readouterr()
    assert output.err == "error: q = 3 is above 2; lower it\n"
    assert output.out == ""


def test_command_line_on_success_interrupt_and_bug() -> None:
    def interrupted() -> None:
        raise KeyboardInterrupt

    def broken() -> None:
        raise ZeroDivisionError

    assert run(lambda: None) == 0
    assert run(interrupted) == 130
    with pytest.raises(ZeroDivisionError):  # a bug must show its traceback
        run(broken)
