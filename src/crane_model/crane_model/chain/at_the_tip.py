"""Loads at the tip as bodies of the chain: see `crane_model.chain.dynamics` for the ten numbers."""

import numpy as np

from crane_model.array import Array
from crane_model.chain.serial_chain import SerialChain


def tip_bodies(chain: SerialChain) -> Array:
    """(2, m, 10): 1 kg at the tip; 1 kg m about it, along the line from the last joint to the tip.

    A load m whose centre lies c beyond the tip is m times the first and m c times the second.
    """
    tip = chain.tip_translation
    reach = float(np.linalg.norm(tip))
    along = tip / reach if reach else chain.axis[-1]
    bodies = np.zeros((2, len(chain.axis), 10))
    bodies[0, -1] = _body(1.0, tip, np.outer(tip, tip))
    bodies[1, -1] = _body(0.0, along, np.outer(tip, along) + np.outer(along, tip))
    return bodies


def _body(mass: float, moment: Array, second: Array) -> Array:
    """(10,) from the mass, the first moment (3,) and the second (3, 3) about the link's origin."""
    inertia = np.trace(second) * np.eye(3) - second
    return np.array(
        [mass, *moment, inertia[0, 0], inertia[0, 1], inertia[1, 1], inertia[0, 2], inertia[1, 2],
         inertia[2, 2]]
    )  # fmt: skip
