"""Machine, geometry, dynamics, terms and forward simulation of the crane; no ROS, no CAN.

The names of `__all__` are the public API; each is imported from its module when it is first asked
for, so that `import crane_model` alone compiles nothing.
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
