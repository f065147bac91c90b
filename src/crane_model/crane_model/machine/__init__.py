"""The machine as data: joints, actuators and supply, from one validated YAML file."""

from crane_model.machine.joint import DenavitHartenberg, JointLimits, MachineJoint, Origin
from crane_model.machine.machine import HydraulicSupply, Machine, load_machine
from crane_model.machine.per_joint import JOINT_UNITS, JOINTS, PLANAR_JOINTS
from crane_model.machine.planar import WEIGHED, PlanarCrane

__all__ = [
    "JOINTS",
    "JOINT_UNITS",
    "PLANAR_JOINTS",
    "WEIGHED",
    "DenavitHartenberg",
    "HydraulicSupply",
    "JointLimits",
    "Machine",
    "MachineJoint",
    "Origin",
    "PlanarCrane",
    "load_machine",
]
