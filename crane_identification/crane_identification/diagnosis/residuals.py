"""The residual of a model: its place, and its signatures if nothing is named."""

from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np

from crane_identification.diagnosis import findings as schema
from crane_identification.diagnosis.constants import (
    DIFFERING_RATIO,
    MOST_SHARE,
    SLIGHT_SHARE,
    VISIBLE_SHARE,
)
from crane_identification.diagnosis.evidence import (
    QUANTITIES,
    TINY,
    Evidence,
    Features,
    beside,
    normed,
)
from crane_identification.diagnosis.fit import Fitted
from crane_identification.diagnosis.gap import Gap
from crane_identification.diagnosis.judgement import Judged, held_out_gains
from crane_identification.diagnosis.projection import NOTHING
from crane_identification.diagnosis.proof import Trial
from crane_identification.diagnosis.search import ForceSignature, Search
from crane_identification.diagnosis.signatures import signatures
from crane_model.errors import ConfigurationError
from crane_model.record import Record
from crane_model.terms import Setting, Term
from crane_model.terms.gravity_and_load import BoomDirections
from crane_model.terms.term import Variable

# The quantities that laws follow: their units, and their values on the rows of the evidence.

OF_NO_JOINT: frozenset[Variable] = frozenset(
    {
        *("extension of the telescope", "inclination of the telescope"),
        *("slew velocity", "temperature", "time", "recording"),
    }
)


def on_rows(variable: Variable, evidence: Evidence, j: int) -> np.ndarray:
    """A variable (n,) of joint number j on the rows of the evidence; errors as of `read`."""
    if variable == "recording":
        return evidence.bag + 1.0
    setting = evidence.model.setting
    return np.concatenate(
        [read(variable, run.record, setting, j)[run.kept] for run in evidence.runs]
    )


def read(variable: Variable, record: Record, setting: Setting, j: int) -> np.ndarray:
    """A variable of a joint at the samples; `DataError` or `ConfigurationError` without it."""
    _, reader = QUANTITIES[variable]
    if reader is not None:
        return reader(record, j)
    if setting.machine is None:
        raise ConfigurationError(f"{variable}: needs a machine, but the model has none")
    booms = BoomDirections.of(setting.machine, record)
    both = {
        "extension of the telescope": booms.extension,
        "inclination of the telescope": booms.psi,
    }
    return both[variable]


def unit_of(name: str, joint: str | None, setting: Setting) -> str:
    """The unit of a quantity by its name without the joint."""
    q = setting.units.get(joint or "", "")
    f = setting.force_unit(joint) if q and joint else ""
    return QUANTITIES[name][0].format(q=q, f=f)


def feature_unit(feature: str, setting: Setting) -> str:
    """The unit of a quantity that a learner knows, as "velocity of outer_boom"."""
    name, _, about = feature.partition(" of ")
    return unit_of(name, about.split()[0] if about else None, setting)


# Where a residual sits: the quantity that it follows, and the range that carries most of it.

REGION_BINS = 10


def region(
    known: Features, residual: np.ndarray, used: np.ndarray, setting: Setting
) -> schema.FoundRegion | None:
    """The quantity whose value says most about the residual (n,) of one joint, by the correlation
    ratio over bins of equal numbers of rows, and the narrowest run of bins with half of the energy;
    None without rows.
    """
    if used.sum() < 5 * REGION_BINS:
        return None
    best, chosen = -1.0, None
    energy = residual[used] ** 2
    total = max(float(energy.sum()), TINY)
    for column, name in enumerate(known.names):
        values = known.values[used, column]
        edges = np.unique(np.quantile(values, np.linspace(0.0, 1.0, REGION_BINS + 1)))
        if len(edges) < 3:
            continue
        place = np.clip(np.searchsorted(edges, values, side="right") - 1, 0, len(edges) - 2)
        count = np.maximum(np.bincount(place, minlength=len(edges) - 1), 1)
        mean = np.bincount(place, residual[used], len(edges) - 1) / count
        between = float((count * mean**2).sum() / total)
        if between > best:
            best, chosen = between, (name, edges, np.bincount(place, energy, len(edges) - 1))
    if chosen is None:
        return None
    name, edges, power = chosen
    for width in range(1, len(power) + 1):
        shares = np.convolve(power, np.ones(width), "valid") / max(float(power.sum()), TINY)
        if shares.max() >= MOST_SHARE:
            break
    first, unit = int(shares.argmax()), feature_unit(name, setting)
    ends = float(edges[first]), float(edges[first + width])
    return schema.FoundRegion(variable=name, range=ends, unit=unit, share=float(shares.max()))


def regions(fit: Fitted, trial: Trial) -> list[schema.FoundRegion | None]:
    """The region of the residual of each joint."""
    evidence, out = fit.evidence, list[schema.FoundRegion | None]()
    for j in range(len(evidence.joints)):
        residual, used = trial.residual[:, j], evidence.used[:, j]
        found = region(evidence.moving.known, residual, used, fit.before.setting)
        out.append(found and found.model_copy(update={"unit": evidence.unit(found.unit)}))
    return out


def energy_shares(evidence: Evidence, trial: Trial, gap: Gap) -> np.ndarray:
    """Share (j,) of the energy beyond noise on each joint, if it is no scatter of periods."""
    channels = np.maximum(trial.energy - evidence.used.sum(axis=0), 0.0)
    beyond = channels.reshape(-1, len(evidence.joints)).sum(axis=0)
    noise = (gap.largest_before <= gap.floor) & (gap.after > (1.0 - SLIGHT_SHARE) * gap.before)
    beyond = np.where(noise & ~noise.all(), 0.0, beyond)
    total = float(beyond.sum())
    return beyond / total if total > 0.0 else np.zeros_like(beyond)


# What is known of an unknown force: size, what it may follow, and in which recordings.

LISTED_SIGNATURES = 3  # the best ones
SINGULAR_POWER = 1e-8  # of the largest eigenvalue, up to which a combination of columns is none


def unknown_force(search: Search, j: int) -> schema.UnknownPlace:
    """The residual of joint number j before anything is added: size, signatures, recordings."""
    joint, beyond = search.evidence.joints[j], float(search.unexplained_on_joints(NOTHING)[j])
    near = [_near(search, one, beyond) for one in signatures(search, joint)]
    near.sort(key=lambda one: -(one.explained_share or 0.0))
    return schema.UnknownPlace(
        joint=joint,
        relative_magnitude=float(search.strengths(search.unexplained(NOTHING))[j]),
        signatures=near[:LISTED_SIGNATURES],
        recordings=_differing(search, j),
        difference=_difference(search, j, beyond),
    )


def left_elsewhere(
    search: Search, effects: Sequence[Judged], threshold: float
) -> list[schema.UnknownPlace]:
    """Unknown forces on joints where no effect acts, largest first, if they are strong."""
    joints = search.evidence.joints
    acted = {j for one in effects for j in one.shaped.joints(joints)}
    if len(acted) == len(joints):
        return []
    left = search.widened(np.concatenate([one.shaped.columns for one in effects], axis=2))
    beyond = left.unexplained_on_joints(NOTHING)
    found = []
    for j in sorted(set(range(len(joints))) - acted):
        gains = [left.explained(one.columns) for one in signatures(left, joints[j])]
        most = min(max(gains, default=0.0), float(beyond[j]))
        if most > threshold and left.is_strong(most, j):
            found.append(unknown_force(left, j))
    return sorted(found, key=lambda one: -(one.relative_magnitude or 0.0))


def curves_of(
    evidence: Evidence, term: Term, values: Iterable[float], std_devs: Iterable[float]
) -> list[schema.FoundCurve]:
    """The nonparametric curves of a term, one for each factor, by its `values` (k,)."""
    setting, joint = evidence.model.setting, term.only_joint
    curves, spreads = (term.curves(np.array(list(one))) for one in (values, std_devs))
    return [
        schema.FoundCurve(
            variable=curve.variable,
            variable_unit=evidence.unit(unit_of(curve.variable, joint, setting)),
            knots=list(curve.knots),
            values=curve.values.tolist(),
            std_devs=spread.values.tolist(),
            unit=evidence.unit(parameter.unit),
            times=curve.times,
        )
        for curve, spread, parameter in zip(curves, spreads, term.parameters(setting), strict=False)
    ]


class Solved(NamedTuple):
    """Values (k,), least if columns coincide, their standard deviations, and 2 dlogL gained."""

    values: np.ndarray
    std_devs: np.ndarray
    gain: float


def solved(search: Search, rest: np.ndarray) -> Solved:
    """Least squares of whitened columns (N, k), of which there is this `rest` beside the base."""
    scaled, norms = normed(rest)
    spread = np.linalg.pinv(scaled.T @ scaled, rcond=SINGULAR_POWER, hermitian=True)
    score = scaled.T @ search.base.residual
    std_devs = np.sqrt(np.maximum(np.diag(spread), 0.0)) / norms
    return Solved(spread @ score / norms, std_devs, float(score @ spread @ score))


def _near(search: Search, one: ForceSignature, beyond: float) -> schema.NearbySignature:
    gains, _ = held_out_gains(search, (), one.columns)
    asked = gains[np.isfinite(gains)]
    best = solved(search, search.beside(one.columns))
    return schema.NearbySignature(
        signature=one.said,
        effects=list(one.types),
        explained_share=min(search.explained(one.columns) / max(beyond, 1.0), 1.0),
        better=int((asked > 0.0).sum()),
        asked=len(asked),
        curves=curves_of(search.evidence, one.term, best.values, best.std_devs),
    )


def _differing(search: Search, j: int) -> dict[str, float]:
    """Recordings with a far larger residual of joint number j: rms over the median of all."""
    evidence, white = search.evidence, search.whitener
    own = white.channel % len(evidence.joints) == j
    bag = evidence.bag[white.row[own]]
    power = np.bincount(bag, search.base.residual[own] ** 2, len(evidence.sources))
    rms = np.sqrt(power / np.maximum(np.bincount(bag, minlength=len(evidence.sources)), 1))
    middle = max(float(np.median(rms)), TINY)
    pairs = zip(evidence.sources, (rms / middle).tolist(), strict=True)
    return {name: ratio for name, ratio in pairs if ratio > DIFFERING_RATIO}


def _difference(search: Search, j: int, beyond: float) -> schema.FoundDifference | None:
    """The parameter that explains most of joint number j if each recording has a value of it."""
    evidence, white = search.evidence, search.whitener
    parameters, sources = evidence.model.parameters, evidence.sources
    own = white.channel % len(evidence.joints) == j
    columns = white(evidence.base[:, :, : len(parameters)]) * own[:, np.newaxis]
    there = evidence.bag[white.row][:, np.newaxis] == np.arange(len(sources))
    tried = {}
    for i in np.flatnonzero(columns.any(axis=0)).tolist() if len(sources) > 1 else ():
        each = columns[:, [i]] * there
        rest = beside(search.base.basis, each)
        hidden = np.linalg.norm(rest, axis=0) <= VISIBLE_SHARE * np.linalg.norm(each, axis=0)
        tried[i] = solved(search, np.where(hidden, 0.0, rest))
    i = max(tried, key=lambda number: tried[number].gain, default=-1)
    if i < 0 or tried[i].gain < MOST_SHARE * beyond:
        return None
    best = tried[i]
    return schema.FoundDifference(
        parameter=parameters[i].name,
        unit=evidence.unit(parameters[i].unit),
        explained_share=min(best.gain / max(beyond, 1.0), 1.0),
        changes=dict(zip(sources, best.values.tolist(), strict=True)),
        std_devs=dict(zip(sources, best.std_devs.tolist(), strict=True)),
    )
