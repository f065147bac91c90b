"""Every field of every message, action and service says its unit; every constant what it means."""

import re
from dataclasses import dataclass
from pathlib import Path

import pytest

FOLDER = Path(__file__).resolve().parents[3] / "crane_interfaces"
DEFINITIONS = sorted(p for kind in ("msg", "action", "srv") for p in FOLDER.glob(f"{kind}/*"))

UNIT = re.compile(r"\[(-|unit|(Pa|rad|m|s|kg|N|N\*m)(/s(\^2)?)?)\]")
FIELD = re.compile(r"^(?P<type>[\w/]+)(\[\w*\])?\s+(?P<name>\w+)\s*(?P<constant>=\s*\w+)?\s*(#|$)")


@dataclass(frozen=True)
class Line:
    type: str
    name: str
    constant: bool
    comment: str  # on the line and on the comment lines directly below


def parse(text: str) -> list[Line]:
    lines: list[Line] = []
    below_field = False
    for raw in text.splitlines():
        code, _, comment = raw.partition("#")
        if match := FIELD.match(raw):
            lines.append(Line(match["type"], match["name"], bool(match["constant"]), comment))
        elif below_field and not code.strip() and comment:
            last = lines.pop()
            lines.append(Line(last.type, last.name, last.constant, last.comment + comment))
        else:
            assert not code.strip(" -"), f"not understood: {raw!r}"
        below_field = bool(raw.strip()) and bool(lines)
    return lines


def undocumented(text: str) -> list[str]:
    """Names of fields that lack their unit, or for a header its stamp and frame."""
    wrong = []
    for line in parse(text):
        if line.type == "std_msgs/Header":
            documented = "stamp:" in line.comment and "frame_id:" in line.comment
        elif line.constant or line.type in {"string", "string[]"}:
            documented = bool(line.comment.strip())
        else:
            documented = UNIT.search(line.comment) is not None
        if not documented:
            wrong.append(line.name)
    return wrong


def test_the_suite_has_the_interfaces_of_its_design() -> None:
    assert {p.name for p in DEFINITIONS} == {
        "CylinderPressures.msg",
        "DriverState.msg",
        "GeneralizedForces.msg",
        "JointReference.msg",
        "ParameterEstimate.msg",
        "PositionEstimate.msg",
        "SensorFindings.msg",
        "TipLoad.msg",
        "ValveCommand.msg",
        "RunExcitation.action",
        "SubstituteEncoder.srv",
    }


@pytest.mark.parametrize("path", DEFINITIONS, ids=lambda p: p.name)
def test_every_field_is_documented(path: Path) -> None:
    assert undocumented(path.read_text()) == []


@pytest.mark.parametrize("path", DEFINITIONS, ids=lambda p: p.name)
def test_every_definition_is_built(path: Path) -> None:
    assert f"  {path.relative_to(FOLDER)}\n" in (FOLDER / "CMakeLists.txt").read_text()


def test_what_moves_the_crane_names_its_hazards() -> None:
    for name in ("msg/ValveCommand.msg", "action/RunExcitation.action"):
        assert "HAZARD" in (FOLDER / name).read_text()


@pytest.mark.parametrize(
    ("text", "wrong"),
    [
        ("float64 speed", ["speed"]),
        ("float64 speed  # how fast", ["speed"]),
        ("float64 speed  # [m/s]", []),
        ("float64 speed  # how fast\n               # [m/s]", []),
        ("float64 speed  # how fast\n\n# [m/s]", ["speed"]),
        ("std_msgs/Header header  # stamp: now", ["header"]),
        ("uint8 GOOD=1\nuint8 BAD=2  # broken", ["GOOD"]),
        ("string[] name", ["name"]),
    ],
)
def test_the_check_finds_what_is_missing(text: str, wrong: list[str]) -> None:
    assert undocumented(text) == wrong
