"""A made-up machine of two joints, a carriage [m] and an arm [rad] that a motor turns: the driver
follows its files, and files of another machine are refused in words of this one.
"""

import math
from pathlib import Path

import numpy as np
import pytest
import yaml
from matplotlib.figure import Figure

from crane_driver import MachineCodec, load_layout, load_safety
from crane_driver.can.layout import Layout
from crane_driver.driver_loop import DriverLoop, JointSample
from crane_driver.driver_parameters import driver_parameters
from crane_driver.operator.bringup.estimates import EncoderResult, Rest, find_encoder
from crane_driver.operator.bringup.pictures import EncoderTrace, draw_encoders
from crane_driver.operator.jog.jog_node import JogParameters
from crane_driver.safety.supervisor import Supervisor
from crane_model import ConfigurationError, load_machine
from crane_model.machine_files import machine_file
from crane_nodes.joint_notes import load_joint_notes

LOADER = Path(__file__).parents[2] / "machines" / "loader"
MACHINE = load_machine(LOADER)
SAFETY = load_safety(LOADER / "safety.yaml", MACHINE)
CYCLE = 0.01  # s
POSE, SPEED = {"carriage": 0.5, "arm": -0.2}, {"carriage": 0.1, "arm": 0.05}
PRESSURES = {"carriage.a": 6e6, "carriage.b": 2e6, "supply": 16e6}


@pytest.fixture(scope="module")
def layout() -> Layout:
    return load_layout(MACHINE, LOADER / "can.yaml", LOADER / "can.dbc")


def test_the_driver_measures_in_the_order_of_the_machine(layout: Layout) -> None:
    """Not of its mapping, which begins with the arm."""
    loop = DriverLoop(layout, MACHINE, SAFETY, {"carriage": 0.05, "arm": 0.02}, 0.0)
    machine = MachineCodec(layout)
    samples: list[JointSample] = []
    for k in range(1, 301):
        now = k * CYCLE
        positions = {joint: POSE[joint] + SPEED[joint] * now for joint in POSE}
        frames = [
            machine.reading_frame(name, positions, PRESSURES, {})._replace(
                stamp=round(now * 1e9), steady=now
            )
            for name in machine.cycles
        ]
        samples += loop.receive(frames, [], now)[0]
    assert loop.joints == ("carriage", "arm")
    assert loop.cylinders == ("carriage",)
    sample = samples[-1]
    assert sample.position == pytest.approx([positions["carriage"], positions["arm"]], abs=2e-4)
    assert sample.velocity == pytest.approx([0.1, 0.05], abs=3e-3)
    assert sample.effort[0] == pytest.approx(2.0e-3 * 6e6 - 1.2e-3 * 2e6)
    assert math.isnan(sample.effort[1]), "a motor has no chambers"


def test_commands_reach_the_valves_and_limits_hold(layout: Layout) -> None:
    supervisor = Supervisor(layout.valves, MACHINE, SAFETY, 0.0)
    supervisor.published_by(1)
    supervisor.readings({"carriage": 0.6, "arm": 0.799}, {"carriage": 0.0, "arm": 0.0})
    for step in range(1, 60):
        now = step * CYCLE
        supervisor.ready(True, now)
        supervisor.command(["carriage", "arm"], [0.0, 0.0], now)
        supervisor.output(now)
    supervisor.enable(now)
    for step in range(60, 120):
        now = step * CYCLE
        supervisor.command(["carriage", "arm"], [-0.3, 0.3], now)
        sent = supervisor.output(now).commands
    assert sent["carriage"] < -0.1
    assert abs(sent["arm"]) < 0.01, "the arm is at its upper limit"


def test_the_mapping_of_a_crane_is_refused() -> None:
    with pytest.raises(ConfigurationError) as refused:
        load_layout(MACHINE, machine_file("can.yaml"), machine_file("can.dbc"))
    told = str(refused.value)
    assert "key 'positions': no joint slew, inner_boom" in told
    assert "; test loader has carriage, arm\n" in told
    assert "; test loader has carriage.a, carriage.b, supply, tank\n" in told


@pytest.mark.parametrize("name", ["safety.yaml", "joints.yaml"])
def test_tables_of_a_crane_are_refused(name: str) -> None:
    read = {"safety.yaml": lambda path: load_safety(path, MACHINE)}.get(
        name, lambda path: load_joint_notes(path, MACHINE.units)
    )
    with pytest.raises(ConfigurationError) as refused:
        read(machine_file(name))
    assert str(machine_file(name)) in str(refused.value)
    assert "no entry for carriage, arm and no joint slew" in str(refused.value)
    assert "the machine has the joints carriage, arm" in str(refused.value)


def test_parameters_are_those_of_the_joints() -> None:
    names = {one.name: one for one in driver_parameters(MACHINE, str(LOADER))}
    densities = {name: one.default for name, one in names.items() if name.startswith("jerk")}
    assert densities == {"jerk_density.carriage": 0.05, "jerk_density.arm": 0.02}
    assert "Unit: m^2/s^5" in names["jerk_density.carriage"].description
    jog = JogParameters.of(load_joint_notes(LOADER / "joints.yaml", MACHINE.units))
    assert {one.name: one.default for one in jog.axis.values()} == {
        "joy.axis.carriage": 5,
        "joy.axis.arm": 2,
    }


def test_pictures_of_the_bring_up_have_the_units_of_the_joints() -> None:
    time = np.linspace(0.0, 1.0, 50)
    results: dict[str, EncoderResult] = {}
    for joint in MACHINE.joint_names:
        rest = Rest(0.1, 1e-5, 1e-4)
        results[joint] = find_encoder(joint, rest, 0.0, 0.2, 0.2, 0.2)
    traces = dict.fromkeys(results, EncoderTrace(time, 0.1 + 0.2 * time))
    figure = draw_encoders(traces, results, MACHINE.units)
    assert isinstance(figure, Figure)
    assert [axes.get_ylabel() for axes in figure.axes] == ["reading [m]", "reading [°]"]


def test_a_folder_without_a_mapping_is_told_what_it_lacks(tmp_path: Path) -> None:
    (tmp_path / "machine.yaml").write_text((LOADER / "machine.yaml").read_text())
    with pytest.raises(ConfigurationError, match=r"can\.yaml: no such file of the machine"):
        machine_file("can.yaml", tmp_path)


def test_the_mapping_may_lack_joints_but_not_name_others(tmp_path: Path) -> None:
    content = yaml.safe_load((LOADER / "can.yaml").read_text())
    content["commands"]["bucket"] = content["commands"].pop("arm")
    (tmp_path / "can.yaml").write_text(yaml.safe_dump(content))
    with pytest.raises(ConfigurationError, match="'commands': no joint bucket; test loader has"):
        load_layout(MACHINE, tmp_path / "can.yaml", LOADER / "can.dbc")
