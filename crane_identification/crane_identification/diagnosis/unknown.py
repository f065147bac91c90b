"""What is known of an unknown force: joint, size, what it may follow, and in which recordings."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from crane_identification.data.column_map import COUNTS
from crane_identification.diagnosis.decision.judgement import Judged, held_out_gains
from crane_identification.diagnosis.decision.signatures import signatures
from crane_identification.diagnosis.findings import (
    FoundCurve,
    FoundDifference,
    NearbySignature,
    UnknownPlace,
)
from crane_identification.diagnosis.fit.evidence import VISIBLE_SHARE, beside, normed
from crane_identification.diagnosis.residuals import unit_of
from crane_identification.diagnosis.search.search import (
    ForceSignature,
    Search,
    explained,
    strength_on,
    strengths,
    unexplained,
    unexplained_on_joints,
    widened,
)
from crane_identification.diagnosis.search.selection import NOTHING
from crane_identification.thresholds import Thresholds
from crane_model.terms import Setting, Term

LISTED_SIGNATURES = 3  # the best ones
DIFFERING_RATIO = 2.0  # times the median of the recordings, from which one differs
DIFFERENCE_SHARE = 0.5
"""Share of the energy beyond noise, from which recordings differ rather than the model form."""
SINGULAR_SHARE = 1e-8  # of the largest eigenvalue, up to which a combination of columns is none


def unknown_force(search: Search, j: int, counts: bool = False) -> UnknownPlace:
    """What is known of the residual of joint number j before anything is added.

    With `counts`, its units are those of sensors that are not calibrated.
    """
    joint, beyond = search.evidence.joints[j], float(unexplained_on_joints(search, NOTHING)[j])
    near = [_near(search, one, beyond, counts) for one in signatures(search, joint)]
    near.sort(key=lambda one: -(one.explained_share or 0.0))
    return UnknownPlace(
        joint=joint,
        relative_magnitude=float(strengths(search, unexplained(search, NOTHING))[j]),
        signatures=near[:LISTED_SIGNATURES],
        recordings=_differing(search, j),
        difference=_difference(search, j, beyond, counts),
    )


def left_elsewhere(
    search: Search,
    effects: Sequence[Judged],
    threshold: float,
    thresholds: Thresholds,
    counts: bool = False,
) -> tuple[UnknownPlace, ...]:
    """What `effects` leave on each joint where none of them acts, largest first.

    A joint counts if one of its signatures explains more than chance gives to the best effect of
    the catalogue, `threshold`, and more than the errors of the processing.
    """
    joints = search.evidence.joints
    acted = {j for one in effects for j in one.shaped.joints(joints)}
    elsewhere = [j for j in range(len(joints)) if j not in acted]
    if not elsewhere:
        return ()
    left = widened(search, np.concatenate([one.shaped.columns for one in effects], axis=2))
    beyond = unexplained_on_joints(left, NOTHING)
    found = []
    for j in elsewhere:
        gains = [explained(left, one.columns) for one in signatures(left, joints[j])]
        most = min(max(gains, default=0.0), float(beyond[j]))
        strong = strength_on(left, most, j) >= thresholds.gates.smallest_strength
        if most > threshold and strong:
            found.append(unknown_force(left, j, counts))
    return tuple(sorted(found, key=lambda one: -(one.relative_magnitude or 0.0)))


def curves_of(
    term: Term,
    joint: str,
    setting: Setting,
    values: np.ndarray,
    std_devs: np.ndarray,
    counts: bool,
) -> list[FoundCurve]:
    """The nonparametric curves of a term, one for each factor, by its `values` (k,)."""
    parameters = term.parameters(setting)
    pairs = zip(term.curves(values), term.curves(std_devs), strict=True)
    return [
        FoundCurve(
            variable=curve.variable,
            variable_unit=unit_of(curve.variable, joint, setting, counts),
            knots=list(curve.knots),
            values=curve.values.tolist(),
            std_devs=spread.values.tolist(),
            unit=as_counted(parameters[k].unit, counts),
            times=curve.times,
        )
        for k, (curve, spread) in enumerate(pairs)
    ]


def as_counted(unit: str, counts: bool) -> str:
    """The unit of a parameter where sensors give counts."""
    return COUNTS if counts and unit != "1" else unit


class Solved(NamedTuple):
    """Values (k,), least where columns coincide, their standard deviations, and 2 dlogL gained."""

    values: np.ndarray
    std_devs: np.ndarray
    gain: float


def solved(search: Search, rest: np.ndarray) -> Solved:
    """Least squares of whitened columns (N, k), of which there is this `rest` beside the base."""
    scaled, norms = normed(rest)
    spread = np.linalg.pinv(scaled.T @ scaled, rcond=SINGULAR_SHARE, hermitian=True)
    score = scaled.T @ search.base.residual
    std_devs = np.sqrt(np.maximum(np.diag(spread), 0.0)) / norms
    return Solved(spread @ score / norms, std_devs, float(score @ spread @ score))


def _near(search: Search, one: ForceSignature, beyond: float, counts: bool) -> NearbySignature:
    gains, _ = held_out_gains(search, (), one.columns)
    asked = gains[np.isfinite(gains)]
    return NearbySignature(
        signature=one.said,
        effects=list(one.types),
        explained_share=min(explained(search, one.columns) / max(beyond, 1.0), 1.0),
        better=int((asked > 0.0).sum()),
        asked=len(asked),
        curves=_best_curves(search, one, counts),
    )


def _best_curves(search: Search, one: ForceSignature, counts: bool) -> list[FoundCurve]:
    """The best curves of a signature, beside the model; empty if it has none."""
    best = solved(search, beside(search.base.basis, search.whitener(one.columns)))
    setting = search.evidence.model.setting
    joint = one.term.only_joint or ""
    return curves_of(one.term, joint, setting, best.values, best.std_devs, counts)


def _differing(search: Search, j: int) -> dict[str, float]:
    """Recordings with a far larger residual of joint number j: rms over the median of all."""
    evidence, white = search.evidence, search.whitener
    own = white.channel % len(evidence.joints) == j
    bag = evidence.bag[white.row[own]]
    power = np.bincount(bag, search.base.residual[own] ** 2, len(evidence.sources))
    rms = np.sqrt(power / np.maximum(np.bincount(bag, minlength=len(evidence.sources)), 1))
    middle = max(float(np.median(rms)), np.finfo(float).tiny)
    pairs = zip(evidence.sources, (rms / middle).tolist(), strict=True)
    return {name: ratio for name, ratio in pairs if ratio > DIFFERING_RATIO}


def _difference(search: Search, j: int, beyond: float, counts: bool) -> FoundDifference | None:
    """The parameter whose column explains most of joint number j if each recording has its own
    value; None if that is less than most of the energy `beyond` noise.
    """
    evidence, white = search.evidence, search.whitener
    parameters, sources = evidence.model.parameters, evidence.sources
    own = white.channel % len(evidence.joints) == j
    columns = white(evidence.base[:, :, : len(parameters)]) * own[:, np.newaxis]
    there = evidence.bag[white.row][:, np.newaxis] == np.arange(len(sources))
    tried = {
        int(i): _changes(search, columns[:, [i]] * there)
        for i in np.flatnonzero(columns.any(axis=0))
    }
    i = max(tried, key=lambda number: tried[number].gain, default=-1)
    if len(sources) < 2 or i < 0 or tried[i].gain < DIFFERENCE_SHARE * beyond:
        return None
    best = tried[i]
    return FoundDifference(
        parameter=parameters[i].name,
        unit=as_counted(parameters[i].unit, counts),
        explained_share=min(best.gain / max(beyond, 1.0), 1.0),
        changes=dict(zip(sources, best.values.tolist(), strict=True)),
        std_devs=dict(zip(sources, best.std_devs.tolist(), strict=True)),
    )


def _changes(search: Search, columns: np.ndarray) -> Solved:
    """One column of each recording (N, recordings): values, least from those of all."""
    rest = beside(search.base.basis, columns)
    rest[:, np.linalg.norm(rest, axis=0) <= VISIBLE_SHARE * np.linalg.norm(columns, axis=0)] = 0.0
    return solved(search, rest)
