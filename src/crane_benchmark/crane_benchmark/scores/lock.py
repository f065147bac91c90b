"""Thresholds from cases that hide nothing, and the record that they are locked."""

from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from ruamel.yaml import YAML

from crane_benchmark.answers.answer_cases import AnswerStatistics, CaseAnswer
from crane_benchmark.cases.case_sets import CaseSet
from crane_benchmark.folders import ANSWER, Folders, done, read_json, write_json
from crane_benchmark.scores import locked
from crane_benchmark.scores.summary import Rate, rate
from crane_identification.thresholds import Gates, load_thresholds
from crane_model.configuration import packaged
from crane_model.errors import ConfigurationError, DataError
from crane_model.result_file import ResultFile

PACKAGED = packaged("crane_identification", "discrepancy.yaml")
OPEN = {
    "gates": {
        "score_factor": 1e-3,
        "floor_factor": 1e6,
        "sample_noise_factor": 1e6,
        "smallest_flow_share": 1e-9,
    },
    "method": {
        "further_share": 1.0,
        "explained_share": 0.0,
        "left_share": 1.0,
        "closed_share": 0.0,
        "simple_share": 0.0,
    },
}
"""Values at which the best single effect is a finding if it passes all other gates: whether it
would have been an alarm is then known for any threshold.
"""
FEWEST_CASES_OF_QUANTILE = 30  # cases, below which a quantile this far out is not known
THRESHOLD_DIGITS = 3
TAIL = 4  # the largest values, one in so many, say how a tail falls off
LEVEL = 97  # %, of the bootstrap quantile that null cases are compared with


class Calibration(ResultFile):
    """Data that thresholds were set by."""

    above: Rate
    """Share of cases above the quantile of the bootstrap; the share that it leaves, if right."""
    statistics: list[AnswerStatistics]
    """Statistics of the cases."""


class GateStatistic(NamedTuple):
    """A gate of `Gates`, its statistic of an answer, and its least value (None: the file's)."""

    threshold: str
    statistic: str
    least: float | None


GATES = (
    # Not lowered: few null cases hold an effect that is strong enough to pass the other gates.
    GateStatistic("score_factor", "score", None),
    GateStatistic("smallest_strength", "relative_magnitude", None),
    GateStatistic("floor_factor", "floor", 2.5),  # few periods say little of scatter
    GateStatistic("sample_noise_factor", "sample_noise", 3.5),  # one of 80 machines reached 3.2
    GateStatistic("pulsation_clearness", "pulsation", None),  # 72 other sets say more of it
    GateStatistic("smallest_flow_share", "flow", None),
    GateStatistic("unexplained_flow", "flow_left", 0.0),
)
assert {gate.threshold for gate in GATES} == set(Gates.model_fields)


def together(
    values: np.ndarray, allowed: float, least: Sequence[float] = ()
) -> tuple[np.ndarray, int]:
    """Limits (g,) of gates with these `values` (n, g) in n null cases, of which the share `allowed`
    may pass any; and how many pass.

    Each gate gets the same part of the alarms, by the fall of its tail, and none becomes lower than
    its `least`. If too many pass, all are raised together, one value at a time, with a margin of
    half a step.
    """
    ordered = np.sort(values, axis=0)
    count, gates = values.shape
    floors = np.maximum(tails(ordered, allowed / gates), least if len(least) else 0.0)
    for rank in range(count):
        above = ordered[min(rank + 1, count - 1)]
        limits = np.maximum((ordered[rank] + above) / 2.0, floors)
        alarms = int((values > limits).any(axis=1).sum())
        if alarms <= allowed * count:
            break
    return limits, alarms


def tails(ordered: np.ndarray, share: float) -> np.ndarray:
    """(g,) what this `share` of cases is above, by exponential tails of sorted values (n, g).

    60 cases hold no 0.6 % quantile; the median step of the largest quarter, which one odd case does
    not move, tells where it lies. Zero for gates that most cases do not even reach.
    """
    count = max(len(ordered) // TAIL, 1)
    start = ordered[-count - 1]
    fall = np.median(ordered[-count:] - start, axis=0) / np.log(2.0)
    return np.where(fall > 0.0, start + fall * np.log(count / (share * len(ordered))), 0.0)


def above_promised(known: Sequence[AnswerStatistics]) -> Rate:
    """How many null cases score above the quantile that the bootstrap promises."""
    return rate([row.best > row.promised[LEVEL] for row in known])


def write_open(folder: Path) -> Path:
    """The packaged file with the gates of a false alarm open, written to a folder."""
    path = folder / f"open_{PACKAGED.name}"
    with_values(path, OPEN)
    return path


def with_values(path: Path, sections: Mapping[str, Mapping[str, float]]) -> None:
    """The packaged file with other values of its sections, comments kept."""
    yaml = YAML()
    yaml.width = 100
    content = yaml.load(PACKAGED)
    for name, values in sections.items():
        content[name].update(values)
    with path.open("w", encoding="utf-8") as file:
        yaml.dump(content, file)


def calibrated(folders: Folders) -> dict[str, Any]:
    """Thresholds such that together they let through the share of null cases that the file allows,
    and how far the bootstrap of a diagnosis agrees; `DataError` where there are too few cases.
    """
    answers = [CaseAnswer.read(folders.answers / name / ANSWER) for name in done(folders.answers)]
    known = [answer.statistics for answer in answers if answer.statistics]
    if len(known) < FEWEST_CASES_OF_QUANTILE:
        raise DataError(
            f"{folders.answers}: {len(known)} answers with statistics; {FEWEST_CASES_OF_QUANTILE} "
            "are needed to set a threshold, make more cases"
        )
    thresholds = load_thresholds()
    now, allowed = thresholds.gates.model_dump(), thresholds.method.false_alarm_rate
    values = np.array([[getattr(row, gate.statistic) for gate in GATES] for row in known])
    least = [now[gate.threshold] if gate.least is None else gate.least for gate in GATES]
    limits, alarms = together(values, allowed, least)
    rounded = (float(f"{limit:.{THRESHOLD_DIGITS}g}") for limit in limits)
    above = above_promised(known)
    Calibration(above=above, statistics=known).write(folders.scores / "calibration.json")
    return {
        "cases": len(known),
        "allowed": allowed,
        "alarms": alarms,
        "largest": dict(zip((g.threshold for g in GATES), values.max(axis=0), strict=True)),
        "thresholds": dict(zip((g.threshold for g in GATES), rounded, strict=True)),
        "bootstrap": {"level": LEVEL / 100.0, "above": above.plain()},
    }


def lock(folders: Folders, which: CaseSet) -> dict[str, Any]:
    """Write the gates, and record everything that a verdict depends on.

    Gates of the primary simulator go into the package of the diagnosis, others beside the record.
    """
    found = calibrated(folders)
    if which is CaseSet.INDEPENDENT_CLEAN:
        record = read_json(locked.RECORD)
        write_json(locked.INDEPENDENT_GATES, found["thresholds"])
        record |= {"independent": found}
    else:
        with_values(PACKAGED.resolve(), {"gates": found["thresholds"]})
        record = found
    state = locked.state()
    record |= {"date": datetime.now(UTC).strftime("%Y-%m-%d")}
    record |= {"digest": locked.digest(state), "state": state}
    write_json(locked.RECORD, record)
    return found


def write_independent(folder: Path) -> Path:
    """The packaged file with the gates of the independent simulator, written to a folder.

    `ConfigurationError` if none were calibrated.
    """
    if not locked.INDEPENDENT_GATES.exists():
        raise ConfigurationError(
            "no gates were calibrated on the independent simulator, by which cases of the primary "
            "one are scored: calibrate with --set independent_clean --lock, or score --simulator "
            "independent alone"
        )
    path = folder / f"independent_{PACKAGED.name}"
    with_values(path, {"gates": read_json(locked.INDEPENDENT_GATES)})
    return path


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
