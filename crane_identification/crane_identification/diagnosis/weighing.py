"""What each held-out recording carries: a property of that recording, which no other can predict.

It is estimated from the recording itself, with everything else as the training recordings gave it.
"""

from dataclasses import dataclass, replace

import numpy as np

from crane_identification.diagnosis.evidence import Evidence
from crane_identification.diagnosis.loads import LOADS, MASS_SIGMAS, one_each
from crane_model.model_file import Model
from crane_model.terms import Term, candidates, typical

POWER_RATIO = 4.0
"""By how much a load that nothing in training speaks for reduces the power of what is left of the
joint that is worst off, at least; and how much more than in training is then left, at most."""
BLOCKS = 8  # of a recording, one left out at a time: what is left is not white


@dataclass(frozen=True)
class Weighed:
    """What a held-out `recording` carries [kg] beyond the lightest of those trained on.

    `found`: whether none of those differ, so that it is news that this one does.
    """

    recording: str
    mass: float
    std_dev: float
    found: bool


def weighed(
    model: Model, held_out: Evidence, left: np.ndarray, usual: np.ndarray
) -> tuple[Model, tuple[Weighed, ...]]:
    """The model with the load of each held-out recording, and these loads.

    `left` (n, c) is what the model leaves there, `usual` (c,) the rms of what it leaves in
    training. Where those trained on carry the same, a load is put in only if it makes of a residual
    that is clearly larger a usual one.
    """
    term = _term_of_loads(model)
    if term is None:
        return model, ()
    known = getattr(term, LOADS) if term in model.terms else ()
    loads = one_each(held_out)
    columns = held_out.columns(term.model_copy(update={LOADS: loads}))
    weight = np.where(held_out.used, 1.0 / np.where(usual > 0.0, usual, np.inf), 0.0)
    found, put, values = [], [], []
    for k, source in enumerate(held_out.sources):
        inside = held_out.bag == k
        rows, used = weight[inside], held_out.used[inside]
        force, column = left[inside] * rows, columns[inside, :, k] * rows
        if not column.any():
            continue
        mass, spread = _fitted(column[used], force[used])
        power, rest = (
            float(((each**2).sum(axis=0) / np.maximum(used.sum(axis=0), 1)).max())
            for each in (force, force - mass * column)
        )
        sure = (
            abs(mass) > MASS_SIGMAS * spread and POWER_RATIO * rest < power and rest < POWER_RATIO
        )
        if known or sure:
            put.append(loads[k])
            values.append(mass)
            found.append(Weighed(source, mass, spread, not known))
    if not put:
        return model, ()
    grown = term.model_copy(update={LOADS: (*known, *put)})
    if not known:
        theta, terms = np.append(model.theta, values), (*model.terms, grown)
    else:
        theta = np.insert(model.theta, model.part(term).stop, values)
        terms = tuple(grown if one == term else one for one in model.terms)
    return replace(model, terms=terms, values=theta, std_devs=None), tuple(found)


def _term_of_loads(model: Model) -> Term | None:
    """The term of the model whose loads may differ, or else a new one; None if it can hold none."""
    for term in model.terms:
        if getattr(term, LOADS, None) is not None:
            return term
    if any(LOADS in type(term).model_fields for term in model.terms):
        return None  # one mass in every run: the model says that none differs
    held = candidates(model.setting)
    return next((typical(cls) for cls in held if LOADS in cls.model_fields), None)


def _fitted(column: np.ndarray, force: np.ndarray) -> tuple[float, float]:
    """Coefficient of the column (n,) in the force, and its standard deviation by the jackknife."""
    block = np.arange(len(force)) * BLOCKS // max(len(force), 1)
    product, power = (np.bincount(block, each * column, BLOCKS) for each in (force, column))
    mass = product.sum() / power.sum()
    without = (product.sum() - product) / (power.sum() - power)
    return float(mass), float(np.sqrt((BLOCKS - 1) / BLOCKS * ((without - mass) ** 2).sum()))
