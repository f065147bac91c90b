"""Which law of one signature an effect follows, told by where its shape bends.

Friction that falls with the speed and a loss that rises beyond it are both bent upwards. Beside
Coulomb and viscous friction, a law of the one that is not quite the machine's may fit the other.
"""

from collections.abc import Sequence

import numpy as np

from crane_identification.diagnosis.search.candidates import Candidate
from crane_identification.diagnosis.search.energy import explained
from crane_identification.diagnosis.search.search import Search
from crane_identification.diagnosis.search.shapes import shape_of
from crane_identification.thresholds import Thresholds


def likelier(
    search: Search, law: Candidate, rest: Sequence[np.ndarray], thresholds: Thresholds
) -> tuple[str, ...]:
    """Types of the laws at whose bends a shape explains clearly more than at those of `law`, beside
    the `rest` (n, c, k each); best first.
    """
    cls, shaped = shape_of(law), search.shapes.of(law)
    if cls is None or shaped is None or law.type not in cls.bends:
        return ()
    known = explained(search, *rest) if rest else 0.0
    gains = {
        kind: explained(search, *rest, shaped.columns[:, :, cls.at_bend(kind)]) - known
        for kind in cls.bends
    }
    least = (1.0 + thresholds.method.form_share) * gains[law.type]
    better = [kind for kind, gain in gains.items() if gain > least]
    return tuple(sorted(better, key=lambda kind: -gains[kind]))
