"""The machine as data: joints, actuators and supply, from one validated YAML file."""

from crane_model.machine.joint import DenavitHartenberg, JointLimits, MachineJoint, Origin
from crane_model.machine.machine import HydraulicSupply, Machine, load_machine
from crane_model.machine.planar import WEIGHED, PlanarCrane

__all__ = [
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
