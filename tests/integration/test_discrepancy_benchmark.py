"""The blind benchmark of diagnoses: its machinery, in small. What it measures is not asked here."""

import json
import subprocess
import sys
from io import StringIO
from pathlib import Path
from typing import Any

import benchmark
import figures
import freeze
import numpy as np
import pytest
from calibration import agreement, together
from cases import SHARES, STRENGTHS, Case, CaseSet, Kind, apportioned, cases
from folders import Folders, done, new
from judgement import Answer, Outcome, judge
from leave_one_out import Left, became
from motions import Excitation
from printed import notes, tables
from rates import median, rate
from rich.console import Console
from summary import summary

SCRIPTS = Path(benchmark.__file__).parent
CASES = 1  # a single effect
STRIBECK, LOAD = ("stribeck", "telescope"), ("load_friction", "telescope")
"""Two effects."""
CYCLIC, LINEAR = ("cyclic_friction", "telescope"), ("position_friction", "telescope")
"""Two laws of one effect."""


def run(script: str, *arguments: object) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, str(SCRIPTS / f"{script}.py"), *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True)


# --- which cases there are ------------------------------------------------------------------------


def test_sets_share_no_case():
    names = [case.name for which in CaseSet for case in cases(which, 60)]
    seeds = [case.seed for which in CaseSet for case in cases(which, 60)]
    assert len(set(names)) == len(set(seeds)) == 180


def test_kinds_have_their_shares_and_names_tell_nothing():
    drawn = cases(CaseSet.SCORING, 100)
    kinds = [case.kind for case in drawn]
    assert {kind: kinds.count(kind) for kind in Kind} == {
        kind: round(100 * share) for kind, share in SHARES.items()
    }
    assert len(set(kinds[:20])) > 2  # sorted by name, not by kind
    single = [case.effects[0].strength for case in drawn if case.kind is Kind.SINGLE]
    assert {strength: single.count(strength) for strength in STRENGTHS} == dict.fromkeys(
        STRENGTHS, 7
    )
    assert all(len({e.effect for e in c.effects}) == 2 for c in drawn if c.kind is Kind.PAIR)


def test_calibration_hides_nothing():
    assert all(not case.effects for case in cases(CaseSet.CALIBRATION, 40))


@pytest.mark.parametrize("count", [1, 7, 40, 143])
def test_shares_add_up(count):
    assert sum(apportioned(SHARES, count).values()) == count


# --- whether an answer is right -------------------------------------------------------------------


def answer(verdict: str, *findings: tuple[tuple[str, str], ...]) -> Answer:
    return Answer(verdict, findings)


@pytest.mark.parametrize(
    ("kind", "hidden", "given", "outcome"),
    [
        (Kind.NOTHING, [], answer("none"), Outcome.RIGHT),
        (Kind.NOTHING, [], answer("insufficient_data"), Outcome.REFUSED),
        (Kind.NOTHING, [], answer("unknown"), Outcome.FALSE_ALARM),
        (Kind.NOTHING, [], answer("named", (STRIBECK,)), Outcome.FALSE_ALARM),
        (Kind.OUTSIDE, [("detent", "telescope")], answer("unknown"), Outcome.RIGHT),
        (
            Kind.OUTSIDE,
            [("detent", "telescope")],
            answer("named", (STRIBECK,)),
            Outcome.WRONG_NAME,
        ),
        (Kind.OUTSIDE, [("detent", "telescope")], answer("none"), Outcome.MISSED),
        (Kind.SINGLE, [STRIBECK], answer("named", (STRIBECK,)), Outcome.RIGHT),
        (
            Kind.SINGLE,
            [STRIBECK],
            answer("named", (("stribeck", "inner_boom"),)),
            Outcome.WRONG_NAME,
        ),
        (
            Kind.SINGLE,
            [STRIBECK],
            answer("named", (STRIBECK,), (LOAD,)),
            Outcome.WRONG_NAME,
        ),
        (Kind.SINGLE, [CYCLIC], answer("named", (LINEAR,)), Outcome.RIGHT),
        (Kind.SINGLE, [CYCLIC], answer("class", (CYCLIC, LINEAR)), Outcome.RIGHT),
        (Kind.SINGLE, [CYCLIC], answer("named", (LINEAR,), (CYCLIC,)), Outcome.RIGHT),
        (Kind.PAIR, [CYCLIC, LOAD], answer("named", (LINEAR,), (CYCLIC,)), Outcome.PARTLY),
        (
            Kind.SINGLE,
            [CYCLIC],
            answer("named", (("position_friction", "inner_boom"),)),
            Outcome.WRONG_NAME,
        ),
        (Kind.SINGLE, [STRIBECK], answer("class", (LOAD, STRIBECK)), Outcome.TOO_WIDE),
        (Kind.SINGLE, [STRIBECK], answer("unknown"), Outcome.NOT_NAMED),
        (Kind.SINGLE, [STRIBECK], answer("crash"), Outcome.CRASH),
        (Kind.PAIR, [STRIBECK, LOAD], answer("named", (LOAD,), (STRIBECK,)), Outcome.RIGHT),
        (Kind.PAIR, [STRIBECK, LOAD], answer("named", (LOAD,)), Outcome.PARTLY),
        (Kind.INSUFFICIENT, [STRIBECK], answer("insufficient_data"), Outcome.RIGHT),
        (Kind.INSUFFICIENT, [STRIBECK], answer("none"), Outcome.MISSED),
        (Kind.INSUFFICIENT, [STRIBECK], answer("class", (LOAD, STRIBECK)), Outcome.RIGHT),
        (Kind.INSUFFICIENT, [STRIBECK], answer("named", (LOAD,)), Outcome.WRONG_NAME),
        (
            Kind.CLASS,
            [],
            answer("class", (("offset", "telescope"), ("coulomb_asymmetry", "telescope"))),
            Outcome.RIGHT,
        ),
        (Kind.CLASS, [], answer("named", (("offset", "telescope"),)), Outcome.WRONG_NAME),
    ],
)
def test_answers_are_judged(kind, hidden, given, outcome):
    assert judge(kind, hidden, given, lambda number, other: False) is outcome


def test_a_class_of_effects_that_explain_as_well_is_right():
    given = answer("class", (LOAD, STRIBECK))
    assert judge(Kind.SINGLE, [STRIBECK], given, lambda _, other: other == LOAD) is Outcome.RIGHT


def test_findings_are_read_with_their_classes():
    finding = {"effect": "a", "joint": "j", "class_members": [{"effect": "b", "joint": "all"}]}
    given = Answer.of_diagnosis({"verdict": "class", "findings": [finding]})
    assert given == answer("class", (("a", "j"), ("b", "all")))
    assert given.headline == "a"


@pytest.mark.parametrize(
    ("given", "left"),
    [
        (answer("unknown"), Left.UNKNOWN),
        (answer("none"), Left.SILENT),
        (answer("named", (("presliding", "telescope"),)), Left.DECLARED),
        (answer("class", (LOAD, ("presliding", "telescope"))), Left.DECLARED_CLASS),
        (answer("named", (("presliding", "inner_boom"),)), Left.WRONG),
        (answer("named", (("presliding", "telescope"),), (("hose_mass", "all"),)), Left.WRONG),
    ],
)
def test_what_becomes_of_an_effect_whose_entry_is_left_out(given, left):
    assert became(STRIBECK, given) is left


# --- arithmetic -----------------------------------------------------------------------------------


def test_rates_have_the_interval_of_wilson():
    """By hand for 8 of 10 and z = 1.96: (0.8 + z²/20 ± z sqrt(0.016 + z²/400)) / (1 + z²/10)."""
    found = rate([True] * 8 + [False] * 2)
    z = 1.959964
    half = z * np.sqrt(0.016 + z**2 / 400)
    ends = [(0.8 + z**2 / 20 + sign * half) / (1 + z**2 / 10) for sign in (-1, 1)]
    assert found["rate"] == 0.8
    assert found["interval"] == pytest.approx(ends, rel=1e-6)
    assert rate([])["rate"] is None


def test_medians_leave_out_what_is_not_finite():
    found = median([1.0, 2.0, 3.0, np.nan])
    assert found["of"] == 3 and found["median"] == 2.0
    assert 1.0 <= found["interval"][0] <= 2.0 <= found["interval"][1] <= 3.0


def test_gates_share_the_alarms_that_are_allowed():
    rng = np.random.default_rng(5)
    values = rng.exponential(size=(2000, 2))
    limits, alarms = together(values, 0.03)
    assert alarms <= 60
    assert alarms > 40  # not stricter than needed
    shares = (values > limits).mean(axis=0)
    assert shares == pytest.approx([0.015, 0.015], abs=0.0075)
    assert (values > limits).any(axis=1).sum() == alarms


# --- results --------------------------------------------------------------------------------------


def made_up(case: Case) -> dict[str, Any]:
    """A row of the results: whatever is hidden is found from 2 % on."""
    found = [e for e in case.effects if e.strength >= 0.02]
    right = not case.effects or bool(found)
    return {
        "case": case.name,
        "kind": case.kind.value,
        "hidden": [e.model_dump() | {"visibility": 0.5} for e in case.effects],
        "outcomes": {
            "diagnose": Outcome.RIGHT.value if right else Outcome.MISSED.value,
            "always Stribeck": (Outcome.WRONG_NAME if case.effects else Outcome.FALSE_ALARM).value,
        },
        "headlines": {"diagnose": found[0].effect if found else "none"},
        "statistics": {"score": 100.0 if found else 0.5, "learner": 0.01 if found else 0.0},
        "seconds": 30.0,
        "parameter_errors": [],
        "closed": 0.9 if found else None,
        "closed_by_learner": 0.4 if case.effects else None,
    }


def test_results_of_all_kinds_are_summed_up_printed_and_drawn(tmp_path):
    rows = [made_up(case) for case in cases(CaseSet.TUNING, 60)]
    found = summary(rows)
    ours, other = found["methods"]["diagnose"], found["methods"]["always Stribeck"]
    assert (ours["false_alarms"]["rate"], other["false_alarms"]["rate"]) == (0.0, 1.0)
    assert [ours["power"][f"{s:g}"]["rate"] for s in STRENGTHS] == [0.0, 0.0, 1.0, 1.0, 1.0]
    assert [found["learner"]["power"][f"{s:g}"]["rate"] for s in STRENGTHS] == [0, 0, 1, 1, 1]
    assert found["gap_closed"]["median"] == 0.9
    console = Console(width=144, record=True, file=StringIO())
    console.print(*tables({"summary": found}), *notes())
    assert "cyclic_friction = position_friction" in console.export_text()
    figures.write(tmp_path, rows)
    for name in ("power", "threshold", "confusion"):
        assert (tmp_path / f"{name}.png").stat().st_size > 10_000


@pytest.mark.parametrize(("factor", "above"), [(1.0, 0.03), (2.0, 0.173)])
def test_scores_are_compared_with_what_the_bootstrap_promises(factor, above):
    """Of exponential scores, 3 % lie above their quantile of 97 %, of twice these sqrt(3 %)."""
    promised = -np.log(1.0 - np.linspace(0.0, 0.9999, 101))
    scores = -factor * np.log(1.0 - (np.arange(400) + 0.5) / 400)
    found = agreement([{"score": one, "promised": promised.tolist()} for one in scores])
    assert found["above"]["rate"] == pytest.approx(above, abs=0.005)
    assert np.polyfit(found["promised"][:380], found["found"][:380], 1)[0] == pytest.approx(
        factor, rel=0.05
    )


# --- the processes --------------------------------------------------------------------------------


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
    assert "false alarms" in said
    for row in results["cases"]:
        assert row["outcomes"]["diagnose"] != Outcome.CRASH, row["reason"]
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
from answer_cases import blindfold
from confinement import PeekError
from folders import Folders
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
        "import crane_sim.plant",
        "import cases",
    )
    ended = subprocess.run(
        [sys.executable, "-c", PEEK, str(folders.top), name, *attempts],
        capture_output=True,
        text=True,
        cwd=SCRIPTS,
    )
    assert ended.returncode == 0, ended.stderr


def test_what_is_finished_is_not_made_again(finished):
    folders, _ = finished

    def stamps() -> dict[Path, Any]:
        parts = (folders.bags, folders.sealed, folders.answers)
        return {p: p.stat().st_mtime_ns for part in parts for p in part.rglob("*.*")}

    before = stamps()
    what = ("--folder", folders.top, "--set", "tuning", "--count", CASES, "--quick")
    assert run("make_cases", *what).returncode == 0
    assert run("answer_cases", "--folder", folders.top, "--keep-bags").returncode == 0
    assert stamps() == before


def test_half_of_a_case_is_not_there(tmp_path):
    with pytest.raises(KeyboardInterrupt), new(tmp_path / "answers" / "a") as folder:
        (folder / "half").touch()
        raise KeyboardInterrupt
    assert done(tmp_path / "answers") == set()
    with new(tmp_path / "answers" / "a") as folder:
        assert not (folder / "half").exists()
    assert done(tmp_path / "answers") == {"a"}


def test_scoring_is_refused_where_thresholds_are_not_frozen(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(freeze, "RECORD", tmp_path / "frozen.json")
    (tmp_path / "frozen.json").write_text('{"digest": "other"}', encoding="utf-8")
    assert benchmark.main(["--out", str(tmp_path)]) == 1
    assert "not what was frozen" in capsys.readouterr().err


def test_too_few_cases_set_no_threshold(finished):
    with pytest.raises(freeze.DataError, match="30 are needed"):
        freeze.calibrated(finished[0])


def test_motions_are_rich_where_they_should_be():
    rich = [case for case in cases(CaseSet.TUNING, 40) if case.kind is not Kind.INSUFFICIENT]
    assert all(case.excitation is not Excitation.POOR for case in rich)
