"""The simulated crane: its plant, effects to inject, its bus, and its picture.

Half a second with one valve open:

>>> import numpy as np
>>> from crane_model.machine import load_machine
>>> from crane_sim import Plant, load_simulated_crane
>>> simulated = load_simulated_crane()
>>> plant = Plant(simulated, load_machine(), simulated.start)
>>> before = plant.q.copy()
>>> plant.advance(np.array([0.0, 0.0, 0.0, 0.4]), 0.5)
>>> moved = plant.q - before
>>> bool(moved[3] > 0.01)
True

An effect to inject:

>>> from crane_sim import InjectedEffect, Spec
>>> stribeck = InjectedEffect(effect="stribeck", joint="telescope", relative_magnitude=0.02)
>>> Spec(effects=(stribeck,)).seed
0

A public name is imported from its module when it is first asked for, so that `import crane_sim`
alone compiles nothing.
"""

from typing import TYPE_CHECKING

from crane_model.lazily import lazily

if TYPE_CHECKING:
    from crane_sim.calibration import calibrate as calibrate
    from crane_sim.ground_truth import InjectedEffect as InjectedEffect
    from crane_sim.ground_truth import Spec as Spec
    from crane_sim.ground_truth import load_spec as load_spec
    from crane_sim.make_bag import make as make
    from crane_sim.parts.parameters import SimulatedCrane as SimulatedCrane
    from crane_sim.parts.parameters import load_simulated_crane as load_simulated_crane
    from crane_sim.parts.parameters import save_simulated_crane as save_simulated_crane
    from crane_sim.plant.closed_loop import SimulatedRecording as SimulatedRecording
    from crane_sim.plant.closed_loop import record as record
    from crane_sim.plant.plant import Plant as Plant
    from crane_sim.plant.sampled import Sensors as Sensors

__getattr__, __dir__, __all__ = lazily(__name__, __file__)
