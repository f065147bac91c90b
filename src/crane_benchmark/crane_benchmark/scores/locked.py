"""Locked values: everything that a verdict depends on between a bag and the answer.

A change of names or words changes no answer and needs no other calibration. This is shown on the
same bags, BEFORE and AFTER the change: answers are equal to the digit, and so are locked values.

    # with the locked code
    ros2 run crane_benchmark discrepancy --set tuning --cases 8 --keep-bags --out OUT
    # with the change
    python -m crane_benchmark.answers.answer_cases --folder OUT/tuning --round after --keep-bags
    python -m crane_benchmark.scores.locked \\
        --before OUT/tuning/answers --after OUT/tuning/after/answers --why "..."
"""

import argparse
import ast
import hashlib
import json
import subprocess
import sys
from collections.abc import Iterable, Iterator, Sequence
from datetime import UTC, datetime
from functools import cache
from pathlib import Path
from typing import Any

from crane_benchmark.folders import read_json, write_json
from crane_identification.data import recording_log
from crane_identification.diagnosis import diagnosis
from crane_identification.diagnosis.flow import load_usual
from crane_identification.thresholds import load_thresholds
from crane_model import cli
from crane_model.errors import ConfigurationError, DataError

RECORD = Path(__file__).with_name("locked.json")
INDEPENDENT_GATES = RECORD.with_name(
    "gates_independent.json"
)  # calibrated on the plant of other make
# Parts of a state, beside the code.
STATE_PARTS = ("gates", "method", "hydraulics", "independent_gates")
LIST_MODULES = f"""
import sys
import {recording_log.__name__}, {diagnosis.__name__}
for name, module in sorted(sys.modules.items()):
    if name.startswith("crane_") and module.__file__:
        print(module.__file__)
"""
FEWEST_CASES = 4
WORDS = ("verdict", "effect", "joint")  # keys whose texts are answers
UNCOMPARED_KEYS = ("seconds",)  # keys of numbers that no two runs have in common


def state() -> dict[str, Any]:
    """The gates and the method, what is usual of the hydraulics, and a digest of the code."""
    thresholds = load_thresholds()
    sources = (path.read_text(encoding="utf-8") for path in modules())
    return {
        "gates": thresholds.gates.model_dump(),
        "method": thresholds.method.model_dump(),
        "hydraulics": load_usual().model_dump(),
        "independent_gates": read_json(INDEPENDENT_GATES) if INDEPENDENT_GATES.exists() else {},
        "code": digest_of_code(sources),
    }


@cache
def modules() -> tuple[Path, ...]:
    """Files of the suite that a process imports which reads a bag and diagnoses it."""
    command = [sys.executable, "-c", LIST_MODULES]
    listed = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    return tuple(Path(line) for line in listed.splitlines())


def digest_of_code(sources: Iterable[str]) -> str:
    """Digest of the code of modules, by this version of Python: comments, docstrings, imports and
    the place of a module do not count; words that are printed do.
    """
    digests = (hashlib.sha256(_statements(source).encode()).hexdigest() for source in sources)
    return hashlib.sha256("".join(sorted(digests)).encode()).hexdigest()


def _statements(source: str) -> str:
    tree = ast.parse(source)
    for node in ast.walk(tree):
        body = getattr(node, "body", None)
        if isinstance(body, list):
            node.body = [statement for statement in body if not _says_nothing(statement)]  # type: ignore[attr-defined]
    return ast.dump(tree)


def _says_nothing(node: ast.stmt) -> bool:
    """Return whether a statement is an import, or a text by itself."""
    if isinstance(node, ast.Expr):
        return isinstance(node.value, ast.Constant) and isinstance(node.value.value, str)
    return isinstance(node, ast.Import | ast.ImportFrom)


def digest(found: dict[str, Any]) -> str:
    """Digest of a state."""
    return hashlib.sha256(json.dumps(found, sort_keys=True).encode()).hexdigest()


def differences(before: dict[str, Any], now: dict[str, Any]) -> list[str]:
    """Differences of two states, in words."""
    said = []
    for part in STATE_PARTS:
        old, new = before.get(part, {}), now[part]
        said += [
            f"{part}.{name} is {new.get(name)}, locked at {old.get(name)}"
            for name in sorted(old.keys() | new.keys())
            if old.get(name) != new.get(name)
        ]
    return said + (["the code that decides has changed"] if before["code"] != now["code"] else [])


def require_locked() -> str:
    """The name of the lock; `ConfigurationError` if anything that decides is not as locked."""
    record = read_json(RECORD)
    if said := differences(record["state"], state()):
        raise ConfigurationError(
            f"not what was locked on {record['date']}: {'; '.join(said)}. The scoring set is for "
            "what is locked: calibrate with --set calibration --lock or, where answers are the "
            "same as before, carry the lock over (crane_benchmark.scores.locked)"
        )
    return str(record["digest"])


def carried_over(before: Path, after: Path, why: str) -> dict[str, Any]:
    """The record with the present state in place of the one before, and how that was shown.

    `ConfigurationError` if a value differs, `DataError` if an answer does or there are too few.
    """
    record, now = read_json(RECORD), state()
    gates, before_state = record["thresholds"], record.get("state", {})  # older records have none
    known = [("gates", gates), *((part, before_state.get(part, {})) for part in STATE_PARTS)]
    wrong = {
        f"{part}.{name}"
        for part, values in known
        for name, value in values.items()
        if now[part].get(name) != value
    }
    if wrong:
        raise ConfigurationError(
            f"{', '.join(sorted(wrong))}: not as locked; a lock is carried over with its values "
            "only, calibrate with --set calibration --lock"
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
    names_before, names_after = (
        {p.parent.name for p in at.glob("*/answer.json")} for at in (before, after)
    )
    cases = sorted(names_before & names_after)
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
                    "behaviour has changed, calibrate with --set calibration --lock"
                )
    return len(cases)


def _values(answer: Any, place: tuple[str, ...] = ()) -> Iterator[tuple[tuple[str, ...], Any]]:
    """Content of an answer by place: lengths of lists, numbers, and the texts that are answers."""
    if isinstance(answer, dict):
        for key, value in answer.items():
            if key not in UNCOMPARED_KEYS:
                yield from _values(value, (*place, key))
    elif isinstance(answer, list):
        yield (*place, "length"), len(answer)
        for number, value in enumerate(answer):
            yield from _values(value, (*place, str(number)))
    elif not isinstance(answer, str) or place[-1] in WORDS:
        yield place, answer


def main(argv: Sequence[str] | None = None) -> int:
    """Carry a lock over to code that answers the same; exit status 1 if an answer differs."""
    parser = argparse.ArgumentParser(prog="locked", description=main.__doc__)
    add = parser.add_argument
    add("--before", type=Path, required=True, help="answers of what is locked")
    add("--after", type=Path, required=True, help="answers to the same bags now")
    add("--why", required=True, help="what was changed that changes no answer")
    given = parser.parse_args(argv)

    def run() -> None:
        record = carried_over(given.before, given.after, given.why)
        write_json(RECORD, record)
        print(f"{record['carried_over'][-1]['same_answers']} cases have the same answers: carried")

    return cli.run(run)


if __name__ == "__main__":
    sys.exit(main())
