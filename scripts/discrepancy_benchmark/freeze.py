"""Thresholds from cases that hide nothing, and the record that they are frozen."""

import hashlib
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, NamedTuple

import figures
import numpy as np
from calibration import agreement, together
from folders import Folders, done, read_json, write_json
from ruamel.yaml import YAML

from crane_identification.discrepancy.hydraulics import load_usual
from crane_identification.discrepancy.thresholds import load_thresholds
from crane_model.configuration import packaged
from crane_model.errors import ConfigurationError, DataError

RECORD = Path(__file__).with_name("frozen.json")
FILES = ("discrepancy.yaml", "hydraulics.yaml")
OPEN = {
    "discrepancy.yaml": {
        "score_factor": 1e-3,
        "further_share": 1.0,
        "explained_share": 0.0,
        "left_share": 1.0,
        "closed_share": 0.0,
        "simple_share": 0.0,
        "floor_factor": 1e6,
    },
    "hydraulics.yaml": {"smallest_share": 1e-9},
}
"""Values at which the best single effect is a finding if it passes all other gates: whether it
would have been an alarm is then known for any threshold.
"""


class Gate(NamedTuple):
    """A threshold, the statistic of an answer that is compared with it, and the least it may be:
    None is what the file holds now.
    """

    file: str
    threshold: str
    statistic: str
    least: float | None


GATES = (
    # Not lowered: few null cases hold an effect that is strong enough to pass the other gates.
    Gate("discrepancy.yaml", "score_factor", "score", None),
    Gate("discrepancy.yaml", "smallest_strength", "strength", None),
    Gate("discrepancy.yaml", "floor_factor", "floor", 2.5),  # few periods say little of scatter
    Gate("hydraulics.yaml", "smallest_share", "flow", None),
    Gate("hydraulics.yaml", "unexplained", "flow_left", 0.0),
)
FEWEST = 30  # cases, below which a quantile this far out is not known
DIGITS = 3


def write_open(folder: Path) -> dict[str, Path]:
    """The packaged files with the gates of a false alarm open, written to a folder; by name."""
    found = {name: folder / f"open_{name}" for name in FILES}
    for name, path in found.items():
        with_values(name, path, OPEN[name])
    return found


def with_values(name: str, path: Path, values: dict[str, float]) -> None:
    """A packaged file with other values, comments kept."""
    yaml = YAML()
    yaml.width = 100
    content = yaml.load(packaged("crane_identification", name))
    content.update(values)
    with path.open("w", encoding="utf-8") as file:
        yaml.dump(content, file)


def calibrated(folders: Folders) -> dict[str, Any]:
    """Thresholds such that together they let through the share of null cases that the file allows,
    and how far the bootstrap of a diagnosis agrees; `DataError` where there are too few cases.
    """
    answers = [read_json(folders.answers / name / "answer.json") for name in done(folders.answers)]
    known = [answer["statistics"] for answer in answers if "statistics" in answer]
    if len(known) < FEWEST:
        raise DataError(
            f"{folders.answers}: {len(known)} answers with statistics; {FEWEST} are needed to set "
            "a threshold, make more cases"
        )
    now = load_thresholds().model_dump() | load_usual().model_dump()
    values = np.array([[one[gate.statistic] for gate in GATES] for one in known])
    least = [now[gate.threshold] if gate.least is None else gate.least for gate in GATES]
    limits, alarms = together(values, now["false_alarm_rate"], least)
    rounded = (float(f"{limit:.{DIGITS}g}") for limit in limits)
    agrees = agreement(known)
    figures.write_agreement(folders.scores, agrees)
    write_json(folders.scores / "calibration.json", {"agreement": agrees, "statistics": known})
    return {
        "cases": len(known),
        "allowed": now["false_alarm_rate"],
        "alarms": alarms,
        "largest": dict(zip((g.threshold for g in GATES), values.max(axis=0), strict=True)),
        "thresholds": dict(zip((g.threshold for g in GATES), rounded, strict=True)),
        "bootstrap": {"level": agrees["level"], "above": agrees["above"]},
    }


def freeze(folders: Folders) -> dict[str, Any]:
    """Write the thresholds into the package, and record their digest."""
    found = calibrated(folders)
    for name in FILES:
        own = {g.threshold: found["thresholds"][g.threshold] for g in GATES if g.file == name}
        with_values(name, packaged("crane_identification", name).resolve(), own)
    load_thresholds(), load_usual()
    found |= {"digest": digest(), "date": datetime.now(UTC).strftime("%Y-%m-%d")}
    write_json(RECORD, found)
    return found


def digest() -> str:
    """Which thresholds and limits the package holds."""
    found = hashlib.sha256()
    for name in FILES:
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
    above = found["bootstrap"]["above"]
    low, high = above["interval"]
    level = found["bootstrap"]["level"]
    return [
        f"{found['cases']} cases that hide nothing, {found['allowed']:.0%} allowed to alarm: "
        f"{found['alarms']} do with",
        *(
            f"  {name}: {value} (largest value of a case: {found['largest'][name]:.3g})"
            for name, value in found["thresholds"].items()
        ),
        f"above the bootstrap's quantile of {level:.0%} are {above['rate']:.1%} "
        f"[{low:.1%}, {high:.1%}] of the cases; {1.0 - level:.0%} are promised",
    ]
