"""Second process of the benchmark: answers from bags alone. It cannot see what is hidden."""

import argparse
import os
import shutil
import sys
import time
import traceback
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from crane_benchmark.folders import ANSWER, Folders, done, in_processes, new
from crane_identification.data.log import Log
from crane_identification.data.recording_log import read_bag
from crane_identification.diagnosis.answer import Verdict
from crane_identification.diagnosis.diagnosis import Diagnosis, diagnose
from crane_identification.diagnosis.findings import Findings
from crane_identification.diagnosis.gap import OF_PERIODS, OF_SAMPLES
from crane_identification.diagnosis.judgement import null_gains
from crane_identification.diagnosis.search import Search
from crane_identification.options import Options
from crane_identification.thresholds import Thresholds, load_thresholds
from crane_model.errors import CraneError
from crane_model.model_file import Model, load_model, save_model
from crane_model.result_file import Number, ResultFile, ResultPart

READING = ("open", "os.listdir", "os.scandir")
MOST = 8  # effects in an answer
SPARSITIES = 12  # thresholds that are tried
LEAST_SIGMAS = 2.0  # of them, in standard deviations of a coefficient
FACTOR = "pressure_gain"  # of all joints together, its columns are the masses of the model
SINGULAR = 1e-3  # share of a column's norm beside the chosen ones, below which it is one of them
CRASH = "crash"
LEVELS = np.linspace(0.0, 1.0, 101)  # of the quantiles of the bootstrap
QUANTILE_DIGITS = 4


class PeekError(Exception):
    """The answering process tried to look at what is sealed."""


def confine(root: Path, allowed: Sequence[Path], modules: Sequence[str]) -> None:
    """From now on nothing under `root` is opened or listed but what is in `allowed`, and none of
    the `modules`, or of what is in them, is imported, on pain of `PeekError`. There is no way back.
    """
    fence = _plain(root)
    inside = tuple(_plain(path) for path in allowed)

    def knows(name: str) -> bool:
        return any(name == module or name.startswith(f"{module}.") for module in modules)

    if known := sorted(filter(knows, sys.modules)):
        raise PeekError(f"imported already: {', '.join(known)}; confine the process before")

    def within(path: str, folder: str) -> bool:
        return path == folder or path.startswith(folder + os.sep)

    def watch(event: str, arguments: tuple) -> None:
        if event == "import" and knows(str(arguments[0])):
            raise PeekError(f"import of {arguments[0]}")
        if event in READING and isinstance(arguments[0], str | bytes | os.PathLike):
            path = _plain(arguments[0])
            if within(path, fence) and not any(within(path, folder) for folder in inside):
                raise PeekError(f"{event} of {path}")

    sys.addaudithook(watch)


def _plain(path: str | bytes | os.PathLike) -> str:
    """Absolute, without links: what an open would reach."""
    return os.path.realpath(os.fsdecode(path))


# Answers of other methods from the same residual and the same columns, whitened alike.


Names = list[tuple[str, str]]
"""Effects, strongest first, each with its joint or `all`."""


@dataclass(frozen=True)
class Problem:
    """Linear regression: residual (N,), best columns (N, K) of effects, `energy` (j,)."""

    residual: np.ndarray
    columns: np.ndarray
    names: Names
    joints: tuple[str, ...]
    energy: np.ndarray


def problem(search: Search) -> Problem:
    """Every candidate at the shape that alone explains most."""
    projection, joints = search.projection, search.evidence.joints
    best: dict[tuple[str, str], tuple[float, np.ndarray]] = {}
    for shaped, members in zip(projection.candidates, projection.columns_of, strict=True):
        columns = projection.columns[:, members]
        fitted = columns @ np.linalg.lstsq(columns, projection.residual, rcond=1e-9)[0]
        norm = float(np.linalg.norm(fitted))
        name = (shaped.candidate.type, shaped.candidate.where)
        if name[0] != FACTOR and norm > best.get(name, (0.0, fitted))[0]:
            best[name] = (norm, fitted / norm)
    channel = search.whitener.channel % len(joints)
    return Problem(
        projection.residual,
        np.stack([column for _, column in best.values()], axis=1),
        list(best),
        joints,
        np.bincount(channel, projection.residual**2 - 1.0, len(joints)),
    )


def always_stribeck(given: Problem) -> Names:
    """The usual suspect, on the joint with most energy beyond noise."""
    return [("stribeck", given.joints[int(np.argmax(given.energy))])]


def sparse_regression(given: Problem) -> Names:
    """Sequentially thresholded least squares (pysindy), its threshold by BIC."""
    from pysindy import STLSQ

    strongest = float(np.abs(given.columns.T @ given.residual).max())
    best, chosen = _bic(given, []), np.zeros(len(given.names))
    for sparsity in np.geomspace(
        LEAST_SIGMAS, max(0.9 * strongest, 2.0 * LEAST_SIGMAS), SPARSITIES
    ):
        optimizer = STLSQ(threshold=float(sparsity), alpha=0.0)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of thresholds that leave nothing
            optimizer.fit(given.columns, given.residual[:, np.newaxis])
        values = np.asarray(optimizer.coef_)[0]
        score = _bic(given, np.flatnonzero(values).tolist())
        if score < best:
            best, chosen = score, values
    return [given.names[i] for i in np.argsort(-np.abs(chosen)) if chosen[i]]


def forward_regression(given: Problem) -> Names:
    """Forward orthogonal regression: what reduces the error most is added until BIC rises."""
    inside: list[int] = []
    score = _bic(given, inside)
    while len(inside) < min(MOST, len(given.names)):
        basis = np.linalg.qr(given.columns[:, inside])[0]
        rest = given.columns - basis @ (basis.T @ given.columns)
        norms = np.linalg.norm(rest, axis=0)
        usable = norms > SINGULAR
        gains = np.where(usable, (rest.T @ given.residual) / np.where(usable, norms, 1.0), 0.0) ** 2
        larger = [*inside, int(np.argmax(gains))]
        if _bic(given, larger) >= score:
            break
        inside, score = larger, _bic(given, larger)
    return [given.names[i] for i in inside]


def _bic(given: Problem, inside: Sequence[int]) -> float:
    """Bayes' information criterion of a least-squares fit of these columns, without constants."""
    basis = np.linalg.qr(given.columns[:, list(inside)])[0]
    left = given.residual - basis @ (basis.T @ given.residual)
    n = len(left)
    return n * float(np.log(left @ left)) + len(inside) * float(np.log(n))


METHODS: dict[str, Callable[[Problem], Names]] = {
    "always Stribeck": always_stribeck,
    "sparse regression (SINDy)": sparse_regression,
    "forward regression (FROLS)": forward_regression,
}


def baseline_answers(search: Search) -> dict[str, Names]:
    """The answer of every method; where pysindy is not installed, it is left out."""
    given = problem(search)
    out = {}
    for name, method in METHODS.items():
        try:
            out[name] = method(given)
        except ImportError:
            continue
    return out


# answer.json: what was said of a case, by those who had its bags alone.


class AnswerStatistics(ResultPart):
    """Statistics that thresholds limit. Scores are in units of the bootstrap quantile."""

    best: float
    """Score of the best effect, whether it is a finding or not [-]."""
    score: float
    """The same of those that are as strong as is asked for [-]."""
    accepted: float
    """The same of findings [-]."""
    learner: float
    """Strength of a law that the flexible learner is sure of [-]."""
    relative_magnitude: float
    """Relative magnitude of the learnt model form, or of the best effect [-]."""
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
    """Answer to a case."""

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


# Inputs of an answering process: the model, and recordings of the machine.


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


KNOWING = (
    "crane_sim",
    *(f"crane_benchmark.{package}" for package in ("independent", "cases", "scores")),
)


def blindfold(folders: Folders) -> None:
    """See bags and answers of the set alone, and none of the code that knows what is hidden."""
    visible = [folders.bags, folders.answers, folders.scores / "unfinished" / folders.answers.name]
    confine(folders.top, visible, KNOWING)


def refused(error: CraneError) -> CaseAnswer:
    """Answer for recordings that a diagnosis does not take."""
    return CaseAnswer(verdict=Verdict.INSUFFICIENT, reason=str(error))


def answered(folder: Path, thresholds: Thresholds, out: Path) -> CaseAnswer:
    """The diagnosis of one case, its model written to `out`."""
    start = time.process_time()
    diagnosis = diagnose(*given(folder), Options(), thresholds)
    found = diagnosis.results()
    said = CaseAnswer(
        verdict=found.verdict,
        reason=found.reason,
        findings=found,
        statistics=statistics(diagnosis),
        seconds=time.process_time() - start,
        others=baseline_answers(diagnosis.search),
    )
    save_model(out / "model.yaml", diagnosis.after)
    return said


def answer_case(folders: Folders, thresholds: Thresholds, keep: bool, name: str) -> None:
    """The diagnosis of one case, the answers of the other methods, and the time it took."""
    folder = folders.bags / name
    with new(folders.answers / name) as out:
        try:
            said = answered(folder, thresholds, out)
        except CraneError as error:  # recordings are refused: that is an answer
            said = refused(error)
        except Exception:  # the other cases go on; this one counts as wrong
            said = CaseAnswer(verdict=CRASH, reason=traceback.format_exc())
        said.write(out / ANSWER)
    if not keep:
        shutil.rmtree(folder)


def statistics(diagnosis: Diagnosis) -> AnswerStatistics:
    """Statistics of a diagnosis that thresholds limit."""
    thresholds, gap = diagnosis.search.thresholds, diagnosis.gap
    learnt = diagnosis.proof.before.learnt
    quantities = [quantity for flow in diagnosis.flow.found for quantity in flow.quantities]
    null = null_gains(diagnosis.search.projection, [])
    quantile = diagnosis.decision.threshold / thresholds.gates.score_factor
    single = [
        (subset.gain / quantile, diagnosis.search.strength(subset.numbers[0], subset.gain))
        for subset in diagnosis.search.sets[1]
    ]
    strong = [score for score, size in single if size >= thresholds.gates.smallest_strength]
    accepted = max((finding.judged.score for finding in diagnosis.findings), default=0.0)
    sure = learnt.p_value < thresholds.method.false_alarm_rate / 2.0 / len(learnt.p_value)
    law = float(learnt.strength[sure].max(initial=0.0))
    return AnswerStatistics(
        best=single[0][0] if single else 0.0,
        score=max(strong, default=0.0),
        accepted=accepted / quantile,
        learner=law,
        relative_magnitude=max([law, *(size for _, size in single[:1])]),
        floor=float(np.nan_to_num(gap.over(gap.largest_before, OF_PERIODS)).max()),
        sample_noise=float(gap.over(gap.largest_before, OF_SAMPLES).max()),
        pulsation=max((line.clearness for line in diagnosis.proof.lines), default=0.0),
        flow=max((quantity.share for quantity in quantities if quantity.missing), default=0.0),
        flow_left=max((flow.unexplained for flow in diagnosis.flow.found), default=0.0),
        promised=np.round(np.quantile(null, LEVELS) / quantile, QUANTILE_DIGITS).tolist(),
    )


def main(argv: Sequence[str] | None = None) -> int:
    """Diagnose every case whose bags are there."""
    parser = argparse.ArgumentParser(prog="answer_cases", description=main.__doc__)
    add = parser.add_argument
    add("--folder", type=Path, required=True, help="of the set")
    add("--round", default="", help="folder of the answers within the folder (default: itself)")
    add("--thresholds", type=Path, help="thresholds (YAML; default: the packaged ones)")
    add("--workers", type=int, default=1)
    add("--keep-bags", action="store_true", help="keep the bags of cases that are answered")
    add("--only", nargs="*", metavar="CASE", help="these cases (default: all)")
    arguments = parser.parse_args(argv)
    folders = Folders(arguments.folder, arguments.round)
    there = done(folders.bags) if arguments.only is None else {*arguments.only} & done(folders.bags)
    waiting = {name: name for name in sorted(there - done(folders.answers))}
    thresholds = load_thresholds(arguments.thresholds)
    if waiting:
        answer = partial(answer_case, folders, thresholds, arguments.keep_bags)
        in_processes(answer, waiting, arguments.workers, "answers", partial(blindfold, folders))
    return 0


if __name__ == "__main__":
    sys.exit(main())
