"""The actuators of joints, one small class each, chosen by `type` in machine files.

Importing this package imports every file of it, and every entry point `crane_model.actuators` of
other packages: a new type is one new class, registered by being defined.
"""

from importlib import import_module
from pkgutil import iter_modules

from crane_model.actuators.actuator import REGISTRY, Actuator, actuator_from_mapping
from crane_model.actuators.cylinders import CylinderActuator, HydraulicActuator
from crane_model.registry import load_installed

__all__ = [
    "REGISTRY",
    "Actuator",
    "CylinderActuator",
    "HydraulicActuator",
    "actuator_from_mapping",
]

for _file in iter_modules(__path__):
    import_module(f"{__name__}.{_file.name}")
load_installed("crane_model.actuators", REGISTRY, "an actuator")
