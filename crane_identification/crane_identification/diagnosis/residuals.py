"""Where a residual sits: the quantities that laws follow, and the range that carries most of it."""

from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np

from crane_identification.data.column_map import COUNTS
from crane_identification.diagnosis.findings import FoundRegion
from crane_identification.diagnosis.fit.evidence import Evidence, Features, way_since_turned
from crane_identification.diagnosis.fit.fit import Fitted
from crane_identification.diagnosis.proof.gap import Gap
from crane_identification.diagnosis.proof.proof import Trial
from crane_model.errors import ConfigurationError
from crane_model.record import Record
from crane_model.terms import Setting
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
_UNITS = {
    "position": "{q}",
    "velocity": "{q}/s",
    "acceleration": "{q}/s2",
    "way": "{q}",
    "way since it turned": "{q}",
    "force": "{f}",
    "force against the motion": "{f}",
    "rate of the force": "{f}/s",
    "lead": "s",
    "pressure sum": "Pa",
    "pressure of chamber B": "Pa",
    "valve command": "1",
    "extension of the telescope": "m",
    "inclination of the telescope": "rad",
    "slew velocity": "rad/s",
    "temperature": "°C",
    "time": "s",
    "recording": "1",
}
_READ: Mapping[Variable, Callable[[Record, int], np.ndarray]] = {
    "position": lambda record, j: record.position[:, j],
    "velocity": lambda record, j: record.velocity[:, j],
    "acceleration": lambda record, j: record.acceleration[:, j],
    "way since it turned": lambda record, j: way_since_turned(
        record.position[:, j], record.velocity[:, j]
    ),
    "force": lambda record, j: record.needed("force", _BY)[:, j],
    "force against the motion": lambda record, j: (
        record.needed("force", _BY)[:, j] * record.direction[:, j]
    ),
    "rate of the force": lambda record, j: (
        record.rate(record.needed("force", _BY)) if record.force_rate is None else record.force_rate
    )[:, j],
    "pressure sum": lambda record, j: (
        record.needed("pressure_a", _BY) + record.needed("pressure_b", _BY)
    )[:, j],
    "pressure of chamber B": lambda record, j: record.needed("pressure_b", _BY)[:, j],
    "slew velocity": lambda record, j: record.needed("slew_velocity", _BY),
    "temperature": lambda record, j: record.needed("temperature", _BY),
    "time": lambda record, j: record.time,
}
_OF_BOOMS: Mapping[Variable, Callable[[BoomDirections], np.ndarray]] = {
    "extension of the telescope": lambda booms: booms.extension,
    "inclination of the telescope": lambda booms: booms.psi,
}


def on_rows(variable: Variable, evidence: Evidence, j: int) -> np.ndarray:
    """A variable (n,) of joint number j on the rows of the evidence.

    `DataError` if it was not recorded, `ConfigurationError` if the machine is not of its kind.
    """
    if variable == "recording":
        return evidence.bag + 1.0
    setting = evidence.model.setting
    return np.concatenate(
        [read(variable, run.record, setting, j)[run.kept] for run in evidence.runs]
    )


def read(variable: Variable, record: Record, setting: Setting, j: int) -> np.ndarray:
    """A variable (n,) of joint number j at the samples of a record; errors as of `on_rows`."""
    if variable not in _OF_BOOMS:
        return _READ[variable](record, j)
    if setting.machine is None:
        raise ConfigurationError(f"{variable}: needs a machine, but the model has none")
    return _OF_BOOMS[variable](BoomDirections.of(setting.machine, record))


def unit_of(name: str, joint: str | None, setting: Setting, counts: bool = False) -> str:
    """The unit of a quantity by its name without the joint; `counts` where sensors give these."""
    q = setting.units.get(joint or "", "")
    f = setting.force_unit(joint) if q and joint else ""
    unit = _UNITS[name].format(q=q, f=f)
    return COUNTS if counts and unit not in ("1", "s", "°C") else unit


def feature_unit(feature: str, setting: Setting, counts: bool = False) -> str:
    """The unit of a quantity that a learner knows, as "velocity of outer_boom"."""
    name, _, about = feature.partition(" of ")
    return unit_of(name, about.split()[0] if about else None, setting, counts)


# Where a residual sits: the quantity that it follows, and the range that carries most of it.

REGION_BINS = 10
UNCHANGED_ERROR = 0.95  # of an error, above which effects did not lessen it
REGION_SHARE = 0.5  # of the energy that the range must carry


class Region(NamedTuple):
    """`share` of the residual's energy sits where `variable` is within low..high."""

    variable: str
    low: float
    high: float
    share: float


def region(known: Features, residual: np.ndarray, used: np.ndarray) -> Region | None:
    """The quantity whose value says most about the residual (n,) of one joint; None without rows.

    By the share of the variance that lies between bins of equal numbers of rows (correlation
    ratio); the range is the narrowest run of bins with half of the energy.
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
            best, chosen = between, Region(name, *_narrowest(edges, power))
    return chosen


def _narrowest(edges: np.ndarray, power: np.ndarray) -> tuple[float, float, float]:
    total = max(float(power.sum()), np.finfo(float).tiny)
    for width in range(1, len(power) + 1):
        sums = np.convolve(power, np.ones(width), "valid") / total
        if sums.max() >= REGION_SHARE or width == len(power):
            first = int(sums.argmax())
            return float(edges[first]), float(edges[first + width]), float(sums.max())
    raise AssertionError("the whole range carries everything")


def regions(fit: Fitted, trial: Trial) -> tuple[FoundRegion | None, ...]:
    """Where the residual of each joint sits."""
    known, used = fit.evidence.moving.known, fit.evidence.used
    setting, counts = fit.before.setting, bool(fit.uncalibrated)
    found = (region(known, trial.residual[:, j], used[:, j]) for j in range(len(fit.before.joints)))
    return tuple(
        one
        and FoundRegion(
            variable=one.variable,
            range=(one.low, one.high),
            unit=feature_unit(one.variable, setting, counts),
            share=one.share,
        )
        for one in found
    )


def energy_shares(evidence: Evidence, trial: Trial, gap: Gap) -> np.ndarray:
    """Share (j,) of the energy beyond noise that each joint carries; none where the error is no
    larger than the scatter between periods, and no effect lessens it.
    """
    channels = np.maximum(trial.energy - evidence.used.sum(axis=0), 0.0)
    beyond = channels.reshape(-1, len(evidence.joints)).sum(axis=0)
    noise = (gap.largest_before <= gap.floor) & (gap.after > UNCHANGED_ERROR * gap.before)
    beyond = np.where(noise & ~noise.all(), 0.0, beyond)
    total = float(beyond.sum())
    return beyond / total if total > 0.0 else np.zeros_like(beyond)


def correlation_left(evidence: Evidence, trial: Trial) -> np.ndarray:
    """Correlation (j,) of neighbouring rows of what is left; 0 for white noise."""
    seen = evidence.moving
    left = trial.residual[:, : len(seen.joints)]
    both = seen.used[1:] & seen.used[:-1] & (np.diff(seen.run) == 0)[:, np.newaxis]
    product = np.where(both, left[1:] * left[:-1], 0.0).sum(axis=0)
    power = np.where(seen.used, left**2, 0.0).sum(axis=0)
    share = both.sum(axis=0) / np.maximum(seen.used.sum(axis=0), 1)
    return product / np.maximum(power * share, np.finfo(float).tiny)
