"""Rates, thresholds, and results of all kinds, on rows made up for the purpose."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from crane_benchmark import BlindAnswer, Case, Judgement
from crane_benchmark.answers.answer_cases import AnswerStatistics
from crane_benchmark.cases.case import Simulator
from crane_benchmark.cases.case_sets import RELATIVE_MAGNITUDES, CaseSet, cases
from crane_benchmark.measured import MeasuredFigures
from crane_benchmark.scores import figures
from crane_benchmark.scores.judgement import AND_MORE
from crane_benchmark.scores.lock import above_promised, together
from crane_benchmark.scores.published import notes, tell_rates
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


def test_results_of_all_kinds_are_summed_up_printed_and_drawn(tmp_path, capsys):
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
    assert "cyclic_friction = position_friction" in " ".join(notes())
    simulators = {simulator: summary(some) for simulator, some in by_simulator(rows).items()}
    results = BenchmarkResults(
        thresholds="made up", summary=found, simulators=simulators, cases=rows
    )
    results.write(tmp_path / "results.json")
    assert BenchmarkResults.read(tmp_path / "results.json") == results
    figures.write(tmp_path, rows)
    tell_rates(tmp_path / "figures.json", CaseSet.TUNING, Simulator.PRIMARY, found)
    assert "nothing injected: false alarms" in capsys.readouterr().out
    shown = MeasuredFigures.read(tmp_path / "figures.json")
    assert shown.columns == ["primary, 60 cases", "target", "diagnose", "always Stribeck"]
    assert shown.value("false_alarms") == 0.0
    assert shown.value("gap_closed") == found.gap_closed.median
    assert all(len(row.shown) == 4 for row in shown.rows)
    for name in ("power", "confusion"):
        assert (tmp_path / f"{name}.png").stat().st_size > 10_000


@pytest.mark.parametrize(("factor", "above"), [(1.0, 0.03), (2.0, 0.173)])
def test_scores_are_compared_with_what_the_bootstrap_promises(factor, above):
    """Of exponential scores, 3 % lie above their quantile of 97 %, of twice these sqrt(3 %)."""
    promised = -np.log(1.0 - np.linspace(0.0, 0.9999, 101))
    scores = -factor * np.log(1.0 - (np.arange(400) + 0.5) / 400)
    found = above_promised([statistics(score, promised=promised.tolist()) for score in scores])
    assert found.rate == pytest.approx(above, abs=0.005)


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
    tell_rates(tmp_path / f"{simulator}.json", CaseSet.SCORING, simulator, summary(rows))
    return MeasuredFigures.read(tmp_path / f"{simulator}.json")


def test_each_simulator_has_its_own_aims(tmp_path):
    primary, independent = (published_of(tmp_path, simulator, 80) for simulator in Simulator)
    assert independent.command == "make discrepancy-benchmark"
    assert independent.columns[0] == "independent, 40 cases"
    first, second = ({row.shown[0]: row.shown for row in of.rows} for of in (primary, independent))
    for rows in (first, second):
        alarms = rows["nothing injected: false alarms"][2]
        assert alarms.startswith("0\xa0% [0\xa0%,") and alarms.endswith("of 8")
    assert first["all answers: crashed"][2].startswith("0.0\xa0% [0.0\xa0%,")
    for what, aims in (
        ("single, from 2\xa0%, identifiable", ["≥ 97\xa0%", "≥ 92\xa0%"]),
        ("share of the explainable model error removed", ["≥ 90\xa0%", "≥ 85\xa0%"]),
    ):
        assert [rows[what][1] for rows in (first, second)] == aims
