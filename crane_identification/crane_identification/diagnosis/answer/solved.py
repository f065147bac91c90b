"""Values of columns beside the base, by least squares."""

from typing import NamedTuple

import numpy as np

from crane_identification.diagnosis.fit.evidence import normed
from crane_identification.diagnosis.search.search import Search

SINGULAR_SHARE = 1e-8  # of the largest eigenvalue, up to which a combination of columns is none


class Solved(NamedTuple):
    """Values (k,), least where columns coincide, their standard deviations, and 2 dlogL gained."""

    values: np.ndarray
    std_devs: np.ndarray
    gain: float


def solved(search: Search, rest: np.ndarray) -> Solved:
    """Of whitened columns (N, k), of which there is this `rest` beside the base."""
    scaled, norms = normed(rest)
    spread = np.linalg.pinv(scaled.T @ scaled, rcond=SINGULAR_SHARE, hermitian=True)
    score = scaled.T @ search.base.residual
    std_devs = np.sqrt(np.maximum(np.diag(spread), 0.0)) / norms
    return Solved(spread @ score / norms, std_devs, float(score @ spread @ score))
