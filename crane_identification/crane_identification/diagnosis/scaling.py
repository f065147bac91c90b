"""Columns of one size, so that the cutoff of a least-squares fit does not depend on their units."""

import numpy as np


def normed(columns: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Columns (n, k) divided by their norms (k,), and these; 1 in place of a norm of 0."""
    norms = np.linalg.norm(columns, axis=0)
    norms = np.where(norms > 0.0, norms, 1.0)
    return columns / norms, norms
