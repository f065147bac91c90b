"""What a model leaves: where it sits, and what is known of it if nothing is named."""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from crane_identification.data.column_map import COUNTS
from crane_identification.diagnosis.evidence import (
    MOST_SHARE,
    VISIBLE_SHARE,
    Evidence,
    Features,
    beside,
    normed,
    way_since_turned,
)
from crane_identification.diagnosis.findings import (
    FoundCurve,
    FoundDifference,
    FoundRegion,
    NearbySignature,
    UnknownPlace,
)
from crane_identification.diagnosis.fit import Fitted
from crane_identification.diagnosis.gap import Gap
from crane_identification.diagnosis.judgement import Judged, held_out_gains
from crane_identification.diagnosis.proof import Trial
from crane_identification.diagnosis.search import (
    ForceSignature,
    Search,
    explained,
    strength_on,
    strengths,
    unexplained,
    unexplained_on_joints,
    widened,
)
from crane_identification.diagnosis.selection import NOTHING
from crane_identification.diagnosis.signatures import signatures
from crane_identification.thresholds import Thresholds
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
_BY = "a plot against it"
_QUANTITIES: dict[str, tuple[str, Callable[[Record, int], np.ndarray] | None]] = {
    "position": ("{q}", lambda record, j: record.position[:, j]),
    "velocity": ("{q}/s", lambda record, j: record.velocity[:, j]),
    "acceleration": ("{q}/s2", lambda record, j: record.acceleration[:, j]),
    "way": ("{q}", None),
    "way since it turned": (
        "{q}",
        lambda record, j: way_since_turned(record.position[:, j], record.velocity[:, j]),
    ),
    "force": ("{f}", lambda record, j: record.needed("force", _BY)[:, j]),
    "force against the motion": (
        "{f}",
        lambda record, j: record.needed("force", _BY)[:, j] * record.direction[:, j],
    ),
    "rate of the force": ("{f}/s", lambda record, j: _rate_of_force(record)[:, j]),
    "lead": ("s", None),
    "pressure sum": (
        "Pa",
        lambda record, j: (record.needed("pressure_a", _BY) + record.needed("pressure_b", _BY))[
            :, j
        ],
    ),
    "pressure of chamber B": ("Pa", lambda record, j: record.needed("pressure_b", _BY)[:, j]),
    "valve command": ("1", None),
    "extension of the telescope": ("m", None),
    "inclination of the telescope": ("rad", None),
    "slew velocity": ("rad/s", lambda record, j: record.needed("slew_velocity", _BY)),
    "temperature": ("°C", lambda record, j: record.needed("temperature", _BY)),
    "time": ("s", lambda record, j: record.time),
    "recording": ("1", None),
}
"""Units, with those of the coordinate {q} and the force {f} of a joint, and how they are read."""


def _rate_of_force(record: Record) -> np.ndarray:
    known = record.force_rate
    return record.rate(record.needed("force", _BY)) if known is None else known


def on_rows(variable: Variable, evidence: Evidence, j: int) -> np.ndarray:
    """A variable (n,) of joint number j on the rows of the evidence. `DataError` if it was not
    recorded, `ConfigurationError` if the machine is not of its kind.
    """
    if variable == "recording":
        return evidence.bag + 1.0
    setting = evidence.model.setting
    return np.concatenate(
        [read(variable, run.record, setting, j)[run.kept] for run in evidence.runs]
    )


def read(variable: Variable, record: Record, setting: Setting, j: int) -> np.ndarray:
    """A variable (n,) of joint number j at the samples of a record; errors as of `on_rows`."""
    _, reader = _QUANTITIES[variable]
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


def unit_of(name: str, joint: str | None, setting: Setting, counts: bool = False) -> str:
    """The unit of a quantity by its name without the joint; `counts` where sensors give these."""
    q = setting.units.get(joint or "", "")
    f = setting.force_unit(joint) if q and joint else ""
    unit = _QUANTITIES[name][0].format(q=q, f=f)
    return COUNTS if counts and unit not in ("1", "s", "°C") else unit


def feature_unit(feature: str, setting: Setting, counts: bool = False) -> str:
    """The unit of a quantity that a learner knows, as "velocity of outer_boom"."""
    name, _, about = feature.partition(" of ")
    return unit_of(name, about.split()[0] if about else None, setting, counts)


# Where a residual sits: the quantity that it follows, and the range that carries most of it.

REGION_BINS = 10
UNCHANGED_ERROR = 0.95  # of an error, above which effects did not lessen it


def region(
    known: Features, residual: np.ndarray, used: np.ndarray, setting: Setting, counts: bool = False
) -> FoundRegion | None:
    """The quantity whose value says most about the residual (n,) of one joint, by the correlation
    ratio over bins of equal numbers of rows, and the narrowest run of bins with half of the energy;
    None without rows.
    """
    if used.sum() < 5 * REGION_BINS:
        return None
    best, chosen = -1.0, None
    energy = residual[used] ** 2
    for column, name in enumerate(known.names):
        values = known.values[used, column]
        edges = np.unique(np.quantile(values, np.linspace(0.0, 1.0, REGION_BINS + 1)))
        if len(edges) < 3:
            continue
        place = np.clip(np.searchsorted(edges, values, side="right") - 1, 0, len(edges) - 2)
        count = np.maximum(np.bincount(place, minlength=len(edges) - 1), 1)
        mean = np.bincount(place, residual[used], len(edges) - 1) / count
        power = np.bincount(place, energy, len(edges) - 1)
        between = float((count * mean**2).sum() / max(energy.sum(), np.finfo(float).tiny))
        if between > best:
            best, chosen = between, (name, edges, power)
    if chosen is None:
        return None
    name, edges, power = chosen
    low, high, share = _narrowest(edges, power)
    unit = feature_unit(name, setting, counts)
    return FoundRegion(variable=name, range=(low, high), unit=unit, share=share)


def _narrowest(edges: np.ndarray, power: np.ndarray) -> tuple[float, float, float]:
    total = max(float(power.sum()), np.finfo(float).tiny)
    for width in range(1, len(power) + 1):
        sums = np.convolve(power, np.ones(width), "valid") / total
        if sums.max() >= MOST_SHARE or width == len(power):
            first = int(sums.argmax())
            return float(edges[first]), float(edges[first + width]), float(sums.max())
    raise AssertionError("the whole range carries everything")


def regions(fit: Fitted, trial: Trial) -> tuple[FoundRegion | None, ...]:
    """Where the residual of each joint sits."""
    known, used = fit.evidence.moving.known, fit.evidence.used
    setting, counts = fit.before.setting, bool(fit.uncalibrated)
    return tuple(
        region(known, trial.residual[:, j], used[:, j], setting, counts)
        for j in range(len(fit.before.joints))
    )


def energy_shares(evidence: Evidence, trial: Trial, gap: Gap) -> np.ndarray:
    """Share (j,) of the energy beyond noise that each joint carries; none if the error is no larger
    than the scatter between periods, and no effect lessens it.
    """
    channels = np.maximum(trial.energy - evidence.used.sum(axis=0), 0.0)
    beyond = channels.reshape(-1, len(evidence.joints)).sum(axis=0)
    noise = (gap.largest_before <= gap.floor) & (gap.after > UNCHANGED_ERROR * gap.before)
    beyond = np.where(noise & ~noise.all(), 0.0, beyond)
    total = float(beyond.sum())
    return beyond / total if total > 0.0 else np.zeros_like(beyond)


# What is known of an unknown force: size, what it may follow, and in which recordings.

LISTED_SIGNATURES = 3  # the best ones
DIFFERING_RATIO = 2.0  # times the median of the recordings, from which one differs
SINGULAR_SHARE = 1e-8  # of the largest eigenvalue, up to which a combination of columns is none


def unknown_force(search: Search, j: int, counts: bool = False) -> UnknownPlace:
    """What is known of the residual of joint number j before anything is added; with `counts`, in
    units of sensors that are not calibrated.
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
    """What `effects` leave on each joint where none of them acts, largest first, if one of its
    signatures explains more than the `threshold` and more than the errors of the processing.
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
    term: Term, joint: str, setting: Setting, values: np.ndarray, std_devs: np.ndarray, counts: bool
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
    """The unit of a parameter if sensors give counts."""
    return COUNTS if counts and unit != "1" else unit


class Solved(NamedTuple):
    """Values (k,), least if columns coincide, their standard deviations, and 2 dlogL gained."""

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
    if len(sources) < 2 or i < 0 or tried[i].gain < MOST_SHARE * beyond:
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
