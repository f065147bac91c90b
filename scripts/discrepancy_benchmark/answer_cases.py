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
from typing import Any

import baselines
from confinement import confine
from folders import Folders, done, new, write_json
from work import in_processes

from crane_identification.data.bag_log import read_bag
from crane_identification.discrepancy.diagnosis import Diagnosis, diagnose
from crane_identification.discrepancy.findings import content
from crane_identification.discrepancy.thresholds import Thresholds, load_thresholds
from crane_identification.options import Options
from crane_model.errors import CraneError
from crane_model.model_file import load_model, save_model

KNOWING = ("crane_sim", "cases", "make_cases", "motions", "clean", "truth", "score_cases")


@dataclass(frozen=True)
class Job:
    """A case, the folders of its set, and the thresholds of the diagnosis."""

    name: str
    folders: Folders
    thresholds: Thresholds
    keep: bool


def blindfold(folders: Folders) -> None:
    """See bags and answers of the set alone, and none of the code that knows what is hidden."""
    own = [folders.bags, folders.answers, folders.scores / "unfinished" / folders.answers.name]
    confine(folders.top, own, KNOWING)


def answer_case(job: Job) -> None:
    """The diagnosis of one case, the answers of the other methods, and the time it took."""
    folder = job.folders.bags / job.name
    with new(job.folders.answers / job.name) as out:
        start = time.process_time()
        answer: dict[str, Any]
        try:
            diagnosis = _diagnosed(folder, job.thresholds)
        except CraneError as error:  # recordings are refused: that is an answer
            answer = {"verdict": "insufficient_data", "reason": str(error), "findings": []}
            others: dict[str, baselines.Answer] = {}
        except Exception:  # the other cases go on; this one counts as wrong
            answer = {"verdict": "crash", "reason": traceback.format_exc(), "findings": []}
            others = {}
        else:
            answer = content(diagnosis) | {"statistics": statistics(diagnosis)}
            save_model(out / "model.yaml", diagnosis.after)
            answer["seconds"] = time.process_time() - start
            others = baselines.answers(diagnosis.search)
        write_json(out / "answer.json", answer)
        write_json(out / "baselines.json", others)
    if not job.keep:
        shutil.rmtree(folder)


def _diagnosed(folder: Path, thresholds: Thresholds) -> Diagnosis:
    model = load_model(folder / "model.yaml")
    train, validate = (
        [read_bag(bag, model.joints) for bag in sorted((folder / part).iterdir())]
        for part in ("train", "validate")
    )
    return diagnose(model, train, validate, Options(), thresholds)


def statistics(diagnosis: Diagnosis) -> dict[str, float]:
    """What thresholds are compared with: the best score in units of its bootstrap quantile, whether
    it is a finding or not; the same of findings alone; how strong a law the learner finds; and the
    number of findings in the flow.
    """
    thresholds, learnt = diagnosis.thresholds, diagnosis.learnt_before
    quantile = diagnosis.threshold / thresholds.score_factor
    best = diagnosis.search.best(1)
    accepted = max((finding.accepted.score for finding in diagnosis.findings), default=0.0)
    sure = learnt.p_value < thresholds.false_alarm_rate / 2.0 / len(learnt.p_value)
    return {
        "score": best.gain / quantile if best is not None else 0.0,
        "accepted": accepted / quantile,
        "learner": float(learnt.strength[sure].max(initial=0.0)),
        "flow": float(sum(len(flow.missing) for flow in diagnosis.flows)),
    }


def main(argv: Sequence[str] | None = None) -> int:
    """Diagnose every case whose bags are there."""
    parser = argparse.ArgumentParser(prog="answer_cases", description=main.__doc__)
    add = parser.add_argument
    add("--folder", type=Path, required=True, help="of the set")
    add("--round", default="", help="folder of the answers in it (default: itself)")
    add("--thresholds", type=Path, help="thresholds (YAML; default: the packaged ones)")
    add("--workers", type=int, default=1)
    add("--keep-bags", action="store_true", help="keep the bags of cases that are answered")
    arguments = parser.parse_args(argv)
    folders = Folders(arguments.folder, arguments.round)
    waiting = sorted(done(folders.bags) - done(folders.answers))
    thresholds = load_thresholds(arguments.thresholds)  # lies where the processes may not look
    jobs = [Job(name, folders, thresholds, arguments.keep_bags) for name in waiting]
    if jobs:
        in_processes(answer_case, jobs, arguments.workers, "answers", partial(blindfold, folders))
    return 0


if __name__ == "__main__":
    sys.exit(main())
