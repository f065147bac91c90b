"""What the rows of all cases say together, with 95 % intervals."""

from collections import Counter
from collections.abc import Callable, Sequence
from typing import Any

from crane_benchmark.cases.case import CaseKind
from crane_benchmark.cases.case_sets import PAIR, STRENGTHS
from crane_benchmark.scores.judgement import AND_MORE, OURS, Judgement
from crane_benchmark.scores.rates import median, rate
from crane_identification.thresholds import load_thresholds

VISIBLE_SHARE = 0.05  # share of an effect that recordings can show, below which they do not

Row = dict[str, Any]


def summary(rows: Sequence[Row]) -> dict[str, Any]:
    """Rates of every method, and what only a diagnosis gives."""
    methods = list(dict.fromkeys(name for row in rows for name in row["outcomes"]))
    ours = [row for row in rows if OURS in row["outcomes"]]
    hidden, sees = [row for row in ours if row["hidden"]], learnt(ours)
    return {
        "cases": len(rows),
        "methods": {name: _of_method(rows, name) for name in methods},
        "gap_closed": median([row["closed"] for row in ours if row["closed"] is not None]),
        "gap_closed_by_learner": median(
            [row["closed_by_learner"] for row in hidden if row["closed_by_learner"] is not None]
        ),
        "learner": {
            **{name: value for name, value in sees.items() if name != "power"},
            "power": {f"{s:g}": value for s, value in sees["power"].items()},
        },
        "parameter_error": median([e for row in ours for e in row["parameter_errors"]]),
        "seconds": median([row["seconds"] for row in ours if row["seconds"]]),
        "stories": _told(ours),
        "not_identifiable": sum(not identifiable(row) for row in of_kind(rows, CaseKind.SINGLE)),
    }


def learnt(rows: Sequence[Row]) -> dict[str, Any]:
    """How often the flexible learner is sure of a law: alarms, and by strength like `power`."""
    least = load_thresholds().gates.smallest_strength

    def sees(some: Sequence[Row]) -> dict[str, Any]:
        return rate([bool(r["statistics"]) and r["statistics"]["learner"] > least for r in some])

    return {
        "false_alarms": sees(of_kind(rows, CaseKind.NOTHING)),
        "outside": sees(of_kind(rows, CaseKind.OUTSIDE)),
        "power": {s: sees(of) for s, of in by_strength(rows).items()},
    }


def by_strength(rows: Sequence[Row]) -> dict[float, list[Row]]:
    """Cases of single effects that can be identified, by the strength that was asked for."""
    seen = [row for row in of_kind(rows, CaseKind.SINGLE) if identifiable(row)]
    return {s: [row for row in seen if row["hidden"][0]["strength"] == s] for s in STRENGTHS}


def of_kind(rows: Sequence[Row], kind: CaseKind) -> list[Row]:
    """The rows of one kind of case."""
    return [row for row in rows if row["kind"] == kind]


def identifiable(row: Row) -> bool:
    """Whether the clean recordings show every effect of the case, by its visibility."""
    shown = [one["visibility"] for one in row["hidden"]]
    return all(part is None or part >= VISIBLE_SHARE for part in shown)


def share(
    rows: Sequence[Row], method: str, wanted: Callable[[Judgement], bool] | Judgement
) -> dict[str, Any]:
    """How often the outcome of a method is the wanted one."""
    outcomes = [Judgement(row["outcomes"][method]) for row in rows if method in row["outcomes"]]
    return rate([wanted(o) if callable(wanted) else o is wanted for o in outcomes])


def power(rows: Sequence[Row], method: str) -> dict[float, dict[str, Any]]:
    """Share of right answers to single effects that can be identified, by strength."""
    return {s: share(of, method, Judgement.RIGHT) for s, of in by_strength(rows).items()}


def _told(rows: Sequence[Row]) -> dict[str, dict[str, int]]:
    """How often which outcome, by the story of the case, where it has one."""
    outcomes: dict[str, Counter[str]] = {}
    for row in rows:
        if row["story"] is not None:
            outcomes.setdefault(row["story"], Counter())[row["outcomes"][OURS]] += 1
    return {story: dict(several.most_common()) for story, several in outcomes.items()}


def _of_method(rows: Sequence[Row], method: str) -> dict[str, Any]:
    singles = of_kind(rows, CaseKind.SINGLE)
    seen = [row for row in singles if identifiable(row)]

    def at(strength: float) -> list[Row]:
        return [row for row in seen if row["hidden"][0]["strength"] >= strength]

    nothing = of_kind(rows, CaseKind.NOTHING)
    pairs = [row for row in of_kind(rows, CaseKind.PAIR) if identifiable(row)]
    return {
        "false_alarms": share(nothing, method, Judgement.FALSE_ALARM),
        "right_from_2_percent": share(at(0.02), method, Judgement.RIGHT),
        "right_from_2_percent_all": share(
            [row for row in singles if row["hidden"][0]["strength"] >= 0.02],
            method,
            Judgement.RIGHT,
        ),
        "hedged": rate(
            [
                row["answers"][method][0] == AND_MORE
                for row in singles
                if method in row["outcomes"]
                and row["hidden"][0]["strength"] >= 0.02
                and row["outcomes"][method] == Judgement.RIGHT
            ]
        ),
        "right_at_1_percent": share(
            [row for row in seen if row["hidden"][0]["strength"] == 0.01], method, Judgement.RIGHT
        ),
        "power": {f"{s:g}": value for s, value in power(rows, method).items()},
        f"pairs_at_{PAIR:.0%}".replace("%", "_percent"): share(pairs, method, Judgement.RIGHT),
        "one_of_two": share(pairs, method, Judgement.PARTLY),
        "unknown_recognised": share(of_kind(rows, CaseKind.OUTSIDE), method, Judgement.RIGHT),
        "twins": share(of_kind(rows, CaseKind.CLASS), method, Judgement.RIGHT),
        "too_little_data": share(of_kind(rows, CaseKind.INSUFFICIENT), method, Judgement.RIGHT),
        "wrong_names": share(rows, method, Judgement.WRONG_NAME),
        "too_wide": share(rows, method, Judgement.TOO_WIDE),
        "crashes": share(rows, method, Judgement.CRASH),
    }
