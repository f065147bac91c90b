"""The flow of oil through a cylinder as a sum of terms: what pressures and valve command tell.

Measured pressures are the input of the torque model, so that valves, leakage and oil cannot show
in the residual of torque. They show in the balance of flow of each chamber. The report leaves the
hydraulics to future work (its section 5); the symbols of areas and pressures are those of (19).
"""

from crane_model.flow import oil, valve
from crane_model.flow.balance import flow_regressor, piston_flow
from crane_model.flow.effects import FLOW_EFFECTS, FlowEffect
from crane_model.flow.flow_term import FlowTerm

__all__ = [
    "FLOW_EFFECTS",
    "FlowEffect",
    "FlowTerm",
    "flow_regressor",
    "oil",
    "piston_flow",
    "valve",
]
