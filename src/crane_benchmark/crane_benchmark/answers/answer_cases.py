"""Second process of the benchmark: answers from bags alone. It cannot see what is hidden."""

import argparse
import shutil
import sys
import time
import traceback
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from crane_benchmark.answers import baselines
from crane_benchmark.answers.confinement import confine
from crane_benchmark.folders import ANSWER, Folders, done, new
from crane_benchmark.work import in_processes
from crane_identification.data.bag_log import read_bag
from crane_identification.data.log import Log
from crane_identification.diagnosis.answer.verdict import Verdict
from crane_identification.diagnosis.decision.chance import null_gains
from crane_identification.diagnosis.diagnosis import Diagnosis, diagnose
from crane_identification.diagnosis.findings import answer
from crane_identification.diagnosis.findings_file import Findings
from crane_identification.diagnosis.search.energy import strength
from crane_identification.options import Options
from crane_identification.thresholds import Thresholds, load_thresholds
from crane_model.errors import CraneError
from crane_model.model_file import Model, load_model, save_model
from crane_model.result_file import Number, ResultFile, ResultPart

# answer.json: what was said of a case, by those who had its bags alone.

CRASH = "crash"


class AnswerStatistics(ResultPart):
    """What thresholds are compared with. Scores are in units of the bootstrap quantile that is the
    threshold.
    """

    best: float
    """Score of the best effect, whether it is a finding or not [-]."""
    score: float
    """The same of those that are as strong as is asked for [-]."""
    accepted: float
    """The same of findings [-]."""
    learner: float
    """Strength of a law that the flexible learner is sure of [-]."""
    strength: float
    """Of that or the best [-]."""
    floor: float
    """Largest error over the scatter between periods [-]; 0 where none was repeated."""
    sample_noise: float
    """The same over what the scatter of samples and surveyed lengths account for [-]."""
    pulsation: float
    """Clearness of the clearest line [-]; 0 where none was asked for."""
    flow: float
    """Share of it that the strongest effect makes up [-]."""
    flow_left: float
    """Share of it that none explains [-]."""
    promised: list[float]
    """0 to 100 % quantiles of the best score by the bootstrap [-]."""


class CaseAnswer(ResultFile):
    """What was said of a case."""

    verdict: str
    """That of the findings, `insufficient_data` of recordings that are refused, or `crash`."""
    reason: str
    """Why, in a sentence; of a crash, where."""
    findings: Findings | None = None
    """Null of recordings that are refused, and of a crash."""
    statistics: AnswerStatistics | None = None
    """Null where there are no findings."""
    seconds: Number = None
    """CPU time of the diagnosis [s]."""
    others: dict[str, list[tuple[str, str]]] = {}
    """By method beside the diagnosis: the effects that it names, and their joints."""


# What an answering process is given of a case: the model, and recordings of the machine.


def given(folder: Path) -> tuple[Model, list[Log], list[Log]]:
    """The model to diagnose, the bags to train on and those to validate on, by their names.

    `CraneError` where one of them cannot be read.
    """
    model = load_model(folder / "model.yaml")
    train, validate = (
        [read_bag(bag, model.joints) for bag in sorted((folder / part).iterdir())]
        for part in ("train", "validate")
    )
    return model, train, validate


LEVELS = np.linspace(0.0, 1.0, 101)  # of the quantiles of the bootstrap
DIGITS = 4
KNOWING = ("crane_sim", *(f"crane_benchmark.{one}" for one in ("away", "cases", "scores")))


@dataclass(frozen=True)
class AnsweringJob:
    """A case, the folders of its set, and the thresholds."""

    name: str
    folders: Folders
    thresholds: Thresholds
    keep: bool


def blindfold(folders: Folders) -> None:
    """See bags and answers of the set alone, and none of the code that knows what is hidden."""
    own = [folders.bags, folders.answers, folders.scores / "unfinished" / folders.answers.name]
    confine(folders.top, own, KNOWING)


def refused(error: CraneError) -> CaseAnswer:
    """What is said of recordings that a diagnosis does not take."""
    return CaseAnswer(verdict=Verdict.INSUFFICIENT, reason=str(error))


def answered(folder: Path, thresholds: Thresholds, out: Path) -> CaseAnswer:
    """The diagnosis of one case, its model written to `out`."""
    start = time.process_time()
    diagnosis = diagnose(*given(folder), Options(), thresholds)
    found = answer(diagnosis)
    said = CaseAnswer(
        verdict=found.verdict,
        reason=found.reason,
        findings=found,
        statistics=statistics(diagnosis),
        seconds=time.process_time() - start,
        others=baselines.answers(diagnosis.search),
    )
    save_model(out / "model.yaml", diagnosis.after)
    return said


def answer_case(job: AnsweringJob) -> None:
    """The diagnosis of one case, the answers of the other methods, and the time it took."""
    folder = job.folders.bags / job.name
    with new(job.folders.answers / job.name) as out:
        try:
            said = answered(folder, job.thresholds, out)
        except CraneError as error:  # recordings are refused: that is an answer
            said = refused(error)
        except Exception:  # the other cases go on; this one counts as wrong
            said = CaseAnswer(verdict=CRASH, reason=traceback.format_exc())
        said.write(out / ANSWER)
    if not job.keep:
        shutil.rmtree(folder)


def statistics(diagnosis: Diagnosis) -> AnswerStatistics:
    """What thresholds are compared with."""
    thresholds, learnt, gap = diagnosis.thresholds, diagnosis.proof.before.learnt, diagnosis.gap
    quantities = [one for flow in diagnosis.flow.found for one in flow.quantities]
    null = null_gains(diagnosis.search.projection, [])
    quantile = diagnosis.decision.threshold / thresholds.gates.score_factor
    single = [
        (subset.gain / quantile, strength(diagnosis.search, subset.numbers[0], subset.gain))
        for subset in diagnosis.search.sets[1]
    ]
    strong = [score for score, one in single if one >= thresholds.gates.smallest_strength]
    accepted = max((finding.judged.score for finding in diagnosis.findings), default=0.0)
    sure = learnt.p_value < thresholds.method.false_alarm_rate / 2.0 / len(learnt.p_value)
    law = float(learnt.strength[sure].max(initial=0.0))
    return AnswerStatistics(
        best=single[0][0] if single else 0.0,
        score=max(strong, default=0.0),
        accepted=accepted / quantile,
        learner=law,
        strength=max([law, *(one for _, one in single[:1])]),
        floor=float(np.nan_to_num(gap.over_floor(gap.largest_before)).max()),
        sample_noise=float(gap.over_samples(gap.largest_before).max()),
        pulsation=max((line.clearness for line in diagnosis.proof.lines), default=0.0),
        flow=max((one.share for one in quantities if one.missing), default=0.0),
        flow_left=max((flow.unexplained for flow in diagnosis.flow.found), default=0.0),
        promised=np.round(np.quantile(null, LEVELS) / quantile, DIGITS).tolist(),
    )


def main(argv: Sequence[str] | None = None) -> int:
    """Diagnose every case whose bags are there."""
    parser = argparse.ArgumentParser(prog="answer_cases", description=main.__doc__)
    add = parser.add_argument
    add("--folder", type=Path, required=True, help="of the set")
    add("--round", default="", help="folder of the answers in it (default: itself)")
    add("--thresholds", type=Path, help="thresholds (YAML; default: the packaged ones)")
    add("--workers", type=int, default=1)
    add("--keep-bags", action="store_true", help="keep the bags of cases that are answered")
    add("--only", nargs="*", metavar="CASE", help="these cases (default: all)")
    arguments = parser.parse_args(argv)
    folders = Folders(arguments.folder, arguments.round)
    there = done(folders.bags) if arguments.only is None else {*arguments.only} & done(folders.bags)
    waiting = sorted(there - done(folders.answers))
    thresholds = load_thresholds(arguments.thresholds)
    jobs = [AnsweringJob(name, folders, thresholds, arguments.keep_bags) for name in waiting]
    if jobs:
        in_processes(answer_case, jobs, arguments.workers, "answers", partial(blindfold, folders))
    return 0


if __name__ == "__main__":
    sys.exit(main())
