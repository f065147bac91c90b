"""Third process of the benchmark: opens the labels and scores the answers."""

import argparse
import sys
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from crane_benchmark.answers.answer_cases import CaseAnswer
from crane_benchmark.cases.case_sets import CaseSet
from crane_benchmark.folders import ANSWER, ROW, Folders, done, in_processes, new
from crane_benchmark.scores import figures, locked
from crane_benchmark.scores.judgement import OURS, BlindAnswer, Judgement, judge
from crane_benchmark.scores.published import notes, tell_rates
from crane_benchmark.scores.summary import (
    BenchmarkResults,
    CaseRow,
    ScoredEffect,
    by_simulator,
    summary,
)
from crane_benchmark.scores.truth import CaseTruth, load_truth
from crane_identification.diagnosis.candidates import LOADS
from crane_identification.diagnosis.findings import Findings
from crane_model.model_file import Model, load_model
from crane_model.terms.term import Load

NAMED = (Judgement.RIGHT, Judgement.TOO_WIDE, Judgement.PARTLY)  # where effects are named


def score_case(folders: Folders, name: str) -> None:
    """One row of the results, written beside the others."""
    sealed, given = folders.sealed / name, folders.answers / name
    truth, model = load_truth(sealed), load_model(sealed / "model.yaml")
    said = CaseAnswer.read(given / ANSWER)
    answers = {OURS: BlindAnswer.of_diagnosis(said)}
    answers |= {method: BlindAnswer.of_names(names) for method, names in said.others.items()}
    explains = partial(truth.explains, model)
    above_noise = truth.above_noise(model)
    outcomes = {
        method: judge(truth.case.kind, truth.places, answer, explains, above_noise, truth.case.off)
        for method, answer in answers.items()
    }
    gap = truth.gap(model)
    found = said.findings
    named = found if truth.places and outcomes[OURS] in NAMED else None
    row = CaseRow(
        case=name,
        kind=truth.case.kind,
        simulator=truth.case.simulator,
        world=truth.case.world,
        off=truth.case.off,
        excitation=truth.case.excitation,
        hidden=[
            ScoredEffect(wanted=effect, reached=s, visibility=v)
            for effect, s, v in zip(
                truth.case.effects, truth.relative_magnitude, truth.visibility(model), strict=True
            )
        ],
        gap=dict(zip(model.joints, gap.tolist(), strict=True)),
        above_noise=above_noise,
        outcomes=outcomes,
        answers=answers,
        reason=said.reason,
        statistics=said.statistics,
        seconds=said.seconds,
        parameter_errors=truth.parameter_errors(named) if named else [],
        closed=_closed(truth, model, given, named) if named and named.findings else None,
        closed_by_learner=_learnt(found, gap) if found and truth.places else None,
    )
    with new(folders.rows / name) as out:
        row.write(out / ROW)


def _closed(truth: CaseTruth, model: Model, given: Path, found: Findings) -> float:
    carried = {int(Path(one.recording).name): one.value or 0.0 for one in found.model_error.loads}
    return truth.closed(model, carrying(load_model(given / "model.yaml"), carried))


def carrying(model: Model, carried: dict[int, float]) -> Model:
    """The model with the loads of other recordings: their numbers to masses [kg]."""
    for term in model.terms:
        if getattr(term, LOADS, None) is None:
            continue
        new = term.model_copy(update={LOADS: tuple(Load(runs=(number,)) for number in carried)})
        part = model.part(term)
        values = (model.theta[: part.start], [*carried.values()], model.theta[part.stop :])
        terms = tuple(new if kept == term else kept for kept in model.terms)
        return replace(model, terms=terms, values=np.concatenate(values), std_devs=None)
    return model


def _learnt(found: Findings, gap: np.ndarray) -> float:
    """Share of the explainable gap (j,) that the flexible learner closes on the same recordings."""
    gained = sum(
        (one.force_relative_error or 0.0) ** 2 - (one.best_achievable or 0.0) ** 2
        for one in found.model_error.before.values()
    )
    return min(gained / float((gap**2).sum()), 1.0)


def main(argv: Sequence[str] | None = None) -> int:
    """Score the answers of a set: results.json, tables, figures."""
    parser = argparse.ArgumentParser(prog="score_cases", description=main.__doc__)
    add = parser.add_argument
    add("--folder", type=Path, required=True, help="of the set")
    add("--round", default="", help="folder of the answers within the folder (default: itself)")
    add("--workers", type=int, default=1)
    arguments = parser.parse_args(argv)
    folders = Folders(arguments.folder, arguments.round)
    answered = sorted(done(folders.answers) & done(folders.sealed))
    waiting = {name: name for name in answered if name not in done(folders.rows)}
    if waiting:
        in_processes(partial(score_case, folders), waiting, arguments.workers, "scores")
    scored = [CaseRow.read(folders.rows / name / ROW) for name in sorted(done(folders.rows))]
    found, thresholds = summary(scored), locked.digest(locked.state())
    simulators = by_simulator(scored)
    of_simulators = {simulator: summary(rows) for simulator, rows in simulators.items()}
    BenchmarkResults(
        thresholds=thresholds, summary=found, simulators=of_simulators, cases=scored
    ).write(folders.results)
    for simulator, rows in simulators.items():
        place = folders.scores / simulator.value if len(simulators) > 1 else folders.scores
        place.mkdir(exist_ok=True)
        figures.write(place, rows)
        which, found = CaseSet(folders.top.name), of_simulators[simulator]
        tell_rates(place / "figures.json", which, simulator, found)
    print(*notes(), sep="\n")
    print(f"written: {folders.results}, and figures beside it")
    return 0


if __name__ == "__main__":
    sys.exit(main())
