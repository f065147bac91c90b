"""The person at the simulated machine, and valves whose null is not in the middle."""

import io
from pathlib import Path

import numpy as np
import pytest

from crane_model import ConfigurationError, Machine, RangeError, load_machine
from crane_model.machine_files import machine_file
from crane_sim import Plant, SimulatedCrane, load_simulated_crane
from crane_sim.machine_on_bus import Operator

JOINTS = load_machine().joint_names


def test_a_lever_goes_before_the_command_until_it_is_let_go() -> None:
    operator = Operator(JOINTS)
    operator.obey("outer_boom=0.2\n")
    assert operator.spools([0.1, 0.1, -0.1, 0.1]) == [0.1, 0.1, 0.2, 0.1]
    operator.obey("outer_boom = 0")
    assert operator.spools([0.1, 0.1, -0.1, 0.1]) == [0.1, 0.1, -0.1, 0.1]


@pytest.mark.parametrize(
    "line", ["", "elbow=0.1", "slew=2", "slew=nan", "slew", "engine=maybe", "slew=fast"]
)
def test_what_cannot_be_done_changes_nothing(line: str) -> None:
    operator = Operator(JOINTS)
    with pytest.raises(RangeError, match="write engine=on"):
        operator.obey(line)
    assert operator.engine
    assert set(operator.levers.values()) == {0.0}


def test_lines_are_obeyed_and_wrong_ones_named() -> None:
    operator, complaints = Operator(JOINTS), io.StringIO()
    operator.follow(io.StringIO("engine=off\nelbow=1\nslew=-0.3\n"), complaints)
    assert not operator.engine
    assert operator.levers["slew"] == -0.3
    assert complaints.getvalue().startswith("'elbow=1'")


@pytest.mark.parametrize("joint", JOINTS)
@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_a_null_bias_shifts_the_dead_band_of_the_joint(
    joint: str, sign: float, machine: Machine, simulated: SimulatedCrane
) -> None:
    """Whatever the sense of the cylinder."""
    valve = simulated.valves[joint].model_copy(update={"null_bias": 0.02})
    valves = {**simulated.valves, joint: valve}
    parameters = simulated.model_copy(update={"valves": valves})
    edge = sign * valve.dead_band + 0.02
    index, moved = JOINTS.index(joint), []
    for command in (edge - sign * 0.005, edge + sign * 0.03):
        plant = Plant(parameters, machine, parameters.start)
        plant.advance(command * np.eye(4)[index], 1.5)
        moved.append(sign * (plant.q - parameters.start)[index])
    assert moved[0] == 0.0
    assert moved[1] > 0.005


def test_a_null_bias_that_opens_a_centred_valve_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "plant.yaml"
    base = load_simulated_crane().valves["slew"].dead_band
    path.write_text(
        f"base: {machine_file('simulated_crane.yaml')}\n"
        f"valves: {{slew: {{null_bias: {base + 0.01}}}}}\n"
    )
    with pytest.raises(ConfigurationError, match="the valve of a centred spool would be open"):
        load_simulated_crane(path)
