"""Nothing that a verdict depends on changes with the lock as it was; what changes none does."""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from crane_benchmark import Folders, benchmark
from crane_benchmark.answers.answer_cases import AnswerStatistics, CaseAnswer
from crane_benchmark.benchmark import Batch
from crane_benchmark.cases.case import Simulator
from crane_benchmark.cases.case_sets import CaseSet, cases
from crane_benchmark.folders import new, read_json, write_json
from crane_benchmark.scores import lock, locked
from crane_identification.thresholds import load_thresholds
from crane_model import ConfigurationError, DataError

ANSWER = {
    "verdict": "named",
    "reason": "they say so",
    "findings": [{"effect": "offset", "joint": "telescope", "score": 1234.5}],
    "seconds": 31.0,
}


@pytest.fixture(scope="module")
def sources() -> dict[str, str]:
    """The code of the suite behind a diagnosis, by its file."""
    return {path.stem: path.read_text(encoding="utf-8") for path in locked.modules()}


def test_all_code_between_a_bag_and_its_verdict_counts(sources) -> None:
    decides = {"decision", "answer", "gap", "autoregression", "friction"}
    assert decides | {"kalman", "reader"} <= set(sources)
    assert not {"words", "page", "identification_node", "plant"} & set(sources)


@pytest.mark.parametrize(
    ("module", "old", "new"),
    [
        ("gap", "FEWEST_ROWS = 60", "FEWEST_ROWS = 61"),
        ("evidence", "VISIBLE_SHARE = 0.02", "VISIBLE_SHARE = 0.03"),
        ("decision", "if one.score <= one.threshold:", "if one.score < one.threshold:"),
        ("gap", "one.clearness > least", "one.clearness > 0.6 * least"),
        ("judgement", "size > 1e-6", "size > 1e-5"),
    ],
)
def test_a_number_or_a_sign_that_decides_is_noticed(sources, module, old, new) -> None:
    assert old in sources[module]
    beside, changed = sources["candidates"], sources[module].replace(old, new)
    before, after = (locked.digest_of_code((beside, one)) for one in (sources[module], changed))
    assert before != after


def test_comments_docstrings_imports_and_places_do_not_count(sources) -> None:
    beside, own = sources["judgement"], sources["gap"]
    text = "import json\n# a remark\n" + own.replace(
        '"""The lines that', '"""Of all lines those that'
    )
    assert text.count("Of all lines") == 1
    assert locked.digest_of_code((text, beside)) == locked.digest_of_code((beside, own))


@pytest.fixture
def record(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A record of what the package holds, and of two of its modules, in place of the project's."""
    few = tuple(path for path in locked.modules() if path.stem in ("candidates", "judgement"))
    monkeypatch.setattr(locked, "modules", lambda: few)
    path = tmp_path / "locked.json"
    state = locked.state()
    gates = {name: value for name, value in state["gates"].items() if name != "floor_factor"}
    write_json(path, {"thresholds": gates, "digest": "name", "date": "today", "state": state})
    monkeypatch.setattr(locked, "RECORD", path)
    yield path


def test_what_is_as_locked_may_be_scored(record: Path) -> None:
    assert locked.require_locked() == "name"


@pytest.mark.parametrize(
    ("part", "name"),
    [
        ("gates", "pulsation_clearness"),
        ("method", "lead_share"),
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


def test_scoring_is_refused_where_the_code_is_not_as_locked(
    record: Path, tmp_path: Path, capsys, monkeypatch
) -> None:
    """One constant of one module."""
    modules = locked.modules()
    (own,) = (path for path in modules if path.stem == "candidates")
    other = tmp_path / own.name
    text = own.read_text(encoding="utf-8").replace("MASS_SIGMAS = 4.0", "MASS_SIGMAS = 3.0")
    other.write_text(text, encoding="utf-8")
    monkeypatch.setattr(locked, "modules", lambda: (*(p for p in modules if p != own), other))
    assert benchmark.main(["--out", str(tmp_path)]) == 1
    assert "the code that decides has changed" in capsys.readouterr().err


def test_the_values_of_the_package_are_those_of_the_last_freeze(monkeypatch) -> None:
    """The code may be ahead of it, until it is calibrated or shown to answer the same, and do
    without some of them.
    """
    monkeypatch.setattr(locked, "modules", tuple)
    now = locked.state()
    state = read_json(locked.RECORD)["state"]
    kept = {part: {name: state[part][name] for name in now[part]} for part in locked.STATE_PARTS}
    assert locked.differences(kept | {"code": now["code"]}, now) == []


def answers(folder: Path, count: int, **changed: Any) -> Path:
    for number in range(count):
        (folder / f"case {number}").mkdir(parents=True)
        text = json.dumps(ANSWER | (changed if number == 1 else {}))
        (folder / f"case {number}" / "answer.json").write_text(text, encoding="utf-8")
    return folder


def test_a_lock_is_carried_over_to_code_that_answers_the_same(record: Path, tmp_path: Path) -> None:
    """In other words, and in another time."""
    content = read_json(record)
    content["state"]["code"] = "before"
    write_json(record, content)
    with pytest.raises(ConfigurationError, match="code that decides has changed"):
        locked.require_locked()
    before = answers(tmp_path / "before", 4)
    after = answers(tmp_path / "after", 4, reason="this is why", seconds=12.0, more=1)
    arguments = ["--before", str(before), "--after", str(after), "--why", "other names"]
    assert locked.main(arguments) == 0
    assert locked.require_locked() == "name"  # it is the same lock: it is scored once
    (entry,) = read_json(record)["carried_over"]
    assert entry["same_answers"] == 4 and entry["why"] == "other names"
    assert entry["not_calibrated"] == ["floor_factor"]


@pytest.mark.parametrize(
    ("count", "changed", "said"),
    [
        (3, {}, "4 are needed"),
        (4, {"verdict": "ambiguous"}, "verdict is ambiguous, and was named"),
        (4, {"findings": []}, "findings.length is 0, and was 1"),
        (
            4,
            {"findings": [{**ANSWER["findings"][0], "score": 1234.500001}]},  # type: ignore[index]
            "findings.0.score is 1234.500001, and was 1234.5",
        ),
    ],
)
def test_a_lock_is_not_carried_over_where_answers_differ(
    record: Path, tmp_path: Path, count: int, changed: dict[str, Any], said: str
) -> None:
    before = answers(tmp_path / "before", 4)
    with pytest.raises(DataError, match=said):
        locked.carried_over(before, answers(tmp_path / "after", count, **changed), "x")


@pytest.mark.parametrize(
    ("where", "name"),
    [
        (("thresholds",), "gates.smallest_strength"),  # as calibrated
        (("state", "gates"), "gates.floor_factor"),  # as locked
        (("state", "method"), "method.lead_share"),
        (("state", "hydraulics"), "hydraulics.leakage"),
    ],
)
def test_a_lock_is_not_carried_over_to_other_values(
    record: Path, tmp_path: Path, where: tuple[str, ...], name: str
) -> None:
    """Though all cases that were asked have the same answers."""
    content = part = read_json(record)
    for key in where:
        part = part[key]
    part[name.split(".")[1]] = 4.5
    write_json(record, content)
    both = answers(tmp_path / "before", 4), answers(tmp_path / "after", 4)
    with pytest.raises(ConfigurationError, match=f"{name}: not as locked"):
        locked.carried_over(*both, "x")


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
    lock.write_gates(tmp_path / "independent.yaml", found)
    written, packaged = load_thresholds(tmp_path / "independent.yaml"), load_thresholds()
    assert written.gates.model_dump() == found["thresholds"]
    assert written.method == packaged.method


@pytest.mark.parametrize(
    ("given", "said"),
    [
        (("--set", "tuning", "--gates", "independent.yaml"), "calibration or independent_clean"),
        (("--set", "tuning", "--lock"), "with --set calibration or independent_clean"),
    ],
)
def test_gates_are_calibrated_with_what_hides_nothing(given, said, capsys) -> None:
    with pytest.raises(SystemExit):
        benchmark.main(given)
    assert said in capsys.readouterr().err


def crossed_with(monkeypatch: pytest.MonkeyPatch, tmp_path: Path, *arguments: str) -> list[Batch]:
    """The batches that a scoring of 16 cases would run."""
    asked: list[Batch] = []
    monkeypatch.setattr(benchmark, "run_batch", lambda batch: asked.append(batch) or 0)
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
    (only,) = crossed_with(monkeypatch, tmp_path, "--simulator", "independent")[0].answers
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
    first, second = crossed_with(monkeypatch, tmp_path)
    assert (first.first, first.last, second.last) == (0, 8, 16)
    by_package, by_independent = first.answers
    assert by_package == only
    assert load_thresholds(by_independent.thresholds).gates.score_factor == 9.5
    assert len(by_independent.names or ()) == 8 and not independent & set(
        by_independent.names or ()
    )


def test_a_batch_answers_its_own_cases_alone(tmp_path: Path, monkeypatch) -> None:
    """Other workers of a cluster make and answer theirs in the same folders."""
    stages: list[list[str]] = []
    monkeypatch.setattr(
        benchmark, "stage", lambda name, *rest: stages.append([name, *map(str, rest[2:])]) or 0
    )
    words = ["--set", "tuning", "--cases", "16", "--out", str(tmp_path)]
    monkeypatch.setattr(benchmark, "score", lambda *_: None)
    assert benchmark.main(words) == 0
    names = [case.name for case in cases(CaseSet.TUNING, 16)]
    made = [words for name, *words in stages if name == "make_cases"]
    assert [words[words.index("--from") + 1] for words in made] == ["0", "8"]
    answered = [words for name, *words in stages if name == "answer_cases"]
    assert [words[1:] for words in answered] == [names[:8], names[8:]]


@pytest.mark.usefixtures("primary_alone")
def test_gates_from_the_independent_simulator_are_part_of_what_is_locked() -> None:
    write_json(locked.INDEPENDENT_GATES, {"score_factor": 9.5})
    with pytest.raises(
        ConfigurationError, match=r"independent_gates.score_factor is 9.5, locked at None"
    ):
        locked.require_locked()
