"""The balance of flow of a cylinder: what its piston sweeps is what its terms supply.

    A_A x' =  Q_A(u, p) - C (p_A - p_B) - (V_A/beta) p_A'
   -A_B x' =  Q_B(u, p) + C (p_A - p_B) - (V_B/beta) p_B'

with areas A and pressures p of (19), the length x of (20) or (24), and flow Q positive into a
chamber. The left side is measured; on the right, each term is linear in its parameters.
"""

from collections.abc import Sequence

import numpy as np

from crane_model.array import Array
from crane_model.cylinders import lever_arm
from crane_model.errors import DataError
from crane_model.flow.flow_term import FlowTerm
from crane_model.machine import Machine
from crane_model.record import Record


def piston_flow(record: Record, machine: Machine, joint: str) -> Array:
    """A_A x' and -A_B x': (n, 2) [m3/s]; x' = dx/dq q' (18)."""
    j, cylinder = record.column(joint), machine.cylinders[joint]
    speed = lever_arm(machine, joint, record.position[:, j]) * record.velocity[:, j]
    return speed[:, np.newaxis] * (cylinder.area_a, -cylinder.area_b)


def flow_regressor(terms: Sequence[FlowTerm], record: Record, machine: Machine) -> Array:
    """Columns of the terms side by side, (n, 2, p), for the piston flow of their one joint.

    `DataError` if there is no term, or terms of several joints: their flows do not share a balance.
    """
    joints = {term.joint for term in terms}
    if len(joints) != 1:
        raise DataError(
            "flow balance: needs terms of one joint, got "
            + (", ".join(sorted(joints)) or "no term at all")
        )
    return np.concatenate([term.columns(record, machine) for term in terms], axis=2)
