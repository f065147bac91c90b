"""The machine file: the report's numbers are in it, and each kind of wrong machine is refused."""

import math
import pickle
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from laboratory_crane import JOINTS

from crane_model import ConfigurationError, Machine, RangeError, load_machine
from crane_model.configuration import save
from crane_model.machine_files import machine_file

LABORATORY = machine_file("machine.yaml")


def test_table_1(machine: Machine) -> None:
    expected = [
        [0.0, 2.202, 0.0, math.pi / 2],
        [0.1192, 0.0, 1.4, 0.0],
        [math.pi / 2 - 0.1192, 0.0, 0.104, math.pi / 2],
        [0.0, 1.813, 0.0, 0.0],
    ]
    rows = [list(joint.dh.model_dump().values()) for joint in machine.joints]
    np.testing.assert_array_equal(rows, expected)


def test_the_planar_crane_is_found_in_the_chain(machine: Machine) -> None:
    constants = (("inner_boom", "outer_boom", "telescope"), 2.202, 0.1192, 1.4, 0.104, 1.813, 9.81)
    assert machine.planar == constants


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


def test_what_the_report_does_not_give_is_marked_as_assumed() -> None:
    keys = ("actuator:", "hydraulics:", "plausible:")
    lines = [line for line in LABORATORY.read_text().splitlines() if line.strip().startswith(keys)]
    assert len(lines) == 6
    assert all("assumed" in line for line in lines)


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
        if isinstance(section, list):
            (section,) = [one for one in section if one["name"] == part]
        else:
            section = section[part]
    if value is ...:
        del section[last]
    else:
        section[last] = value
    return yaml.safe_dump(content)


WRONG = {
    "linkage that does not close": (
        ("joints.outer_boom.actuator.c2", 0.05),
        ["'joints.outer_boom'", "does not close at q = "],
    ),
    "linkage that passes its dead centre": (
        ("joints.inner_boom.limits.position_max", 2.2),
        ["linkage of inner_boom", "lever arm must keep its sign", "0.02 m", "at q = 1.8"],
    ),
    "linkage that hardly turns its joint": (
        ("joints.inner_boom.limits.position_max", 1.86),
        ["linkage of inner_boom", "exceed 0.02 m", "at q = 1.86 rad"],
    ),
    "stroke too short when extended": (
        ("joints.inner_boom.actuator.length_max", 0.95),
        ["inner_boom", "within [0.62, 0.95] m", "runs from 0.6"],
    ),
    "stroke too short when retracted": (
        ("joints.telescope.actuator.length_min", 0.1),
        ["telescope", "within [0.1, 1.56] m", "from 0.0000 to 1.5500 m"],
    ),
    "three lengths that are no triangle": (
        ("joints.outer_boom.actuator.s32", 3.0),
        ["'joints.outer_boom.actuator'", "s32 = 3.0", "between 1.02 and 1.38"],
    ),
    "limits in the wrong order": (
        ("joints.telescope.limits.position_min", 2.0),
        ["'joints.telescope.limits'", "position_min 2.0 must be below position_max 1.55"],
    ),
    "lengths in the wrong order": (
        ("joints.slew.actuator.length_min", 0.5),
        ["'joints.slew.actuator'", "length_min 0.5 must be below length_max 0.17"],
    ),
    "negative area": (
        ("joints.telescope.actuator.area_b", -1e-3),
        ["'joints.telescope.actuator.area_b'", "greater than 0", "-0.001"],
    ),
    "no area": (
        ("joints.telescope.actuator.area_a", ...),
        ["'joints.telescope.actuator.area_a'", "is required, but absent"],
    ),
    "lower limit of velocity above zero": (
        ("joints.slew.limits.velocity_min", 0.1),
        ["'joints.slew.limits.velocity_min'", "less than 0", "0.1"],
    ),
    "no rack radius": (
        ("joints.slew.actuator.rack_radius", ...),
        ["'joints.slew.actuator.rack_radius'", "required"],
    ),
    "no limits": (("joints.outer_boom.limits", ...), ["'joints.outer_boom'", "limits is required"]),
    "no actuator": (("joints.slew.actuator", ...), ["'joints.slew'", "actuator is required"]),
    "unknown actuator": (
        ("joints.outer_boom.actuator.type", "cylinder"),
        ["'joints.outer_boom.actuator'", "no actuator of type 'cylinder'; there are direct_cyl"],
    ),
    "key of another actuator": (
        ("joints.telescope.actuator.rack_radius", 0.1),
        ["'joints.telescope.actuator.rack_radius'", "no such key; there are ", "area_a", "count"],
    ),
    "kind of no joint": (
        ("joints.telescope.kind", "sliding"),
        ["'joints.telescope.kind'", "'revolute' or 'prismatic'", "'sliding'"],
    ),
    "joint in two places": (
        ("joints.telescope.axis", [0, 0, 1]),
        ["'joints.telescope'", "either as dh", "or as origin: {xyz, rpy} and axis"],
    ),
    "joint that stands nowhere": (("joints.slew.dh", ...), ["'joints.slew'", "either as dh"]),
    "name that stands twice": (
        ("joints.telescope.name", "slew"),
        ["joint 'slew' is listed twice"],
    ),
    "coupling of no joint": (
        ("couplings", [{"joints": ["slew", "wrist"], "matrix": [[1, 0], [0, 1]]}]),
        ["couplings", "'wrist'", "slew, inner_boom"],
    ),
    "coupling that holds an actuator still": (
        ("couplings", [{"joints": ["slew", "telescope"], "matrix": [[1, 1], [1, 1]]}]),
        ["'couplings.0'", "must not be singular"],
    ),
    "unknown key": (
        ("hydraulics.oil", "HLP 46"),
        ["'hydraulics.oil'", "no such key; there are ", "HLP 46"],
    ),
    "cylinders without a pump": (
        ("hydraulics", ...),
        ["hydraulics: required, for slew, inner_boom, outer_boom, telescope have"],
    ),
    "no gravity": (("gravity", 0.0), ["'gravity'", "greater than 0", "0.0"]),
    "implausible order": (("plausible.m_TL", [240.0, 90.0]), ["m_TL", "[240.0, 90.0]"]),
    "mass that gravity does not show": (
        ("plausible.J_SL", [1.0, 2.0]),
        ["J_SL", "must be of S_FL_along, S_SL_along, m_TL"],
    ),
    "length in words": (
        ("joints.slew.dh.d", "tall"),
        ["'joints.slew.dh.d'", "number", "'tall'"],
    ),
    "limits in degrees": (
        ("joints.inner_boom.limits.position_max", 78.0),
        ["linkage of inner_boom over its limits", "span 78.5 rad", "are they in degrees?"],
    ),
    "direction in degrees": (
        ("joints.slew.dh.alpha", 90),
        ["'joints.slew.dh.alpha'", "within 12.6 either way, got 90", "in degrees?"],
    ),
    "pin in degrees": (
        ("joints.inner_boom.actuator.phi_4", 21.0),
        ["'joints.inner_boom.actuator.phi_4'", "got 21", "in degrees?"],
    ),
    "name of two words": (
        ("joints.telescope.name", "my telescope"),
        ["must be letters, digits and '_', a letter first, got 'my telescope'"],
    ),
    "angle in words": (
        ("joints.slew.dh.alpha", "half of __import__('math').pi"),
        ["'joints.slew.dh.alpha'", "an angle in rad, a number or like pi/2 - 0.1, got "],
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
