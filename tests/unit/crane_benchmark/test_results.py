"""Rates, thresholds, and results of all kinds, on rows made up for the purpose."""

from collections.abc import Sequence
from io import StringIO
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console

from crane_benchmark import BlindAnswer, Case, Judgement
from crane_benchmark.answers.answer_cases import AnswerStatistics
from crane_benchmark.cases.case import Simulator, Story
from crane_benchmark.cases.case_sets import RELATIVE_MAGNITUDES, CaseSet, cases
from crane_benchmark.measured import MeasuredFigures, MeasuredRow, write
from crane_benchmark.scores import figures, published
from crane_benchmark.scores.figures import agreement, together
from crane_benchmark.scores.judgement import AND_MORE
from crane_benchmark.scores.published import notes, side_by_side, tables
from crane_benchmark.scores.summary import (
    BenchmarkResults,
    CaseRow,
    ScoredEffect,
    by_simulator,
    median,
    rate,
    summary,
)


def test_rates_have_the_interval_of_wilson():
    """By hand for 8 of 10 and z = 1.96: (0.8 + z²/20 ± z sqrt(0.016 + z²/400)) / (1 + z²/10)."""
    found = rate([True] * 8 + [False] * 2)
    z = 1.959964
    half = z * np.sqrt(0.016 + z**2 / 400)
    ends = [(0.8 + z**2 / 20 + sign * half) / (1 + z**2 / 10) for sign in (-1, 1)]
    assert found.rate == 0.8
    assert found.interval == pytest.approx(ends, rel=1e-6)
    assert rate([]).rate is None


def test_medians_leave_out_what_is_not_finite():
    found = median([1.0, 2.0, 3.0, np.nan])
    assert found.of == 3 and found.median == 2.0
    assert 1.0 <= found.interval[0] <= 2.0 <= found.interval[1] <= 3.0


def test_gates_share_the_alarms_that_are_allowed():
    rng = np.random.default_rng(5)
    values = rng.exponential(size=(2000, 2))
    limits, alarms = together(values, 0.03)
    assert alarms <= 60
    assert alarms > 40  # not stricter than needed
    shares = (values > limits).mean(axis=0)
    assert shares == pytest.approx([0.015, 0.015], abs=0.0075)
    assert (values > limits).any(axis=1).sum() == alarms


def made_up(case: Case) -> CaseRow:
    """A row of the results: whatever is hidden is found from 2 % on."""
    found = [e for e in case.effects if e.relative_magnitude >= 0.02]
    right = (not case.effects and not case.off) or bool(found)
    named = tuple(((e.effect, e.joint or "all"),) for e in found)
    return CaseRow(
        case=case.name,
        kind=case.kind,
        simulator=case.simulator,
        world=case.world,
        off=case.off,
        story=case.story,
        excitation=case.excitation,
        hidden=[ScoredEffect(wanted=e, visibility=0.5) for e in case.effects],
        gap={},
        above_noise=bool(case.effects) or case.off,
        outcomes={
            "diagnose": Judgement.RIGHT if right else Judgement.MISSED,
            "always Stribeck": Judgement.WRONG_NAME if case.effects else Judgement.FALSE_ALARM,
        },
        answers={
            "diagnose": BlindAnswer(verdict=AND_MORE if found else "none", findings=named),
            "always Stribeck": BlindAnswer.of_names([("stribeck", "telescope")]),
        },
        reason="made up",
        statistics=statistics(best=100.0, learner=0.01) if found else statistics(0.5, 0.0),
        seconds=30.0,
        parameter_errors=[],
        closed=0.9 if found else None,
        closed_by_learner=0.4 if case.effects else None,
    )


def statistics(
    best: float, learner: float = 0.0, promised: Sequence[float] = ()
) -> AnswerStatistics:
    """Of which only some matter."""
    return AnswerStatistics(
        best=best,
        score=best,
        accepted=0.0,
        learner=learner,
        relative_magnitude=0.0,
        floor=0.0,
        sample_noise=1.0,
        pulsation=0.0,
        flow=0.0,
        flow_left=0.0,
        promised=list(promised),
    )


def test_results_of_all_kinds_are_summed_up_printed_and_drawn(tmp_path):
    rows = [made_up(case) for case in cases(CaseSet.TUNING, 60)]
    found = summary(rows)
    ours, baseline = found.methods["diagnose"], found.methods["always Stribeck"]
    assert (ours.false_alarms.rate, baseline.false_alarms.rate) == (0.0, 1.0)
    assert [ours.power[s].rate for s in RELATIVE_MAGNITUDES] == [0.0, 0.0, 1.0, 1.0, 1.0, 1.0]
    assert [found.learner.power[s].rate for s in RELATIVE_MAGNITUDES] == [0, 0, 1, 1, 1, 1]
    weak = [row for row in rows if row.above_noise and row.answers["diagnose"].verdict == "none"]
    assert ours.false_reassurance.count == len(weak) > 0
    assert baseline.false_reassurance.count == 0  # it always names something
    assert ours.lengths_recognised.count == 0 < ours.lengths_recognised.of
    assert (ours.hedged.rate, baseline.hedged.rate) == (1.0, None)
    assert found.gap_closed.median == 0.9
    console = Console(width=144, record=True, file=StringIO())
    console.print(*tables(found), *notes())
    assert "cyclic_friction = position_friction" in " ".join(console.export_text().split())
    simulators = {simulator: summary(some) for simulator, some in by_simulator(rows).items()}
    results = BenchmarkResults(
        thresholds="made up", summary=found, simulators=simulators, cases=rows
    )
    results.write(tmp_path / "results.json")
    assert BenchmarkResults.read(tmp_path / "results.json") == results
    figures.write(tmp_path, rows)
    published.write(tmp_path / "figures.json", found)
    shown = MeasuredFigures.read(tmp_path / "figures.json")
    assert shown.columns == ["primary, 60 cases", "target", "diagnose", "always Stribeck"]
    assert shown.value("false_alarms") == 0.0
    assert shown.value("gap_closed") == found.gap_closed.median
    assert all(len(row.shown) == 4 for row in shown.rows)
    for name in ("power", "threshold", "confusion"):
        assert (tmp_path / f"{name}.png").stat().st_size > 10_000


@pytest.mark.parametrize(("factor", "above"), [(1.0, 0.03), (2.0, 0.173)])
def test_scores_are_compared_with_what_the_bootstrap_promises(factor, above):
    """Of exponential scores, 3 % lie above their quantile of 97 %, of twice these sqrt(3 %)."""
    promised = -np.log(1.0 - np.linspace(0.0, 0.9999, 101))
    scores = -factor * np.log(1.0 - (np.arange(400) + 0.5) / 400)
    found = agreement([statistics(score, promised=promised.tolist()) for score in scores])
    assert found.above.rate == pytest.approx(above, abs=0.005)
    assert np.polyfit(found.promised[:380], found.found[:380], 1)[0] == pytest.approx(
        factor, rel=0.05
    )


def test_what_became_of_each_story_is_told():
    rows = [made_up(case) for case in cases(CaseSet.STRANGERS, 12)]
    found = summary(rows)
    assert found.stories[Story.LOAD] == {Judgement.RIGHT: 3}
    assert sum(n for told in found.stories.values() for n in told.values()) == 12
    console = Console(width=144, record=True, file=StringIO())
    console.print(*tables(found))
    assert "a load, on and off" in console.export_text()


def test_the_rows_of_a_set_are_told_by_site():
    rows = [made_up(case) for case in cases(CaseSet.SCORING, 80)]
    found = by_simulator(rows)
    assert {simulator: len(some) for simulator, some in found.items()} == {
        Simulator.PRIMARY: 40,
        Simulator.INDEPENDENT: 40,
    }
    assert by_simulator(found[Simulator.INDEPENDENT]).keys() == {Simulator.INDEPENDENT}


def published_of(tmp_path: Path, simulator: Simulator, count: int) -> MeasuredFigures:
    rows = by_simulator([made_up(case) for case in cases(CaseSet.SCORING, count)])[simulator]
    published.write(tmp_path / f"{simulator}.json", summary(rows), CaseSet.SCORING, simulator)
    return MeasuredFigures.read(tmp_path / f"{simulator}.json")


def test_simulators_stand_side_by_side_each_with_its_aims(tmp_path, capsys):
    primary, independent = (published_of(tmp_path, simulator, 80) for simulator in Simulator)
    assert independent.command == "make discrepancy-benchmark"
    sets = {"primary": primary, "independent": independent}
    rows = {row.shown[0]: row.shown for row in side_by_side(sets)}
    alarms = rows["nothing injected: false alarms"]
    assert alarms[2].startswith("0\xa0% [0\xa0%,") and alarms[2].endswith("of 8")
    assert alarms[4].endswith("of 8")
    assert rows["all answers: crashed"][2].startswith("0.0\xa0% [0.0\xa0%,")
    assert rows["single, from 2\xa0%, identifiable"][1::2] == ["≥ 97\xa0%", "≥ 92\xa0%"]
    assert rows["share of the explainable model error removed"][1::2] == ["≥ 90\xa0%", "≥ 85\xa0%"]
    files = [f"{name}={tmp_path / name}.json" for name in ("primary", "independent")]
    assert published.main([*files, "--out", str(tmp_path / "both.json")]) == 0
    assert "independent, 40 cases" in capsys.readouterr().out
    written = MeasuredFigures.read(tmp_path / "both.json")
    assert {row.shown[0] for row in written.rows} == set(rows)
    assert written.columns[1:] == [
        "aim primary",
        "primary, 40 cases",
        "aim independent",
        "independent, 40 cases",
    ]


def test_what_is_no_set_is_refused(tmp_path, capsys):
    assert published.main(["independent"]) == 1
    assert "NAME=FILE" in capsys.readouterr().err
    write(tmp_path / "other.json", "make bench", [MeasuredRow(cells=["a", "b", "c"])])
    assert published.main([f"independent={tmp_path / 'other.json'}"]) == 1
    assert "has written" in capsys.readouterr().err
