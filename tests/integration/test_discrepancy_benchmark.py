"""The blind benchmark of diagnoses: its machinery, in small. What it measures is not asked here."""

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from crane_benchmark import Folders, Judgement
from crane_benchmark.folders import done, new
from crane_benchmark.scores import lock

CASES = 1  # a single effect


def run(module: str, *arguments: object) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", f"crane_benchmark.{module}", *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True)


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> tuple[Folders, str]:
    """A quick run of one case: its folders, and what it prints."""
    out = tmp_path_factory.mktemp("benchmark")
    what = ("--set", "tuning", "--cases", CASES, "--quick", "--workers", 1, "--out", out)
    ended = run("benchmark", *what, "--keep-bags")
    assert ended.returncode == 0, ended.stderr
    return Folders(out / "tuning"), ended.stdout


def test_every_case_is_answered_and_scored(finished):
    folders, said = finished
    results = json.loads(folders.results.read_text(encoding="utf-8"))
    assert len(results["cases"]) == CASES
    assert results["summary"]["cases"] == CASES
    assert "all answers: none" in said
    for row in results["cases"]:
        assert row["outcomes"]["diagnose"] != Judgement.CRASH, row["reason"]
        assert (folders.answers / row["case"] / "answer.json").exists()
    for name in ("power", "confusion"):
        assert (folders.top / f"{name}.png").stat().st_size > 5_000


def test_nothing_given_to_the_answering_process_tells_what_is_hidden(finished):
    folders, _ = finished
    for name in done(folders.sealed):
        case = json.loads((folders.sealed / name / "case.json").read_text(encoding="utf-8"))
        told = "\n".join(str(path) for path in (folders.bags / name).rglob("*"))
        told += (folders.bags / name / "model.yaml").read_text(encoding="utf-8")
        for effect in case["effects"]:
            assert effect["effect"] not in told
        times = {path.name for path in (folders.bags / name).iterdir()}
        assert times == {"model.yaml", "train", "validate"}


PEEK = """
import sys
from pathlib import Path
from crane_benchmark.answers.answer_cases import blindfold
from crane_benchmark.answers.answer_cases import PeekError
from crane_benchmark.folders import Folders
folders = Folders(Path(sys.argv[1]))
label = Path("sealed") / sys.argv[2] / "case.json"
blindfold(folders)
assert sorted(path.name for path in folders.bags.iterdir())
for attempt in sys.argv[3:]:
    try:
        exec(attempt)
    except PeekError:
        continue
    sys.exit(f"not refused: {attempt}")
"""


def test_the_answering_process_sees_neither_labels_nor_what_made_them(finished):
    folders, _ = finished
    name = min(done(folders.sealed))
    attempts = (
        "list(folders.sealed.rglob('case.json'))",
        "open(folders.top / label)",
        "open(folders.bags / '..' / label)",
        "list(folders.top.iterdir())",
        "import crane_sim.plant.plant",
        "import crane_benchmark.independent.readings",
        "import crane_benchmark.independent.plant",
        "import crane_benchmark.cases.case_sets",
        "import crane_benchmark.cases.case",
    )
    ended = subprocess.run(
        [sys.executable, "-c", PEEK, str(folders.top), name, *attempts],
        capture_output=True,
        text=True,
    )
    assert ended.returncode == 0, ended.stderr


def test_what_is_finished_is_not_made_again(finished):
    folders, _ = finished

    def stamps() -> dict[Path, Any]:
        parts = (folders.bags, folders.sealed, folders.answers)
        return {p: p.stat().st_mtime_ns for part in parts for p in part.rglob("*.*")}

    before = stamps()
    what = ("--folder", folders.top, "--set", "tuning", "--count", CASES, "--quick")
    assert run("cases.make_cases", *what).returncode == 0
    assert run("answers.answer_cases", "--folder", folders.top, "--keep-bags").returncode == 0
    assert stamps() == before


def test_other_thresholds_answer_the_same_bags_beside(finished):
    folders, _ = finished
    opened = lock.write_open(folders.top)
    what = ("--set", "tuning", "--cases", CASES, "--quick", "--workers", 1, "--keep-bags")
    ended = run("benchmark", *what, "--out", folders.top.parent, "--thresholds", opened)
    assert ended.returncode == 0, ended.stderr
    beside = Folders(folders.top, opened.stem)
    assert done(beside.answers) == done(folders.answers)
    assert beside.results.exists()


def test_half_of_a_case_is_not_there(tmp_path):
    with pytest.raises(KeyboardInterrupt), new(tmp_path / "answers" / "a") as folder:
        (folder / "half").touch()
        raise KeyboardInterrupt
    assert done(tmp_path / "answers") == set()
    with new(tmp_path / "answers" / "a") as folder:
        assert not (folder / "half").exists()
    assert done(tmp_path / "answers") == {"a"}


def test_too_few_cases_set_no_threshold(finished):
    with pytest.raises(lock.DataError, match="30 are needed"):
        lock.calibrated(finished[0])
