"""The machine file: the report's numbers are in it, and each kind of wrong machine is refused."""

import math
import pickle
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from crane_model.configuration import save
from crane_model.errors import ConfigurationError, RangeError
from crane_model.machine import JOINTS, Machine, load_machine
from crane_model.machine_files import machine_file

LABORATORY = machine_file("machine.yaml")


def test_table_1(machine: Machine) -> None:
    expected = [
        [0.0, 2.202, 0.0, math.pi / 2],
        [0.1192, 0.0, 1.4, 0.0],
        [math.pi / 2 - 0.1192, 0.0, 0.104, math.pi / 2],
        [0.0, 1.813, 0.0, 0.0],
    ]
    np.testing.assert_array_equal(machine.denavit_hartenberg.table, expected)


@pytest.mark.parametrize(
    ("joint", "row"),
    [
        ("inner_boom", (-0.45, 1.37, -0.16, 0.21)),
        ("outer_boom", (-2.7, -0.1, -0.43, 0.39)),
        ("telescope", (0.0, 1.55, -0.67, 0.5)),
    ],
)
def test_table_2(machine: Machine, joint: str, row: tuple[float, ...]) -> None:
    limits = machine.limits[joint]
    assert row == (
        limits.position_min,
        limits.position_max,
        limits.velocity_min,
        limits.velocity_max,
    )


@pytest.mark.parametrize(
    "section", ["inner_boom_linkage", "outer_boom_linkage", "cylinders", "hydraulics", "plausible"]
)
def test_what_the_report_does_not_give_is_marked_as_assumed(section: str) -> None:
    (line,) = [x for x in LABORATORY.read_text().splitlines() if x.startswith(f"{section}:")]
    assert "assumed" in line


def test_cylinders_with_transducers_are_the_three_of_the_plane(machine: Machine) -> None:
    measured = [joint for joint in JOINTS if machine.cylinders[joint].pressure_sensors]
    assert measured == ["inner_boom", "outer_boom", "telescope"]


def test_round_trip(machine: Machine, tmp_path: Path) -> None:
    save(tmp_path / "machine.yaml", machine)
    assert load_machine(tmp_path / "machine.yaml") == machine


def changed(key: str, value: Any) -> str:
    """The laboratory crane with one key changed, or without it if the value is `...`."""
    content = yaml.safe_load(LABORATORY.read_text())
    *path, last = key.split(".")
    section = content
    for part in path:
        section = section[part]
    if value is ...:
        del section[last]
    else:
        section[last] = value
    return yaml.safe_dump(content)


WRONG = {
    "linkage that does not close": (
        ("outer_boom_linkage.c2", 0.05),
        ["linkage of outer_boom", "Table 2", "does not close at q = "],
    ),
    "linkage that passes its dead centre": (
        ("limits.inner_boom.position_max", 2.2),
        ["linkage of inner_boom", "lever arm must keep its sign", "0.02 m", "at q = 1.8"],
    ),
    "linkage that hardly turns its joint": (
        ("limits.inner_boom.position_max", 1.86),
        ["linkage of inner_boom", "exceed 0.02 m", "at q = 1.86 rad"],
    ),
    "stroke too short when extended": (
        ("cylinders.inner_boom.length_max", 0.95),
        ["inner_boom", "within [0.62, 0.95] m", "runs from 0.6"],
    ),
    "stroke too short when retracted": (
        ("cylinders.telescope.length_min", 0.1),
        ["telescope", "within [0.1, 1.56] m", "from 0.0000 to 1.5500 m"],
    ),
    "three lengths that are no triangle": (
        ("outer_boom_linkage.s32", 3.0),
        ["outer_boom_linkage", "s32 = 3.0", "between 1.02 and 1.38"],
    ),
    "limits in the wrong order": (
        ("limits.telescope.position_min", 2.0),
        ["limits.telescope", "position_min 2.0 must be below position_max 1.55"],
    ),
    "lengths in the wrong order": (
        ("cylinders.slew.length_min", 0.5),
        ["cylinders.slew", "length_min 0.5 must be below length_max 0.17"],
    ),
    "negative area": (
        ("cylinders.telescope.area_b", -1e-3),
        ["area_b", "greater than 0", "-0.001"],
    ),
    "lower limit of velocity above zero": (
        ("limits.slew.velocity_min", 0.1),
        ["limits.slew.velocity_min", "less than 0", "0.1"],
    ),
    "no rack radius": (("cylinders.slew.rack_radius", ...), ["slew", "rack_radius [m] is missing"]),
    "no joint": (("limits.outer_boom", ...), ["'limits.outer_boom'", "required"]),
    "unknown joint": (
        ("limits.grapple", {}),
        ["'limits.grapple'", "no such key; there are slew, inner_boom, "],
    ),
    "unknown key": (
        ("hydraulics.oil", "HLP 46"),
        ["'hydraulics.oil'", "no such key; there are ", "HLP 46"],
    ),
    "no gravity": (("gravity", 0.0), ["'gravity'", "greater than 0", "0.0"]),
    "implausible order": (("plausible.m_TL", [240.0, 90.0]), ["m_TL", "[240.0, 90.0]"]),
    "mass that gravity does not show": (
        ("plausible.J_SL", [1.0, 2.0]),
        ["J_SL", "must be of S_FL_along, S_SL_along, m_TL"],
    ),
    "length in words": (
        ("denavit_hartenberg.base_height", "tall"),
        ["'denavit_hartenberg.base_height'", "number", "'tall'"],
    ),
}


@pytest.mark.parametrize(("change", "parts"), WRONG.values(), ids=WRONG)
def test_wrong_machine_is_refused(
    tmp_path: Path, change: tuple[str, Any], parts: list[str]
) -> None:
    file = tmp_path / "machine.yaml"
    file.write_text(changed(*change))
    with pytest.raises(ConfigurationError) as caught:
        load_machine(file)
    for part in [str(file), *parts]:
        assert part in str(caught.value)


def test_a_machine_goes_to_another_process_unchanged() -> None:
    machine = load_machine()
    assert pickle.loads(pickle.dumps(machine)) == machine


def test_a_joint_is_found_by_its_name(machine: Machine) -> None:
    assert [machine.index(joint) for joint in machine.joint_names] == [0, 1, 2, 3]
    assert [machine.units[joint] for joint in machine.joint_names] == ["rad", "rad", "rad", "m"]
    with pytest.raises(RangeError, match="no joint 'bucket'; the joints are slew, inner_boom, "):
        machine.index("bucket")
