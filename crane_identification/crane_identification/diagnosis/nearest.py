"""The best of the catalogue where it is not good enough: what it explains, and why not."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from crane_identification.diagnosis.decision import Judged
from crane_identification.diagnosis.extension import extended
from crane_identification.diagnosis.fit import Fitted
from crane_identification.diagnosis.gap import relative, residual, with_own_loads
from crane_identification.diagnosis.refit import UndeterminedError
from crane_identification.diagnosis.search import Search


@dataclass(frozen=True)
class Nearest:
    """Effects that come closest to what is missing, strongest first, and why they are no names.

    `explained`: share of the energy beyond noise where they act. Held-out errors (j,) `before` and
    `after` they are added; these are NaN where the recordings do not determine them.
    """

    joints: tuple[str, ...]
    effects: tuple[Judged, ...]
    explained: float
    before: np.ndarray
    after: np.ndarray
    objection: str


def nearest(fit: Fitted, search: Search, effects: Sequence[Judged], objection: str) -> Nearest:
    """What `effects` would do to the fitted model."""
    before, held_out = fit.before, fit.held_out
    old = relative(held_out, residual(held_out, before))
    try:
        after, _ = extended(search, before, effects, fit.training)
        carried, _ = with_own_loads(after, fit.evidence, held_out)
        new = relative(held_out, residual(held_out, carried))
    except UndeterminedError:
        new = np.full_like(old, np.nan)
    left = search.left_share([one.option for one in effects])
    return Nearest(
        joints=before.joints,
        effects=tuple(effects),
        explained=float(np.clip(1.0 - left, 0.0, 1.0)),
        before=old,
        after=new,
        objection=objection,
    )
