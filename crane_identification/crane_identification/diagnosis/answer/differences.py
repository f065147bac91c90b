"""In which recordings there is more of an unknown force, and what of the model differs in them."""

from typing import NamedTuple

import numpy as np

from crane_identification.diagnosis.answer.solved import Solved, solved
from crane_identification.diagnosis.fit.evidence import VISIBLE_SHARE, beside
from crane_identification.diagnosis.search.search import Search

FAR = 2.0  # times the median of the recordings, from which one differs
MOST = 0.5  # share of the energy beyond noise, from which recordings differ rather than the law


class Difference(NamedTuple):
    """A parameter of the model that is another one in each recording: which `share` of the energy
    beyond noise that explains, and by how much it differs from that of all, with its standard
    deviation, by recording.
    """

    parameter: str
    unit: str
    share: float
    changes: dict[str, tuple[float, float]]


def differing(search: Search, j: int) -> dict[str, float]:
    """Recordings with far more of what is left of joint number j, rms over the median of all."""
    evidence, white = search.evidence, search.whitener
    own = white.channel % len(evidence.joints) == j
    bag = evidence.bag[white.row[own]]
    power = np.bincount(bag, search.base.residual[own] ** 2, len(evidence.sources))
    rms = np.sqrt(power / np.maximum(np.bincount(bag, minlength=len(evidence.sources)), 1))
    middle = max(float(np.median(rms)), np.finfo(float).tiny)
    pairs = zip(evidence.sources, (rms / middle).tolist(), strict=True)
    return {name: ratio for name, ratio in pairs if ratio > FAR}


def difference(search: Search, j: int, beyond: float) -> Difference | None:
    """The parameter whose column explains most of joint number j where each recording has its own;
    None where that is less than most of what is `beyond` noise.
    """
    evidence, white = search.evidence, search.whitener
    parameters = evidence.model.parameters
    own = white.channel % len(evidence.joints) == j
    columns = white(evidence.base[:, :, : len(parameters)]) * own[:, np.newaxis]
    there = evidence.bag[white.row][:, np.newaxis] == np.arange(len(evidence.sources))
    tried = {
        int(i): _changes(search, columns[:, [i]] * there)
        for i in np.flatnonzero(columns.any(axis=0))
    }
    i = max(tried, key=lambda one: tried[one].gain, default=-1)
    if len(evidence.sources) < 2 or i < 0 or tried[i].gain < MOST * beyond:
        return None
    values, std_devs, gain = tried[i]
    pairs = zip(values.tolist(), std_devs.tolist(), strict=True)
    return Difference(
        parameters[i].name,
        parameters[i].unit,
        min(gain / max(beyond, 1.0), 1.0),
        dict(zip(evidence.sources, pairs, strict=True)),
    )


def _changes(search: Search, columns: np.ndarray) -> Solved:
    """One column of each recording (N, recordings): values, least from those of all."""
    rest = beside(search.base.basis, columns)
    rest[:, np.linalg.norm(rest, axis=0) <= VISIBLE_SHARE * np.linalg.norm(columns, axis=0)] = 0.0
    return solved(search, rest)
