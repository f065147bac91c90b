"""Who has /robot_description and /joint_states alone, as robot_state_publisher, places the tip."""

from contextlib import closing
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from integration.driver_stage import Stage

from crane_machines import shipped
from crane_model import load_machine, tip_position


@pytest.mark.parametrize("name", shipped())
def test_the_tip_is_where_the_model_has_it(name: str, ros_domain: int, tmp_path: Path) -> None:
    """By names, as joint states may come in any order; a joint that follows another is in none."""
    machine = load_machine(name)
    low = np.array([machine.limits[joint].position_min for joint in machine.joint_names])
    high = np.array([machine.limits[joint].position_max for joint in machine.joint_names])
    q = low + (high - low) * np.linspace(0.4, 0.6, len(low))
    pose = [f"{joint}={value:.4f}" for joint, value in zip(machine.joint_names, q, strict=True)]
    with closing(Stage(tmp_path, pose, machine=name)) as stage:
        stage.until(lambda: stage.description)
        state, description = stage.states[-1], stage.description[-1]
    model = pin.buildModelFromXML(description, mimic=True)
    told = dict(zip(state.name, state.position, strict=True))
    by_name = np.zeros(model.nq)
    for joint in told:
        by_name[model.joints[model.getJointId(joint)].idx_q] = told[joint]
    data = model.createData()
    pin.framesForwardKinematics(model, data, by_name)
    tip = data.oMf[model.getFrameId("tip")].translation
    known = np.array([[told[joint] for joint in machine.joint_names]])
    assert model.nq == len(told)
    np.testing.assert_allclose(tip, tip_position(machine, known)[0], atol=1e-9)
    np.testing.assert_allclose(known[0], q, atol=0.02)
