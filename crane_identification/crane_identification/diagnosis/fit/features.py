"""What a law may depend on: quantities of the records, by name."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from crane_identification.diagnosis.fit.runs import Run
from crane_model.record import Record


@dataclass(frozen=True)
class Features:
    """What a law may depend on: `values` (n, f) at the rows of the evidence, and their names."""

    names: tuple[str, ...]
    values: np.ndarray

    def about(self, joint: str) -> "Features":
        """Those of one joint, and those that belong to none."""
        other = [i for i, name in enumerate(self.names) if " of " not in name]
        own = [i for i, name in enumerate(self.names) if f" of {joint}" in name]
        return Features(tuple(self.names[i] for i in own + other), self.values[:, own + other])


def features(runs: Sequence[Run]) -> Features:
    """Motion, way since the last reversal, forces, pressures, command, slew, temperature, time; at
    the rows of the runs.
    """
    parts = []
    names: tuple[str, ...] = ()
    for run in runs:
        columns = quantities(run.record)
        names = tuple(columns)
        parts.append(np.stack([values[run.kept] for values in columns.values()], axis=1))
    return Features(names, np.concatenate(parts))


def quantities(record: Record) -> dict[str, np.ndarray]:
    """What a law may depend on, by name: (n,) each."""
    out: dict[str, np.ndarray] = {}
    for j, joint in enumerate(record.joints):
        q, v = record.position[:, j], record.velocity[:, j]
        out[f"position of {joint}"] = q
        out[f"velocity of {joint}"] = v
        out[f"acceleration of {joint}"] = record.acceleration[:, j]
        out[f"way of {joint} since it turned"] = way_since_turned(q, v)
        assert record.force is not None  # evidence has it
        out[f"force of {joint}"] = record.force[:, j]
        if record.pressure_a is not None and record.pressure_b is not None:
            out[f"pressure sum of {joint}"] = record.pressure_a[:, j] + record.pressure_b[:, j]
        if record.command is not None:
            out[f"valve command of {joint}"] = record.command[:, j]
    if record.slew_velocity is not None:
        out["slew velocity"] = record.slew_velocity
    if record.temperature is not None:
        out["temperature"] = record.temperature
    out["time"] = record.time
    return out


def way_since_turned(q: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Displacement (n,) since the velocity last changed its sign."""
    turned = np.concatenate([[True], np.sign(v[1:]) != np.sign(v[:-1])])
    last = np.maximum.accumulate(np.where(turned, np.arange(len(v)), 0))
    return q - q[last]
