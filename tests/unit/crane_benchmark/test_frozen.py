"""Nothing that a verdict depends on changes with the freeze as it was; what changes none does."""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from crane_benchmark import batch, benchmark
from crane_benchmark.answers.answer_cases import AnswerStatistics, CaseAnswer
from crane_benchmark.batch import Batch
from crane_benchmark.cases.case import Site
from crane_benchmark.cases.case_sets import CaseSet, cases
from crane_benchmark.folders import Folders, new, read_json, write_json
from crane_benchmark.scores import carry_over, freeze, frozen
from crane_identification.thresholds import load_thresholds
from crane_model.errors import ConfigurationError, DataError

ANSWER = {
    "verdict": "named",
    "reason": "they say so",
    "findings": [{"effect": "offset", "joint": "telescope", "score": 1234.5}],
    "seconds": 31.0,
}


@pytest.fixture(scope="module")
def sources() -> dict[str, str]:
    """The code of the suite behind a diagnosis, by its file."""
    return {path.stem: path.read_text(encoding="utf-8") for path in frozen.modules()}


def test_all_code_between_a_bag_and_its_verdict_counts(sources) -> None:
    decides = {"decision", "verdict", "learner", "pulsation", "autoregression", "friction"}
    assert decides | {"kalman", "reader"} <= set(sources)
    assert not {"findings", "explain", "page", "identification_node", "plant"} & set(sources)


@pytest.mark.parametrize(
    ("module", "old", "new"),
    [
        ("learner", "FEWEST_ROWS = 60", "FEWEST_ROWS = 61"),
        ("evidence", "VISIBLE_SHARE = 0.02", "VISIBLE_SHARE = 0.03"),
        ("decision", "if one.score <= one.threshold:", "if one.score < one.threshold:"),
        ("pulsation", "one.clearness > least", "one.clearness > 0.6 * least"),
        ("chance", "size > 1e-6", "size > 1e-5"),
    ],
)
def test_a_number_or_a_sign_that_decides_is_noticed(sources, module, old, new) -> None:
    assert old in sources[module]
    beside, changed = sources["loads"], sources[module].replace(old, new)
    before, after = (frozen.digest_of_code((beside, one)) for one in (sources[module], changed))
    assert before != after


def test_comments_docstrings_imports_and_places_do_not_count(sources) -> None:
    beside, own = sources["chance"], sources["pulsation"]
    text = "import json\n# a remark\n" + own.replace(
        '"""The lines that', '"""Of all lines those that'
    )
    assert text.count("Of all lines") == 1
    assert frozen.digest_of_code((text, beside)) == frozen.digest_of_code((beside, own))


@pytest.fixture
def record(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A record of what the package holds, and of two of its modules, in place of the project's."""
    few = tuple(path for path in frozen.modules() if path.stem in ("loads", "chance"))
    monkeypatch.setattr(frozen, "modules", lambda: few)
    path = tmp_path / "frozen.json"
    state = frozen.state()
    gates = {name: value for name, value in state["gates"].items() if name != "floor_factor"}
    write_json(path, {"thresholds": gates, "digest": "name", "date": "today", "state": state})
    monkeypatch.setattr(frozen, "RECORD", path)
    yield path


def test_what_is_as_frozen_may_be_scored(record: Path) -> None:
    assert frozen.require_frozen() == "name"


@pytest.mark.parametrize(
    ("part", "name"),
    [
        ("gates", "pulsation_clearness"),
        ("method", "lead_share"),
        ("hydraulics", "leakage"),
    ],
)
def test_scoring_is_refused_where_a_value_is_not_as_frozen(
    record: Path, tmp_path: Path, capsys, part: str, name: str
) -> None:
    content = read_json(record)
    now, content["state"][part][name] = content["state"][part][name], 4.5
    write_json(record, content)
    assert benchmark.main(["--out", str(tmp_path)]) == 1
    said = capsys.readouterr().err
    assert f"{part}.{name} is {now}, frozen at 4.5" in said
    assert "not what was frozen on today" in said


def test_scoring_is_refused_where_the_code_is_not_as_frozen(
    record: Path, tmp_path: Path, capsys, monkeypatch
) -> None:
    """One constant of one module."""
    modules = frozen.modules()
    (own,) = (path for path in modules if path.stem == "loads")
    other = tmp_path / own.name
    text = own.read_text(encoding="utf-8").replace("MASS_SIGMAS = 4.0", "MASS_SIGMAS = 3.0")
    other.write_text(text, encoding="utf-8")
    monkeypatch.setattr(frozen, "modules", lambda: (*(p for p in modules if p != own), other))
    assert benchmark.main(["--out", str(tmp_path)]) == 1
    assert "the code that decides has changed" in capsys.readouterr().err


def test_the_values_of_the_package_are_those_of_the_last_freeze(monkeypatch) -> None:
    """The code may be ahead of it, until it is calibrated or shown to answer the same."""
    monkeypatch.setattr(frozen, "modules", tuple)
    now = frozen.state()
    state = read_json(frozen.RECORD)["state"]
    assert frozen.differences(state | {"code": now["code"]}, now) == []


def answers(folder: Path, count: int, **changed: Any) -> Path:
    for number in range(count):
        (folder / f"case {number}").mkdir(parents=True)
        text = json.dumps(ANSWER | (changed if number == 1 else {}))
        (folder / f"case {number}" / "answer.json").write_text(text, encoding="utf-8")
    return folder


def test_a_freeze_is_carried_over_to_code_that_answers_the_same(
    record: Path, tmp_path: Path
) -> None:
    """In other words, and in another time."""
    content = read_json(record)
    content["state"]["code"] = "before"
    write_json(record, content)
    with pytest.raises(ConfigurationError, match="code that decides has changed"):
        frozen.require_frozen()
    before = answers(tmp_path / "before", 4)
    after = answers(tmp_path / "after", 4, reason="this is why", seconds=12.0, more=1)
    arguments = ["--before", str(before), "--after", str(after), "--why", "other names"]
    assert carry_over.main(arguments) == 0
    assert frozen.require_frozen() == "name"  # it is the same freeze: it is scored once
    (entry,) = read_json(record)["carried_over"]
    assert entry["same_answers"] == 4 and entry["why"] == "other names"
    assert entry["not_calibrated"] == ["floor_factor"]


@pytest.mark.parametrize(
    ("count", "changed", "said"),
    [
        (3, {}, "4 are needed"),
        (4, {"verdict": "class"}, "verdict is class, and was named"),
        (4, {"findings": []}, "findings.length is 0, and was 1"),
        (
            4,
            {"findings": [{**ANSWER["findings"][0], "score": 1234.500001}]},  # type: ignore[index]
            "findings.0.score is 1234.500001, and was 1234.5",
        ),
    ],
)
def test_a_freeze_is_not_carried_over_where_answers_differ(
    record: Path, tmp_path: Path, count: int, changed: dict[str, Any], said: str
) -> None:
    before = answers(tmp_path / "before", 4)
    with pytest.raises(DataError, match=said):
        carry_over.carried_over(before, answers(tmp_path / "after", count, **changed), "x")


@pytest.mark.parametrize(
    ("where", "name"),
    [
        (("thresholds",), "gates.smallest_strength"),  # as calibrated
        (("state", "gates"), "gates.floor_factor"),  # as frozen
        (("state", "method"), "method.lead_share"),
        (("state", "hydraulics"), "hydraulics.leakage"),
    ],
)
def test_a_freeze_is_not_carried_over_to_other_values(
    record: Path, tmp_path: Path, where: tuple[str, ...], name: str
) -> None:
    """Though all cases that were asked have the same answers."""
    content = part = read_json(record)
    for key in where:
        part = part[key]
    part[name.split(".")[1]] = 4.5
    write_json(record, content)
    both = answers(tmp_path / "before", 4), answers(tmp_path / "after", 4)
    with pytest.raises(ConfigurationError, match=f"{name}: not as frozen"):
        carry_over.carried_over(*both, "x")


def test_open_gates_are_those_of_the_package_but_for_what_lets_alarms_through(tmp_path) -> None:
    packaged, opened = load_thresholds(), load_thresholds(freeze.write_open(tmp_path))
    for part, values in freeze.OPEN.items():
        own = getattr(packaged, part).model_dump()
        assert getattr(opened, part).model_dump() == own | values
    assert "# Rivals." in (tmp_path / "open_discrepancy.yaml").read_text(encoding="utf-8")


def test_every_gate_is_calibrated_the_pulsation_with_the_others(tmp_path: Path) -> None:
    """Null cases of which one in two has a line that would be an alarm."""
    folders = Folders(tmp_path)
    none = dict.fromkeys((gate.statistic for gate in freeze.GATES), 0.0)
    for number in range(freeze.FEWEST):
        line = 8.0 + 0.1 * number if number % 2 else 2.0
        own = none | {"pulsation": line}
        known = AnswerStatistics(best=0.5, accepted=0.0, learner=0.0, promised=[1.0] * 101, **own)
        with new(folders.answers / str(number)) as folder:
            CaseAnswer(verdict="none", reason="made up", statistics=known).write(
                folder / "answer.json"
            )
    found = freeze.calibrated(folders)
    assert set(found["thresholds"]) == set(load_thresholds().gates.model_dump())
    assert found["alarms"] == 0
    assert found["thresholds"]["pulsation_clearness"] > found["largest"]["pulsation_clearness"]
    freeze.write_gates(tmp_path / "away.yaml", found)
    written, packaged = load_thresholds(tmp_path / "away.yaml"), load_thresholds()
    assert written.gates.model_dump() == found["thresholds"]
    assert written.method == packaged.method


@pytest.mark.parametrize(
    ("given", "said"),
    [
        (("--set", "tuning", "--gates", "away.yaml"), "calibration or away_clean"),
        (("--set", "tuning", "--freeze"), "with --set calibration or away_clean"),
    ],
)
def test_gates_are_calibrated_with_what_hides_nothing(given, said, capsys) -> None:
    with pytest.raises(SystemExit):
        benchmark.main(given)
    assert said in capsys.readouterr().err


def crossed_with(monkeypatch: pytest.MonkeyPatch, tmp_path: Path, *arguments: str) -> list[Batch]:
    """The batches that a scoring of 16 cases would run."""
    asked: list[Batch] = []
    monkeypatch.setattr(benchmark, "run_batch", lambda one: asked.append(one) or 0)
    monkeypatch.setattr(benchmark, "score", lambda *_: None)
    assert benchmark.main(["--cases", "16", "--out", str(tmp_path), *arguments]) == 0
    return asked


@pytest.fixture
def home_alone(record: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The record of a freeze before which nothing was calibrated away."""
    monkeypatch.setattr(frozen, "AWAY_GATES", tmp_path / "gates_away.json")
    write_json(record, read_json(record) | {"state": frozen.state()})
    return record


def test_either_plant_is_scored_by_the_gates_of_the_other(
    home_alone: Path, tmp_path: Path, monkeypatch, capsys
) -> None:
    (only,) = crossed_with(monkeypatch, tmp_path, "--site", "away")[0].answers
    assert only.thresholds is None  # those of the package, from home
    away = {case.name for case in cases(CaseSet.SCORING, 16) if case.site is Site.AWAY}
    assert set(only.names or ()) == away
    assert benchmark.main(["--cases", "16", "--out", str(tmp_path)]) == 1
    assert "no gates were calibrated away" in capsys.readouterr().err

    gates = load_thresholds().gates.model_dump() | {"score_factor": 9.5}
    write_json(frozen.AWAY_GATES, gates)
    write_json(home_alone, read_json(home_alone) | {"state": frozen.state()})
    first, second = crossed_with(monkeypatch, tmp_path)
    assert (first.first, first.last, second.last) == (0, 8, 16)
    by_package, by_away = first.answers
    assert by_package == only
    assert load_thresholds(by_away.thresholds).gates.score_factor == 9.5
    assert len(by_away.names or ()) == 8 and not away & set(by_away.names or ())


def test_a_batch_answers_its_own_cases_alone(tmp_path: Path, monkeypatch) -> None:
    """Other workers of a cluster make and answer theirs in the same folders."""
    stages: list[list[str]] = []
    monkeypatch.setattr(
        batch, "stage", lambda name, *rest: stages.append([name, *map(str, rest[2:])]) or 0
    )
    words = ["--set", "tuning", "--cases", "16", "--out", str(tmp_path)]
    monkeypatch.setattr(benchmark, "score", lambda *_: None)
    assert benchmark.main(words) == 0
    own = [case.name for case in cases(CaseSet.TUNING, 16)]
    made = [words for name, *words in stages if name == "make_cases"]
    assert [words[words.index("--from") + 1] for words in made] == ["0", "8"]
    answered = [words for name, *words in stages if name == "answer_cases"]
    assert [words[1:] for words in answered] == [own[:8], own[8:]]


@pytest.mark.usefixtures("home_alone")
def test_gates_from_away_are_part_of_what_is_frozen() -> None:
    write_json(frozen.AWAY_GATES, {"score_factor": 9.5})
    with pytest.raises(ConfigurationError, match=r"away_gates.score_factor is 9.5, frozen at None"):
        frozen.require_frozen()
