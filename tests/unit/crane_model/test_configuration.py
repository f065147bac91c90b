"""Reading YAML into schemas: what each kind of wrong file is told."""

from pathlib import Path
from typing import Annotated

import pytest
from pydantic import Field, ValidationError

from crane_model.cli import run
from crane_model.configuration import Schema, load, packaged, read_yaml, save
from crane_model.errors import ConfigurationError, CraneError, DataError, RangeError


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
    "not a number": ("name: a\nsprings: [{stiffness: soft}]", ["'springs.0.stiffness'", "'soft'"]),
    "not finite": ("name: a\nsprings: [{stiffness: .inf}]", ["'springs.0.stiffness'", "finite"]),
    "missing key": ("springs: []", ["'name'", "required"]),
    "unknown key": ("name: a\nsprings: []\nnaem: b", ["'naem'", "not permitted", "'b'"]),
    "wrong shape": ("name: a\nsprings: 3", ["'springs'", "tuple", "3"]),
    "number instead of a mapping": ("name: a\nsprings: [3]", ["'springs.0'", "mapping", "3"]),
    "list instead of a mapping": ("- a\n- b", ["whole file", "mapping", "['a', 'b']"]),
    "empty file": ("", ["whole file", "mapping", "None"]),
    "not YAML": ("name: [a", ["not valid YAML", "line 1"]),
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
    assert packaged("crane_model", "laboratory_crane.yaml").is_file()


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
