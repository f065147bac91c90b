"""Carries a freeze over to code with which every answer is the same.

A change of names or words changes no behaviour and needs no other calibration. That it changes none
is shown: answers to the same bags, BEFORE and AFTER, are equal to the digit. Values that are frozen
must be equal, whatever the answers: a gate, the method, what is usual of the hydraulics.

    # of what was frozen
    ros2 run crane_benchmark discrepancy --set tuning --cases 8 --keep-bags --out OUT
    # of the change
    python -m crane_benchmark.answers.answer_cases --folder OUT/tuning --round after --keep-bags
    python -m crane_benchmark.scores.carry_over \\
        --before OUT/tuning/answers --after OUT/tuning/after/answers --why "..."
"""

import argparse
import sys
from collections.abc import Iterator, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from crane_benchmark.folders import read_json, write_json
from crane_benchmark.scores import frozen
from crane_model import cli
from crane_model.errors import ConfigurationError, DataError

FEWEST_CASES = 4
WORDS = ("verdict", "effect", "joint")  # keys whose texts are answers
UNEQUAL = ("seconds",)  # keys of numbers that no two runs have in common


def carried_over(before: Path, after: Path, why: str) -> dict[str, Any]:
    """The record with the present state in place of the one before, and how that was shown.

    `ConfigurationError` if a value differs, `DataError` if an answer does or there are too few.
    """
    record, now = read_json(frozen.RECORD), frozen.state()
    gates, state = record["thresholds"], record.get("state", {})  # older records have none
    known = [("gates", gates), *((part, state.get(part, {})) for part in frozen.VALUES)]
    wrong = {
        f"{part}.{name}"
        for part, values in known
        for name, value in values.items()
        if now[part].get(name) != value
    }
    if wrong:
        raise ConfigurationError(
            f"{', '.join(sorted(wrong))}: not as frozen; a freeze is carried over with its values "
            "only, calibrate with --set calibration --freeze"
        )
    cases = same_answers(before, after)
    entry = {
        "date": datetime.now(UTC).strftime("%Y-%m-%d"),
        "why": why,
        "same_answers": cases,
        "not_calibrated": sorted(now["gates"].keys() - gates.keys()),
    }
    return record | {"state": now, "carried_over": [*record.get("carried_over", []), entry]}


def same_answers(before: Path, after: Path) -> int:
    """How many cases have the same answers in two folders; `DataError` names what differs."""
    one, other = ({p.parent.name for p in at.glob("*/answer.json")} for at in (before, after))
    cases = sorted(one & other)
    if len(cases) < FEWEST_CASES:
        raise DataError(
            f"{after}: {len(cases)} cases that are in {before} too; {FEWEST_CASES} are needed to "
            "show that answers are the same, answer more"
        )
    for case in cases:
        old, new = (
            dict(_values(read_json(folder / case / "answer.json"))) for folder in (before, after)
        )
        for place, value in old.items():
            if place not in new or new[place] != value:
                raise DataError(
                    f"{after / case}: {'.'.join(place)} is {new.get(place)}, and was {value}: "
                    "behaviour has changed, calibrate with --set calibration --freeze"
                )
    return len(cases)


def _values(answer: Any, place: tuple[str, ...] = ()) -> Iterator[tuple[tuple[str, ...], Any]]:
    """What an answer says, by where: lengths of lists, numbers, and the texts that are answers."""
    if isinstance(answer, dict):
        for key, value in answer.items():
            if key not in UNEQUAL:
                yield from _values(value, (*place, key))
    elif isinstance(answer, list):
        yield (*place, "length"), len(answer)
        for number, value in enumerate(answer):
            yield from _values(value, (*place, str(number)))
    elif not isinstance(answer, str) or place[-1] in WORDS:
        yield place, answer


def main(argv: Sequence[str] | None = None) -> int:
    """Write the record; exit status 1 if the answers or the gates are not the same."""
    parser = argparse.ArgumentParser(prog="carry_over", description=__doc__.splitlines()[0])
    add = parser.add_argument
    add("--before", type=Path, required=True, help="answers of what is frozen")
    add("--after", type=Path, required=True, help="answers to the same bags now")
    add("--why", required=True, help="what was changed that changes no answer")
    given = parser.parse_args(argv)

    def run() -> None:
        record = carried_over(given.before, given.after, given.why)
        write_json(frozen.RECORD, record)
        print(f"{record['carried_over'][-1]['same_answers']} cases have the same answers: carried")

    return cli.run(run)


if __name__ == "__main__":
    sys.exit(main())
