"""Machine, geometry, dynamics, terms and forward simulation of the crane; no ROS, no CAN.

The names of `__all__` are the public API; each is imported from its module when it is first asked
for, so that `import crane_model` alone compiles nothing.

Lever arms and generalized forces of two poses:

>>> import numpy as np
>>> from crane_model import generalized_forces, lever_arms, load_machine
>>> machine, joints = load_machine(), ("inner_boom", "telescope")
>>> q = np.array([[0.5, 0.2], [0.8, 0.4]])
>>> lever_arms(machine, q, joints)[:, 1].tolist()
[1.0, 1.0]
>>> pressure_a, pressure_b = np.full((2, 2, 2), 1e6)
>>> generalized_forces(machine, q, pressure_a, pressure_b, joints).shape
(2, 2)

A block of 2 kg that is pushed by 4 N for a second:

>>> from crane_model import Model, simulate
>>> from crane_model.terms.single_axis import Inertia
>>> from crane_model.terms.term import Setting
>>> block = Model("block", Setting({"axis": "m"}, None), (Inertia(joint="axis"),), np.array([2.0]))
>>> still, push = np.zeros((1, 1)), np.full((11, 1, 1), 4.0)
>>> simulate(block, still, still, push, period=0.1).velocity[-1].round(6).tolist()
[[2.0]]
"""

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from crane_model.cylinders import generalized_forces, lever_arms
    from crane_model.dynamics import Geometry, inverse_dynamics
    from crane_model.errors import ConfigurationError, CraneError, DataError, RangeError
    from crane_model.kinematics import forward_kinematics, tip_jacobian, tip_position
    from crane_model.machine import Machine, load_machine
    from crane_model.model_file import Model, load_model, save_model
    from crane_model.record import Record
    from crane_model.simulation import Simulation, simulate

__all__ = [
    "ConfigurationError",
    "CraneError",
    "DataError",
    "Geometry",
    "Machine",
    "Model",
    "RangeError",
    "Record",
    "Simulation",
    "forward_kinematics",
    "generalized_forces",
    "inverse_dynamics",
    "lever_arms",
    "load_machine",
    "load_model",
    "save_model",
    "simulate",
    "tip_jacobian",
    "tip_position",
]

_MODULES = {
    "cylinders": ("generalized_forces", "lever_arms"),
    "dynamics": ("Geometry", "inverse_dynamics"),
    "errors": ("ConfigurationError", "CraneError", "DataError", "RangeError"),
    "kinematics": ("forward_kinematics", "tip_jacobian", "tip_position"),
    "machine": ("Machine", "load_machine"),
    "model_file": ("Model", "load_model", "save_model"),
    "record": ("Record",),
    "simulation": ("Simulation", "simulate"),
}


def __getattr__(name: str) -> object:
    for module, names in _MODULES.items():
        if name in names:
            return getattr(import_module(f"{__name__}.{module}"), name)
    raise AttributeError(f"module '{__name__}' has no attribute '{name}'")
