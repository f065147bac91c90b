"""No number that a verdict depends on changes with the lock as it was."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from crane_benchmark import Folders, benchmark
from crane_benchmark.answers.answer_cases import AnswerStatistics, CaseAnswer
from crane_benchmark.benchmark import Answering
from crane_benchmark.cases.case import Simulator
from crane_benchmark.cases.case_sets import CaseSet, cases
from crane_benchmark.folders import new, read_json, write_json
from crane_benchmark.scores import lock, locked
from crane_identification.thresholds import load_thresholds
from crane_model import ConfigurationError


@pytest.fixture
def record(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A record of what the package holds, in place of the project's."""
    path = tmp_path / "locked.json"
    write_json(path, {"digest": "name", "date": "today", "state": locked.state()})
    monkeypatch.setattr(locked, "RECORD", path)
    yield path


def test_what_is_as_locked_may_be_scored(record: Path) -> None:
    assert locked.require_locked() == "name"


@pytest.mark.parametrize(
    ("part", "name"),
    [
        ("gates", "pulsation_clearness"),
        ("method", "lead_share"),
        ("constants", "VISIBLE_SHARE"),
        ("hydraulics", "leakage"),
    ],
)
def test_scoring_is_refused_where_a_value_is_not_as_locked(
    record: Path, tmp_path: Path, capsys, part: str, name: str
) -> None:
    content = read_json(record)
    now, content["state"][part][name] = content["state"][part][name], 4.5
    write_json(record, content)
    assert benchmark.main(["--out", str(tmp_path)]) == 1
    said = capsys.readouterr().err
    assert f"{part}.{name} is {now}, locked at 4.5" in said
    assert "not what was locked on today" in said


def test_the_values_of_the_package_are_those_of_the_last_lock() -> None:
    record = read_json(locked.RECORD)
    assert locked.differences(record["state"], locked.state()) == []
    assert locked.digest(record["state"]) == record["digest"]


def test_open_gates_are_those_of_the_package_but_for_what_lets_alarms_through(tmp_path) -> None:
    packaged, opened = load_thresholds(), load_thresholds(lock.write_open(tmp_path))
    for part, values in lock.OPEN.items():
        gates = getattr(packaged, part).model_dump()
        assert getattr(opened, part).model_dump() == gates | values
    assert "# Rivals." in (tmp_path / "open_discrepancy.yaml").read_text(encoding="utf-8")


def test_every_gate_is_calibrated_the_pulsation_with_the_others(tmp_path: Path) -> None:
    """Null cases of which one in two has a line that would be an alarm."""
    folders = Folders(tmp_path)
    none = dict.fromkeys((gate.statistic for gate in lock.GATES), 0.0)
    for number in range(lock.FEWEST_CASES_OF_QUANTILE):
        line = 8.0 + 0.1 * number if number % 2 else 2.0
        statistics = none | {"pulsation": line}
        known = AnswerStatistics(
            best=0.5, accepted=0.0, learner=0.0, promised=[1.0] * 101, **statistics
        )
        with new(folders.answers / str(number)) as folder:
            CaseAnswer(verdict="none", reason="made up", statistics=known).write(
                folder / "answer.json"
            )
    found = lock.calibrated(folders)
    assert set(found["thresholds"]) == set(load_thresholds().gates.model_dump())
    assert found["alarms"] == 0
    assert found["thresholds"]["pulsation_clearness"] > found["largest"]["pulsation_clearness"]
    lock.with_values(tmp_path / "independent.yaml", {"gates": found["thresholds"]})
    written, packaged = load_thresholds(tmp_path / "independent.yaml"), load_thresholds()
    assert written.gates.model_dump() == found["thresholds"]
    assert written.method == packaged.method


def test_gates_are_calibrated_with_what_hides_nothing(capsys) -> None:
    with pytest.raises(SystemExit):
        benchmark.main(("--set", "tuning", "--lock"))
    assert "with --set calibration or independent_clean" in capsys.readouterr().err


def crossed_with(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, *arguments: str
) -> dict[int, tuple[Answering, ...]]:
    """The answers of the batches that a scoring of 16 cases would run, by the first case."""
    asked: dict[int, tuple[Answering, ...]] = {}
    monkeypatch.setattr(
        benchmark, "run_batch", lambda _, __, answers, first: asked.update({first: answers}) or 0
    )
    monkeypatch.setattr(benchmark, "score", lambda *_: None)
    assert benchmark.main(["--cases", "16", "--out", str(tmp_path), *arguments]) == 0
    return asked


@pytest.fixture
def primary_alone(record: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The record of a lock before which nothing was calibrated on the independent simulator."""
    monkeypatch.setattr(locked, "INDEPENDENT_GATES", tmp_path / "gates_independent.json")
    write_json(record, read_json(record) | {"state": locked.state()})
    return record


def test_either_plant_is_scored_by_the_gates_of_the_other(
    primary_alone: Path, tmp_path: Path, monkeypatch, capsys
) -> None:
    (only,) = crossed_with(monkeypatch, tmp_path, "--simulator", "independent")[0]
    assert only.thresholds is None  # those of the package, of the primary simulator
    independent = {
        case.name for case in cases(CaseSet.SCORING, 16) if case.simulator is Simulator.INDEPENDENT
    }
    assert set(only.names or ()) == independent
    assert benchmark.main(["--cases", "16", "--out", str(tmp_path)]) == 1
    assert "no gates were calibrated on the independent simulator" in capsys.readouterr().err

    gates = load_thresholds().gates.model_dump() | {"score_factor": 9.5}
    write_json(locked.INDEPENDENT_GATES, gates)
    write_json(primary_alone, read_json(primary_alone) | {"state": locked.state()})
    asked = crossed_with(monkeypatch, tmp_path)
    assert list(asked) == [0, 8]
    by_package, by_independent = asked[0]
    assert by_package == only
    assert load_thresholds(by_independent.thresholds).gates.score_factor == 9.5
    assert len(by_independent.names or ()) == 8 and not independent & set(
        by_independent.names or ()
    )


def test_a_batch_answers_its_own_cases_alone(tmp_path: Path, monkeypatch) -> None:
    stages: list[list[str]] = []
    monkeypatch.setattr(
        benchmark, "stage", lambda name, *rest: stages.append([name, *map(str, rest[2:])]) or 0
    )
    words = ["--set", "tuning", "--cases", "16", "--out", str(tmp_path)]
    monkeypatch.setattr(benchmark, "score", lambda *_: None)
    assert benchmark.main(words) == 0
    names = [case.name for case in cases(CaseSet.TUNING, 16)]
    made = [words for name, *words in stages if name == "make_cases"]
    assert [words[words.index("--from") :] for words in made] == [
        ["--from", "0", "--to", "8"],
        ["--from", "8", "--to", "16"],
    ]
    answered = [words for name, *words in stages if name == "answer_cases"]
    assert [words[1:] for words in answered] == [names[:8], names[8:]]


@pytest.mark.usefixtures("primary_alone")
def test_gates_from_the_independent_simulator_are_part_of_what_is_locked() -> None:
    write_json(locked.INDEPENDENT_GATES, {"score_factor": 9.5})
    with pytest.raises(
        ConfigurationError, match=r"independent_gates.score_factor is 9.5, locked at None"
    ):
        locked.require_locked()
