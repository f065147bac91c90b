"""Machine, geometry, dynamics, terms and forward simulation of the crane; no ROS, no CAN.

A public name is imported from its module when it is first asked for, so that `import crane_model`
alone compiles nothing.

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

from typing import TYPE_CHECKING

from crane_model.lazily import lazily

if TYPE_CHECKING:
    from crane_model.cylinders import generalized_forces as generalized_forces
    from crane_model.cylinders import lever_arms as lever_arms
    from crane_model.errors import ConfigurationError as ConfigurationError
    from crane_model.errors import CraneError as CraneError
    from crane_model.errors import DataError as DataError
    from crane_model.errors import RangeError as RangeError
    from crane_model.kinematics import forward_kinematics as forward_kinematics
    from crane_model.kinematics import tip_jacobian as tip_jacobian
    from crane_model.kinematics import tip_position as tip_position
    from crane_model.machine import Machine as Machine
    from crane_model.machine import load_machine as load_machine
    from crane_model.model_file import Model as Model
    from crane_model.model_file import load_model as load_model
    from crane_model.model_file import save_model as save_model
    from crane_model.record import Record as Record
    from crane_model.simulation import Simulation as Simulation
    from crane_model.simulation import simulate as simulate

__getattr__, __dir__, __all__ = lazily(__name__, __file__)
