"""Locked values: all numbers that a verdict depends on between a bag and the answer.

The commit that scores says what the code was; the lock says that its numbers are those which were
set on other cases.
"""

import hashlib
import json
from pathlib import Path
from typing import Any

from crane_benchmark.folders import read_json
from crane_identification.diagnosis import constants
from crane_identification.diagnosis.flow import load_usual
from crane_identification.thresholds import load_thresholds
from crane_model.errors import ConfigurationError

RECORD = Path(__file__).with_name("locked.json")
INDEPENDENT_GATES = RECORD.with_name(
    "gates_independent.json"
)  # calibrated on the plant of other make


def state() -> dict[str, dict[str, Any]]:
    """The gates, the method, the constants, and what is usual of the hydraulics."""
    thresholds = load_thresholds()
    return {
        "gates": thresholds.gates.model_dump(),
        "method": thresholds.method.model_dump(),
        "constants": {name: value for name, value in vars(constants).items() if name.isupper()},
        "hydraulics": load_usual().model_dump(),
        "independent_gates": read_json(INDEPENDENT_GATES) if INDEPENDENT_GATES.exists() else {},
    }


def digest(found: dict[str, Any]) -> str:
    """Digest of a state."""
    return hashlib.sha256(json.dumps(found, sort_keys=True).encode()).hexdigest()


def differences(before: dict[str, Any], now: dict[str, Any]) -> list[str]:
    """Differences of two states, in words."""
    said = []
    for part, new in now.items():
        old = before.get(part, {})
        said += [
            f"{part}.{name} is {new.get(name)}, locked at {old.get(name)}"
            for name in sorted(old.keys() | new.keys())
            if old.get(name) != new.get(name)
        ]
    return said


def require_locked() -> str:
    """The name of the lock; `ConfigurationError` if anything that decides is not as locked."""
    record = read_json(RECORD)
    if said := differences(record["state"], state()):
        raise ConfigurationError(
            f"not what was locked on {record['date']}: {'; '.join(said)}. The scoring set is for "
            "what is locked: calibrate with --set calibration --lock"
        )
    return str(record["digest"])
