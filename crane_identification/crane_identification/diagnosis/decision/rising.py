"""Whether a shape that was drawn rises throughout, where every law of its effect does.

A hose or a cord holds back more, the further it is bent. A spring that snaps over its centre pulls
back, then pushes: what it does follows the position as well, and is of no effect of the catalogue.
"""

from collections.abc import Sequence

import numpy as np
from scipy.optimize import nnls

from crane_identification.diagnosis.decision.shape import chance_of
from crane_identification.diagnosis.fit.evidence import beside, leading
from crane_identification.diagnosis.search.candidates import ShapedCandidate
from crane_identification.diagnosis.search.search import Search
from crane_identification.diagnosis.search.shapes import shape_of
from crane_identification.thresholds import Thresholds


def falls(
    search: Search, drawn: ShapedCandidate, rest: Sequence[np.ndarray], thresholds: Thresholds
) -> bool:
    """Whether a shape explains clearly more, beside the `rest` (n, c, k each), than the best one
    that rises from knot to knot, where its laws do.
    """
    cls = shape_of(drawn.candidate)
    if cls is None or not cls.rises:
        return False
    base, count = search.base, drawn.columns.shape[2]
    steps = drawn.columns @ np.tril(np.ones((count, count)))  # from each knot to the next
    # The first one is free: with it is what the model may lack of a constant force.
    others = np.concatenate([*rest, steps[:, :, :1]], axis=2)
    known, own = (
        beside(base.basis, search.whitener(columns)) for columns in (others, steps[:, :, 1:])
    )
    known = leading(known, known.shape[1])
    own, force = beside(known, own), beside(known, base.residual)
    norms = np.linalg.norm(own, axis=0)
    own = own[:, norms > 0.0] / norms[norms > 0.0]
    free = float(((leading(own, own.shape[1]).T @ force) ** 2).sum())
    _, left = nnls(own, force)
    rising = float(force @ force) - left**2
    least = max(chance_of(drawn.columns, thresholds), thresholds.method.elsewhere_share * free)
    return free - rising > least
