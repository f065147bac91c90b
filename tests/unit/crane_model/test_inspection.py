"""`ros2 run crane_model machine`: what it prints, draws, and finds inconsistent."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from matplotlib.figure import Figure
from matplotlib.image import imread

import crane_machines
from crane_model import Machine, load_machine
from crane_model.inspection import findings, travels
from crane_model.inspection.machine_command import main, picture
from crane_model.machine_files import machine_file


@pytest.mark.parametrize("name", crane_machines.shipped())
def test_the_shipped_machines_are_consistent(name: str) -> None:
    """But for the slew of the cranes, whose pressures nobody measures."""
    told = [line for line in findings(load_machine(name)) if "'slew': no pressure" not in line]
    assert told == []


def changed(**update: Any) -> Machine:
    """The excavator with other values, of the machine, or of its boom."""
    content = yaml.safe_load(machine_file("machine.yaml", "excavator").read_text())
    boom = content["joints"][1]
    for key, value in update.items():
        of = next(
            one
            for one in (boom["limits"], boom["actuator"], content["hydraulics"], boom)
            if key in one
        )
        of[key] = value
    return Machine.model_validate(content)


WRONG = {
    "velocity in degrees": (
        {"velocity_max": 26.0},
        "'boom': velocity up to 26 rad/s; is it in deg",
    ),
    "area in cm2": ({"area_a": 33.2}, "'boom': area_a is 33.2 m2; is it in m2"),
    "pressure in bar": ({"supply_pressure": 200.0, "tank_pressure": 3.0}, "is it in Pa"),
    "relief below supply": ({"relief_pressure": 19e6}, "supply_pressure <= relief_pressure must"),
    "chambers exchanged": ({"area_a": 1e-3}, "'boom': area_b, of the rod's side, is larger"),
    "pump too small": ({"pump_flow": 1e-4}, "'boom': its velocities need 40.2 l/min, the pump"),
    "pump in l/min": ({"pump_flow": 45.0}, "pump_flow is 45 m3/s; is it in m3/s"),
    "stroke too long": ({"length_max": 1.6}, "'boom': a cylinder of 0.77 m from pin to pin cannot"),
    "stroke not used": (
        {"length_max": 1.35, "position_max": -0.5},
        "'boom': its limits use 0.123 m of a stroke of 0.58 m",
    ),
    "no actuator yet": ({"actuator": {"type": "passive"}}, "'boom': nothing drives it; is its"),
    "nothing measured": ({"pressure_sensors": False}, "'boom': no pressure sensors, so that"),
    "lengths in mm": ({"dh": {"a": 1850.0}}, "m from the base; are lengths in m"),
}


@pytest.mark.parametrize(("update", "told"), WRONG.values(), ids=WRONG)
def test_what_is_inconsistent_is_said(update: dict[str, Any], told: str) -> None:
    assert told in "\n".join(findings(changed(**update)))


def test_forces_are_those_of_the_lever_arms(machine: Machine) -> None:
    by_joint = {one.joint: one for one in travels(machine)}
    boom, cylinder = by_joint["outer_boom"], machine.cylinders["outer_boom"]
    supply = machine.hydraulics.supply_pressure
    np.testing.assert_allclose(boom.up, np.abs(boom.lever) * supply * cylinder.area_b)
    np.testing.assert_allclose(boom.down, boom.lever * supply * cylinder.area_a)
    assert tuple(by_joint["telescope"].x) == (0.0, 1.55)


def cylinders_drawn(figure: Figure, axes: int) -> list[np.ndarray]:
    lines = [line for line in figure.axes[axes].lines if line.get_linewidth() == 4.0]
    return [np.diff(line.get_xydata(), axis=0)[0] for line in lines]


def test_cylinders_are_drawn_as_long_as_they_are() -> None:
    """From pin to pin, through the linkage of the bucket as well: (20), (24) by construction."""
    machine = load_machine("excavator")
    middle = [(one.position_min + one.position_max) / 2 for one in machine.limits.values()]
    drawn = [float(np.hypot(*line)) for line in cylinders_drawn(picture(machine), 1)]
    at = zip(machine.joint_names, middle, strict=True)
    lengths = [machine.cylinder(joint, np.array([q]))[0, 0] for joint, q in at]
    np.testing.assert_allclose(drawn, lengths[1:], atol=1e-9)


def test_the_command_prints_and_draws(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "arm.png"
    assert main(["--check", "excavator", "--out", str(out)]) == 0
    text = capsys.readouterr().out
    for part in (
        "small excavator: 4 joints",
        "four_bar_cylinder",
        "Nothing is inconsistent",
        "4.1",
    ):
        assert part in text
    assert imread(out)[:, :, :3].std() > 0.02
    assert main(["--check", "excavator", "--out", str(out)]) == 1
    assert "exists; name another place, or --replace" in capsys.readouterr().err


def test_the_command_writes_the_file_of_a_urdf(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    arm = tmp_path / "arm.urdf"
    arm.write_text(
        '<robot name="arm"><link name="base"/><link name="boom"/><joint name="swing" '
        'type="continuous"><parent link="base"/><child link="boom"/></joint></robot>'
    )
    assert main(["--urdf", str(arm)]) == 0
    assert "enter what is marked MISSING (4 places)" in capsys.readouterr().out
    assert main(["--check", str(tmp_path / "arm.yaml"), "--out", str(tmp_path / "arm.png")]) == 0
    assert "joint 'swing': nothing drives it" in capsys.readouterr().out
