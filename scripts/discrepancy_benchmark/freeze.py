"""Thresholds from cases that hide nothing, and the record that they are frozen."""

import hashlib
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
from folders import Folders, done, read_json, write_json
from ruamel.yaml import YAML

from crane_identification.discrepancy.thresholds import load_thresholds
from crane_model.configuration import packaged
from crane_model.errors import ConfigurationError, DataError

RECORD = Path(__file__).with_name("frozen.json")
OPEN = {"score_factor": 1e-3, "further_share": 1.0, "explained_share": 0.0}
"""Thresholds at which the best single effect is a finding if it passes all other gates: whether it
would have been an alarm is then known for any threshold.
"""
GATES = {"score_factor": "accepted", "smallest_strength": "learner"}
"""Threshold to the statistic that is compared with it."""
FEWEST = 30  # cases, below which a quantile this far out is not known
DIGITS = 3


def write_open(path: Path) -> Path:
    """The packaged thresholds with both gates of a false alarm open, in a file."""
    with_values(path, OPEN)
    return path


def with_values(path: Path, values: dict[str, float]) -> None:
    """The packaged file with other values, comments kept."""
    yaml = YAML()
    content = yaml.load(packaged("crane_identification", "discrepancy.yaml"))
    content.update(values)
    with path.open("w", encoding="utf-8") as file:
        yaml.dump(content, file)


def calibrated(folders: Folders) -> dict[str, Any]:
    """Both thresholds such that together they let through the share of null cases that the file
    allows; `DataError` where there are too few cases.

    Neither becomes laxer than the bootstrap alone, or than it is. Either gets the same share of the
    alarms, found by lowering both quantiles together.
    """
    answers = [read_json(folders.answers / name / "answer.json") for name in done(folders.answers)]
    known = [answer["statistics"] for answer in answers if "statistics" in answer]
    if len(known) < FEWEST:
        raise DataError(
            f"{folders.answers}: {len(known)} answers with statistics; {FEWEST} are needed to set "
            "a threshold, make more cases"
        )
    now = load_thresholds()
    values = np.array([[one[key] for key in GATES.values()] for one in known])
    limits, alarms = together(values, now.false_alarm_rate)
    least_of = (1.0, now.smallest_strength)  # the bootstrap alone; errors of the processing
    found = {
        name: max(float(f"{limit:.{DIGITS}g}"), least)
        for name, limit, least in zip(GATES, limits, least_of, strict=True)
    }
    return {
        "cases": len(known),
        "allowed": now.false_alarm_rate,
        "alarms": alarms,
        "alarms_of_the_flow": sum(one["flow"] > 0.0 for one in known),
        "thresholds": found,
    }


def together(values: np.ndarray, allowed: float) -> tuple[np.ndarray, int]:
    """Limits (g,) at one quantile of each gate's `values` (n, g), the lowest at which at most
    `allowed` of the cases pass any; and how many pass. A margin of half a step lies above each.
    """
    ordered = np.sort(values, axis=0)
    for rank in range(len(values)):
        limits = ordered[rank]
        alarms = int((values > limits).any(axis=1).sum())
        if alarms <= allowed * len(values):
            above = ordered[min(rank + 1, len(values) - 1)]
            return (limits + above) / 2.0, int((values > (limits + above) / 2.0).any(axis=1).sum())
    raise AssertionError("nothing lies above the largest values")


def freeze(folders: Folders) -> dict[str, Any]:
    """Write the thresholds into the package, and record their digest."""
    found = calibrated(folders)
    path = packaged("crane_identification", "discrepancy.yaml").resolve()
    with_values(path, found["thresholds"])
    load_thresholds(path)
    found |= {"digest": digest(), "date": datetime.now(UTC).strftime("%Y-%m-%d")}
    write_json(RECORD, found)
    return found


def digest() -> str:
    """Which thresholds and limits the package holds."""
    found = hashlib.sha256()
    for name in ("discrepancy.yaml", "hydraulics.yaml"):
        found.update(packaged("crane_identification", name).read_bytes())
    return found.hexdigest()


def require_frozen() -> str:
    """The digest of the packaged thresholds; `ConfigurationError` if they are not those frozen."""
    now = digest()
    frozen = read_json(RECORD)["digest"] if RECORD.exists() else "none"
    if now != frozen:
        raise ConfigurationError(
            f"discrepancy.yaml and hydraulics.yaml ({now[:12]}) are not what was frozen "
            f"({frozen[:12]}): the scoring set is for frozen thresholds only; calibrate with "
            "--set calibration --freeze"
        )
    return now


def lines(found: dict[str, Any]) -> Sequence[str]:
    """For people."""
    values = ", ".join(f"{name} {value}" for name, value in found["thresholds"].items())
    return [
        f"{found['cases']} cases that hide nothing, {found['allowed']:.0%} allowed to alarm: "
        f"{found['alarms']} do with {values}",
        f"beside these, {found['alarms_of_the_flow']} find something in the flow, which has limits "
        "of its own",
    ]
