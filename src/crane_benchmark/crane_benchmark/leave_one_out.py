"""The catalogue without the entry of what is hidden: unknown, a declared class, or a wrong name?

Single effects of a set whose bags were kept are answered once more, each without its own entry.
Effects are declared to be confusable by the catalogue, in either direction.
"""

import sys
from collections.abc import Iterator, Sequence
from enum import StrEnum
from functools import partial
from pathlib import Path

from rich import box
from rich.console import Console
from rich.table import Table

from crane_benchmark.answers.answer_cases import CaseAnswer, given, refused
from crane_benchmark.cases.case import Case, CaseKind
from crane_benchmark.cases.case_sets import CaseSet
from crane_benchmark.folders import ANSWER, Folders, done, in_processes, new, read_json
from crane_benchmark.scores.judgement import AND_MORE, NAMING, BlindAnswer, Place, without_lengths
from crane_benchmark.scores.summary import Rate, rate
from crane_identification.diagnosis.candidates import WHOLE
from crane_identification.diagnosis.diagnosis import diagnose
from crane_identification.options import Options
from crane_identification.thresholds import load_thresholds
from crane_model.cli import command_line
from crane_model.errors import CraneError
from crane_model.result_file import ResultFile, ResultPart
from crane_model.terms import REGISTRY


class Left(StrEnum):
    """Kind of the answer when the right one is not available."""

    UNKNOWN = "unknown"
    DECLARED_CLASS = "class with a declared confusable"
    DECLARED = "a declared confusable alone"
    SILENT = "nothing, or insufficient data"
    WRONG = "wrong name"


class LeftOutRow(ResultPart):
    """A case, answered without the entry of what it hides."""

    case: str
    """Its name."""
    hidden: Place
    """Effect and joint."""
    relative_magnitude: float
    """That was asked for [-]."""
    outcome: Left
    """Kind of the answer."""
    answer: BlindAnswer
    """The answer."""


class LeftOutResults(ResultFile):
    """All cases of a set, without the entries of what they hide."""

    summary: dict[Left, Rate]
    """By outcome."""
    cases: list[LeftOutRow]
    """Cases of single effects of the force."""


def confusable(first_name: str, second_name: str) -> bool:
    """Return whether the catalogue declares that either entry may be taken for the other."""
    first, second = (REGISTRY[name].effect for name in (first_name, second_name))
    assert first is not None and second is not None  # entries of the catalogue
    declared = {*first.confusable, *first.kin}
    return second_name in declared or first_name in {*second.confusable, *second.kin}


def became(hidden: Place, answer: BlindAnswer, off: bool = False) -> Left:
    """Judge the answer without the entry of the `hidden` effect; lengths do not count if `off`."""
    if off and answer.verdict in NAMING:
        rest = without_lengths(answer, [hidden])
        if not rest.findings:
            return Left.UNKNOWN if answer.verdict == AND_MORE else Left.SILENT
        answer = rest
    if answer.verdict == "unknown":
        return Left.UNKNOWN
    if answer.verdict not in NAMING:
        return Left.SILENT
    effect, joint = hidden
    declared = [
        any(
            (joint == WHOLE or where in (joint, WHOLE))
            and name in REGISTRY
            and confusable(effect, name)
            for name, where in members
        )
        for members in answer.findings
    ]
    if not all(declared):
        return Left.WRONG
    return Left.DECLARED_CLASS if answer.verdict == "ambiguous" else Left.DECLARED


def answer_case(folders: Folders, case: Case) -> None:
    """Diagnose again without the entry; what is refused is said to be insufficient."""
    recordings, without = given(folders.bags / case.name), [case.effects[0].effect]
    with new(_answers(folders) / case.name) as out:
        try:
            found = diagnose(*recordings, Options(), load_thresholds(), without=without).results()
        except CraneError as error:
            said = refused(error)
        else:
            said = CaseAnswer(verdict=found.verdict, reason=found.reason, findings=found)
        said.write(out / ANSWER)


def _answers(folders: Folders) -> Path:
    return folders.scores / "without_own_entry"


def chosen(folders: Folders) -> Iterator[Case]:
    """Cases of one catalogued effect in the force, except loads, which are always estimated."""
    for name in sorted(done(folders.bags) & done(folders.sealed)):
        case = Case.model_validate(read_json(folders.sealed / name / "case.json"))
        effect = case.effects[0].effect if case.kind is CaseKind.SINGLE else ""
        if effect in REGISTRY and not REGISTRY[effect].carries_loads:
            yield case


def main(argv: Sequence[str] | None = None) -> int:
    """Answer the single effects of a set without their own entries; results and a table."""
    parser = command_line(prog="leave_one_out", description=main.__doc__)
    add = parser.add_argument
    add(
        "--out",
        type=Path,
        default=Path("runs/discrepancy_benchmark"),
        help="folder of the benchmark",
    )
    add("--set", type=CaseSet, choices=list(CaseSet), default=CaseSet.TUNING, dest="which")
    add("--round", default="", help="folder of the answers within the folder (default: itself)")
    add("--workers", type=int, default=1)
    arguments = parser.parse_args(argv)
    folders = Folders(arguments.out / arguments.which.value, arguments.round)
    every = {case.name: case for case in chosen(folders)}
    waiting = {name: case for name, case in every.items() if name not in done(_answers(folders))}
    if waiting:
        in_processes(
            partial(answer_case, folders), waiting, arguments.workers, "without their own entry"
        )
    rows = []
    for name, case in every.items():
        if name not in done(_answers(folders)):
            continue  # reported to have failed
        hidden = case.effects[0]
        blind = BlindAnswer.of_diagnosis(CaseAnswer.read(_answers(folders) / name / ANSWER))
        place = (hidden.effect, hidden.joint or WHOLE)
        rows.append(
            LeftOutRow(
                case=name,
                hidden=place,
                relative_magnitude=hidden.relative_magnitude,
                outcome=became(place, blind, case.off),
                answer=blind,
            )
        )
    summary = {left: rate([row.outcome is left for row in rows]) for left in Left}
    path = folders.scores / "without_own_entry.json"
    LeftOutResults(summary=summary, cases=rows).write(path)
    table = Table("without the entry of what is hidden", "cases", "share", box=box.SIMPLE_HEAD)
    for name, share in summary.items():
        low, high = share.interval or (0.0, 1.0)
        table.add_row(name, str(share.count), f"{share.rate or 0.0:.0%} [{low:.0%}, {high:.0%}]")
    Console(width=100).print(table)
    print(f"written: {path}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
