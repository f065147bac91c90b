"""Third process of the benchmark: opens the labels and scores the answers."""

import argparse
import math
import sys
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console

from crane_benchmark.folders import Folders, done, new, read_json, write_json
from crane_benchmark.scores import figures, frozen, published
from crane_benchmark.scores.judgement import OURS, BlindAnswer, Judgement, judge
from crane_benchmark.scores.printed import notes, tables
from crane_benchmark.scores.summary import summary
from crane_benchmark.scores.truth import CaseTruth, load_truth
from crane_benchmark.work import in_processes
from crane_identification.diagnosis.search.loads import LOADS
from crane_model.model_file import Model, load_model
from crane_model.terms.load import Load

WIDTH = 144  # of the tables; narrower, their columns break
NAMED = (Judgement.RIGHT, Judgement.TOO_WIDE, Judgement.PARTLY)  # where effects are named


@dataclass(frozen=True)
class ScoringJob:
    """A case that is answered."""

    name: str
    folders: Folders


def score_case(job: ScoringJob) -> None:
    """One row of the results, written beside the others."""
    sealed, given = job.folders.sealed / job.name, job.folders.answers / job.name
    truth, model = load_truth(sealed), load_model(sealed / "model.yaml")
    content, others = read_json(given / "answer.json"), read_json(given / "baselines.json")
    answers = {OURS: BlindAnswer.of_diagnosis(content)}
    answers |= {name: BlindAnswer.of_names(names) for name, names in others.items()}
    twin = partial(truth.twin, model)
    outcomes = {
        name: judge(truth.case.kind, truth.places, answer, twin) for name, answer in answers.items()
    }
    gap = truth.gap(model)
    named = bool(truth.places) and bool(answers[OURS].findings) and outcomes[OURS] in NAMED
    row = {
        "case": job.name,
        "kind": truth.case.kind.value,
        "world": truth.case.world.value,
        "story": truth.case.story,
        "excitation": truth.case.excitation.value,
        "hidden": [
            one.model_dump(mode="json") | {"reached": s, "visibility": v}
            for one, s, v in zip(
                truth.case.effects, truth.strength, truth.visibility(model), strict=True
            )
        ],
        "gap": dict(zip(model.joints, gap.tolist(), strict=True)),
        "outcomes": {name: outcome.value for name, outcome in outcomes.items()},
        "answers": {name: [answer.verdict, answer.findings] for name, answer in answers.items()},
        "headlines": {name: answer.headline for name, answer in answers.items()},
        "reason": content["reason"],
        "statistics": content.get("statistics"),
        "seconds": content.get("seconds"),
        "parameter_errors": truth.parameter_errors(content) if named else [],
        "closed": _closed(truth, model, given, content) if named else None,
        "closed_by_learner": _learnt(content, gap) if truth.places else None,
    }
    with new(job.folders.rows / job.name) as out:
        write_json(out / "row.json", row)


def _closed(truth: CaseTruth, model: Model, given: Path, content: dict[str, Any]) -> float | None:
    carried = {int(Path(one["recording"]).name): one["value"] for one in content["gap"]["loads"]}
    value = truth.closed(model, carrying(load_model(given / "model.yaml"), carried))
    return value if math.isfinite(value) else None


def carrying(model: Model, carried: dict[int, float]) -> Model:
    """The model with the loads of other recordings: their numbers to masses [kg]."""
    for term in model.terms:
        if getattr(term, LOADS, None) is None:
            continue
        new = term.model_copy(update={LOADS: tuple(Load(runs=(number,)) for number in carried)})
        part = model.part(term)
        values = (model.theta[: part.start], [*carried.values()], model.theta[part.stop :])
        terms = tuple(new if one == term else one for one in model.terms)
        return replace(model, terms=terms, values=np.concatenate(values), std_devs=None)
    return model


def _learnt(content: dict[str, Any], gap: np.ndarray) -> float | None:
    """Share of the explainable gap (j,) that the flexible learner closes on the same recordings."""
    if "gap" not in content:
        return None
    before = content["gap"]["before"].values()
    gained = sum(one["force_relative_error"] ** 2 - one["best_achievable"] ** 2 for one in before)
    return min(gained / float((gap**2).sum()), 1.0)


def main(argv: Sequence[str] | None = None) -> int:
    """Score the answers of a set: results.json, tables, figures."""
    parser = argparse.ArgumentParser(prog="score_cases", description=main.__doc__)
    add = parser.add_argument
    add("--folder", type=Path, required=True, help="of the set")
    add("--round", default="", help="folder of the answers in it (default: itself)")
    add("--workers", type=int, default=1)
    arguments = parser.parse_args(argv)
    folders = Folders(arguments.folder, arguments.round)
    answered = sorted(done(folders.answers) & done(folders.sealed))
    waiting = [ScoringJob(name, folders) for name in answered if name not in done(folders.rows)]
    if waiting:
        in_processes(score_case, waiting, arguments.workers, "scores")
    scored = [read_json(folders.rows / name / "row.json") for name in sorted(done(folders.rows))]
    results: dict[str, Any] = {
        "thresholds": frozen.digest(frozen.state()),
        "summary": summary(scored),
        "cases": scored,
    }
    write_json(folders.results, results)
    figures.write(folders.scores, scored)
    published.write(folders.scores / "figures.json", results["summary"])
    console = Console(width=WIDTH)
    console.print(*tables(results))
    console.print(*notes(), sep="\n", highlight=False)
    print(f"written: {folders.results}, and figures beside it")
    return 0


if __name__ == "__main__":
    sys.exit(main())
