"""What each recording carries: one mass a recording, and which of them agree.

A mass in all recordings is a link's mass, which the model has. So masses are differences, and count
from the lightest recording. Nothing here depends on the order of the recordings.
"""

from collections.abc import Sequence

import numpy as np

from crane_identification.diagnosis.evidence import Evidence
from crane_model.terms import Term
from crane_model.terms.gravity_and_load import Load

Loads = tuple[Load, ...]

LOADS = "loads"  # the field of a term that may differ between recordings
NO_LOAD = "none"  # what the lightest recordings carry: masses count from it
MASS_SIGMAS = 4.0  # standard deviations within which two masses are the same,
MASS_SHARE = (
    0.05  # or this share of the largest difference: no load is a point, nor quite at the tip
)


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
