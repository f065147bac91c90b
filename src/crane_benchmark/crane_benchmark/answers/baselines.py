"""What other methods answer from the same residual and the same columns, whitened alike."""

import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from crane_identification.diagnosis.search.search import Search

MOST = 8  # effects in an answer
SPARSITIES = 12  # thresholds that are tried
LEAST = 2.0  # of them, in standard deviations of a coefficient
FACTOR = "pressure_gain"  # of all joints together, its columns are the masses of the model
SINGULAR = 1e-3  # share of a column's norm beside the chosen ones, below which it is one of them

Names = list[tuple[str, str]]
"""Effects, strongest first, each with its joint or `all`."""


@dataclass(frozen=True)
class Problem:
    """Linear regression: the residual (N,) beside the model, and of each testable effect its best
    column (N, K) of norm one; rows are independent and of variance one. `energy` (j,) per joint.
    """

    residual: np.ndarray
    columns: np.ndarray
    names: Names
    joints: tuple[str, ...]
    energy: np.ndarray


def problem(search: Search) -> Problem:
    """Every candidate at the shape that alone explains most."""
    projection, joints = search.projection, search.evidence.joints
    best: dict[tuple[str, str], tuple[float, np.ndarray]] = {}
    for shaped, members in zip(projection.candidates, projection.columns_of, strict=True):
        columns = projection.columns[:, members]
        fitted = columns @ np.linalg.lstsq(columns, projection.residual, rcond=1e-9)[0]
        norm = float(np.linalg.norm(fitted))
        name = (shaped.candidate.type, shaped.candidate.where)
        if name[0] != FACTOR and norm > best.get(name, (0.0, fitted))[0]:
            best[name] = (norm, fitted / norm)
    channel = search.whitener.channel % len(joints)
    return Problem(
        projection.residual,
        np.stack([column for _, column in best.values()], axis=1),
        list(best),
        joints,
        np.bincount(channel, projection.residual**2 - 1.0, len(joints)),
    )


def always_stribeck(given: Problem) -> Names:
    """The usual suspect, on the joint with most energy beyond noise."""
    return [("stribeck", given.joints[int(np.argmax(given.energy))])]


def sparse_regression(given: Problem) -> Names:
    """Sequentially thresholded least squares (pysindy), its threshold by BIC."""
    from pysindy import STLSQ

    strongest = float(np.abs(given.columns.T @ given.residual).max())
    best, chosen = _bic(given, []), np.zeros(len(given.names))
    for sparsity in np.geomspace(LEAST, max(0.9 * strongest, 2.0 * LEAST), SPARSITIES):
        optimizer = STLSQ(threshold=float(sparsity), alpha=0.0)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of thresholds that leave nothing
            optimizer.fit(given.columns, given.residual[:, np.newaxis])
        values = np.asarray(optimizer.coef_)[0]
        score = _bic(given, np.flatnonzero(values).tolist())
        if score < best:
            best, chosen = score, values
    return [given.names[i] for i in np.argsort(-np.abs(chosen)) if chosen[i]]


def forward_regression(given: Problem) -> Names:
    """Forward orthogonal regression: what reduces the error most is added until BIC rises."""
    inside: list[int] = []
    score = _bic(given, inside)
    while len(inside) < min(MOST, len(given.names)):
        basis = np.linalg.qr(given.columns[:, inside])[0]
        rest = given.columns - basis @ (basis.T @ given.columns)
        norms = np.linalg.norm(rest, axis=0)
        usable = norms > SINGULAR
        gains = np.where(usable, (rest.T @ given.residual) / np.where(usable, norms, 1.0), 0.0) ** 2
        larger = [*inside, int(np.argmax(gains))]
        if _bic(given, larger) >= score:
            break
        inside, score = larger, _bic(given, larger)
    return [given.names[i] for i in inside]


def _bic(given: Problem, inside: Sequence[int]) -> float:
    """Bayes' information criterion of a least-squares fit of these columns, without constants."""
    basis = np.linalg.qr(given.columns[:, list(inside)])[0]
    left = given.residual - basis @ (basis.T @ given.residual)
    n = len(left)
    return n * float(np.log(left @ left)) + len(inside) * float(np.log(n))


METHODS: dict[str, Callable[[Problem], Names]] = {
    "always Stribeck": always_stribeck,
    "sparse regression (SINDy)": sparse_regression,
    "forward regression (FROLS)": forward_regression,
}


def answers(search: Search) -> dict[str, Names]:
    """The answer of every method; where pysindy is not installed, it is left out."""
    given = problem(search)
    out = {}
    for name, method in METHODS.items():
        try:
            out[name] = method(given)
        except ImportError:
            continue
    return out
