"""What each recording carries: one mass a recording, and which of them agree.

A mass in all recordings is a link's mass, which the model has. So masses are differences, and count
from the lightest recording. Nothing here depends on the order of the recordings.

What a held-out recording carries, no other can predict. It is estimated from the recording itself,
with everything else as the training recordings gave it.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from crane_identification.diagnosis.fit.evidence import Evidence, residual
from crane_model.model_file import Model
from crane_model.terms import Term, candidates, typical
from crane_model.terms.term import Load

Loads = tuple[Load, ...]

LOADS = "loads"  # the field of a term that carries them
NO_LOAD = "none"  # what the lightest recordings carry: masses count from it
MASS_SIGMAS = 4.0  # standard deviations within which two masses are the same,
MASS_SHARE = (
    0.05  # or this share of the largest difference: no load is a point, nor quite at the tip
)

POWER_RATIO = 4.0
"""By how much a load that nothing in training speaks for reduces the power of what is left of the
joint that is worst off, at least; and how much more than in training is then left, at most."""
BLOCKS = 8  # of a recording, one left out at a time: what is left is not white


def load_of(evidence: Evidence, recordings: Sequence[int]) -> Load:
    """One load in these recordings of the evidence."""
    names = evidence.sources
    return Load(
        runs=tuple(sorted(run for i in recordings for run in evidence.bags[i])),
        recordings=tuple(sorted(names[i] for i in recordings)),
    )


def one_each(evidence: Evidence) -> Loads:
    """A load of its own in each recording."""
    return tuple(load_of(evidence, [i]) for i in range(len(evidence.bags)))


def heavier(evidence: Evidence, cls: type[Term]) -> tuple[Loads, ...]:
    """One load in the heaviest recording, in the two heaviest, and so on, in all but the lightest.

    By a mass in each recording, estimated beside the model, all but a common one. Whatever
    recordings are loaded, they are the heaviest.
    """
    columns = evidence.columns(cls.model_validate({LOADS: one_each(evidence)}))
    masses = evidence.roughly(columns)[-columns.shape[2] :]
    order = np.argsort(-masses, kind="stable").tolist()
    return tuple((load_of(evidence, order[:count]),) for count in range(1, len(order)))


def agreeing(information: np.ndarray, score: np.ndarray, variance: float) -> list[list[int]]:
    """The recordings grouped by mass, lightest first.

    `information` (b, b) and `score` (b,) are those of the masses, with unit noise; `variance` is
    what noise and all that no mass explains have really.
    """
    masses = np.linalg.pinv(information, rcond=1e-9, hermitian=True) @ score
    groups = [[int(i)] for i in np.argsort(masses, kind="stable")]
    while True:
        means, gain = _of_groups(groups, information, score)
        joined = [
            [*groups[:k], groups[k] + groups[k + 1], *groups[k + 2 :]]
            for k in range(len(groups) - 1)
        ]
        lost = np.array([gain - _of_groups(one, information, score)[1] for one in joined])
        same = (lost < MASS_SIGMAS**2 * variance) | (np.diff(means) < MASS_SHARE * np.ptp(means))
        if not same.any():
            return groups
        groups = joined[int(np.argmin(np.where(same, lost, np.inf)))]


def _of_groups(
    groups: Sequence[Sequence[int]], information: np.ndarray, score: np.ndarray
) -> tuple[np.ndarray, float]:
    """The mass (k,) of each group, and what they gain together."""
    member = np.zeros((len(score), len(groups)))
    for k, group in enumerate(groups):
        member[list(group), k] = 1.0
    means = np.linalg.pinv(member.T @ information @ member, rcond=1e-9, hermitian=True) @ (
        member.T @ score
    )
    return means, float(means @ member.T @ score)


@dataclass(frozen=True)
class Weighed:
    """What a held-out `recording` carries [kg] beyond the lightest of those trained on.

    `found`: whether none of those differ, so that it is news that this one does.
    """

    recording: str
    mass: float
    std_dev: float
    found: bool


def with_own_loads(
    model: Model, training: Evidence, held_out: Evidence
) -> tuple[Model, tuple[Weighed, ...]]:
    """The model with what each held-out recording carries, and these loads."""
    usual = training.rms(residual(training, model))
    return weighed(model, held_out, residual(held_out, model), usual)


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
    known, loads = term.carried, one_each(held_out)
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
    own = [term for term in model.terms if term.carries_loads]
    if own:  # without loads it is one mass in every run: the model says that none differs
        return next((term for term in own if term.of_recordings), None)
    held = candidates(model.setting)
    return next((typical(cls) for cls in held if cls.carries_loads), None)


def _fitted(column: np.ndarray, force: np.ndarray) -> tuple[float, float]:
    """Coefficient of the column (n,) in the force, and its standard deviation by the jackknife."""
    block = np.arange(len(force)) * BLOCKS // max(len(force), 1)
    product, power = (np.bincount(block, each * column, BLOCKS) for each in (force, column))
    mass = product.sum() / power.sum()
    without = (product.sum() - product) / (power.sum() - power)
    return float(mass), float(np.sqrt((BLOCKS - 1) / BLOCKS * ((without - mass) ** 2).sum()))
