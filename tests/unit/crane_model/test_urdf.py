"""The URDF, read by Pinocchio, is the crane of Table 1."""

from xml.etree import ElementTree as ET

import numpy as np
import pinocchio as pin
import pytest

from crane_model.kinematics import tip_position
from crane_model.machine import JOINTS, Machine
from crane_model.urdf import urdf


def test_tip_agrees_with_forward_kinematics(machine: Machine) -> None:
    model = pin.buildModelFromXML(urdf(machine))
    data, tip = model.createData(), model.getFrameId("boom_tip")
    assert tuple(model.names)[1:] == JOINTS
    q = np.random.default_rng(4).uniform([-2, -0.45, -2.7, 0], [2, 1.37, -0.1, 1.55], (200, 4))
    theirs = []
    for row in q:
        pin.framesForwardKinematics(model, data, row)
        theirs.append(data.oMf[tip].translation.copy())
    np.testing.assert_allclose(tip_position(machine, q), theirs, atol=1e-9)


def test_limits_are_those_of_table_2(machine: Machine) -> None:
    model = pin.buildModelFromXML(urdf(machine))
    for i, joint in enumerate(JOINTS):
        limits = machine.limits[joint]
        assert model.lowerPositionLimit[i] == limits.position_min
        assert model.upperPositionLimit[i] == limits.position_max
        assert model.velocityLimit[i] == max(-limits.velocity_min, limits.velocity_max)


@pytest.mark.parametrize("joint", JOINTS)
def test_effort_is_what_the_supply_can_push(machine: Machine, joint: str) -> None:
    limits, cylinder = machine.limits[joint], machine.cylinders[joint]
    (element,) = ET.fromstring(urdf(machine)).findall(f"joint[@name='{joint}']/limit")
    q = np.linspace(limits.position_min, limits.position_max, 21)
    lever = np.abs(machine.cylinder(joint, q)[:, 1]).max()
    effort = machine.hydraulics.supply_pressure * cylinder.area_a * lever
    assert float(element.get("effort")) == pytest.approx(effort, rel=1e-5)


def test_every_moving_link_is_drawn(machine: Machine) -> None:
    links = ET.fromstring(urdf(machine)).findall("link")
    undrawn = {link.get("name") for link in links if link.find("visual") is None}
    assert undrawn == {"boom_tip"}
