"""The quantities that laws follow: their units, and their values on the rows of the evidence."""

from collections.abc import Callable, Mapping

import numpy as np

from crane_identification.data.column_map import COUNTS
from crane_identification.diagnosis.fit.evidence import Evidence
from crane_identification.diagnosis.fit.features import way_since_turned
from crane_model.errors import ConfigurationError
from crane_model.record import Record
from crane_model.terms import Setting
from crane_model.terms.gravity_and_load import BoomDirections
from crane_model.terms.term import Variable

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
        [_read(variable, run.record, setting, j)[run.kept] for run in evidence.runs]
    )


def _read(variable: Variable, record: Record, setting: Setting, j: int) -> np.ndarray:
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
