"""The stand-in machine: its plant, what it may hide, its bus, and its picture.

Half a second with one valve open:

>>> import numpy as np
>>> from crane_model.machine import load_machine
>>> from crane_sim import Plant, load_stand_in
>>> stand_in = load_stand_in()
>>> plant = Plant(stand_in, load_machine(), stand_in.start)
>>> before = plant.q.copy()
>>> plant.advance(np.array([0.0, 0.0, 0.0, 0.4]), 0.5)
>>> moved = plant.q - before
>>> bool(moved[3] > 0.01)
True

An effect to hide in it:

>>> from crane_sim import HiddenEffect, Spec
>>> Spec(effects=(HiddenEffect(effect="stribeck", joint="telescope", strength=0.02),)).seed
0

The names of `__all__` are the public API; each is imported from its module when it is first asked
for, so that `import crane_sim` alone compiles nothing.
"""

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from crane_sim.hiding.calibrate import calibrate
    from crane_sim.hiding.label import HiddenEffect, Spec, load_spec
    from crane_sim.make_bag import make
    from crane_sim.parts.parameters import StandIn, load_stand_in, save_stand_in
    from crane_sim.plant.closed_loop import SimulatedRecording, record
    from crane_sim.plant.plant import Plant
    from crane_sim.plant.sampled import Sensors

__all__ = [
    "HiddenEffect",
    "Plant",
    "Sensors",
    "SimulatedRecording",
    "Spec",
    "StandIn",
    "calibrate",
    "load_spec",
    "load_stand_in",
    "make",
    "record",
    "save_stand_in",
]

_MODULES = {
    "hiding.calibrate": ("calibrate",),
    "hiding.label": ("HiddenEffect", "Spec", "load_spec"),
    "make_bag": ("make",),
    "parts.parameters": ("StandIn", "load_stand_in", "save_stand_in"),
    "plant.closed_loop": ("SimulatedRecording", "record"),
    "plant.plant": ("Plant",),
    "plant.sampled": ("Sensors",),
}


def __getattr__(name: str) -> object:
    for module, names in _MODULES.items():
        if name in names:
            return getattr(import_module(f"{__name__}.{module}"), name)
    raise AttributeError(f"module '{__name__}' has no attribute '{name}'")
