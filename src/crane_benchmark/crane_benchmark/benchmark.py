"""make discrepancy-benchmark: does `diagnose` find what is hidden in the stand-in machine?

One process makes bags of machines that hide effects, a second one answers from the bags alone, a
third opens the labels and scores. What is finished is kept, so that an interrupted run goes on
where it was; code should not change in between. Bags do not depend on thresholds: they may be made
ahead, and serve for the next thresholds too if they are kept.
"""

import argparse
import os
import sys
from collections.abc import Iterable, Sequence
from pathlib import Path

from crane_benchmark.batch import Answering, Batch, run_batch, stage
from crane_benchmark.cases.case import Site
from crane_benchmark.cases.case_sets import CaseSet, cases
from crane_benchmark.folders import Folders, done
from crane_benchmark.scores import freeze, frozen
from crane_model import cli

COUNTS = {
    CaseSet.TUNING: 40,
    CaseSet.CALIBRATION: 40,
    CaseSet.SCORING: 400,
    CaseSet.FORMER: 96,
    CaseSet.STRANGERS: 12,
    CaseSet.AWAY_TUNING: 60,
    CaseSet.AWAY_CLEAN: 40,
}
CLEAN = (CaseSet.CALIBRATION, CaseSet.AWAY_CLEAN)
BATCH = 8  # cases whose bags are on the disk at once, 1 GB


def run(arguments: argparse.Namespace) -> None:
    """All stages, batch by batch; raises `CraneError` with what is wrong."""
    which: CaseSet = arguments.which
    top: Path = arguments.out.resolve() / which.value
    if arguments.bags_only:
        through(batches(arguments, Folders(top), ()), arguments.cluster)
        return
    calibrating = which in CLEAN and (which is CaseSet.CALIBRATION or arguments.gates is not None)
    calibrating |= arguments.freeze
    folders = Folders(top, name_of_round(arguments))
    if which is CaseSet.SCORING and len(done(folders.rows)) >= arguments.cases:
        print(f"scored already with these thresholds, which is done once: {folders.results}")
        score(folders, arguments.workers)
        return
    folders.scores.mkdir(parents=True, exist_ok=True)
    answers: tuple[Answering, ...]
    if calibrating:
        answers = (Answering(freeze.write_open(top)),)
    elif which is CaseSet.SCORING and not arguments.thresholds:
        answers = crossed(arguments, top)
    else:
        answers = (Answering(arguments.thresholds),)
    through(batches(arguments, folders, answers), arguments.cluster)
    if calibrating:
        found = freeze.freeze(folders, which) if arguments.freeze else freeze.calibrated(folders)
        if arguments.gates:
            freeze.write_gates(arguments.gates, found)
        print("\n".join(freeze.lines(found)))
        return
    score(folders, arguments.workers)


def name_of_round(arguments: argparse.Namespace) -> str:
    """Answers with other thresholds than those of the package lie apart; of the scoring set, those
    of each freeze. `ConfigurationError` if that is not what was frozen.
    """
    if arguments.which is CaseSet.AWAY_CLEAN and (arguments.gates or arguments.freeze):
        return "open"
    if arguments.thresholds:
        return str(arguments.thresholds.stem)
    return frozen.require_frozen()[:12] if arguments.which is CaseSet.SCORING else ""


def crossed(arguments: argparse.Namespace, top: Path) -> tuple[Answering, ...]:
    """Cases away by the gates that were calibrated at home, and cases at home by those from away.

    `ConfigurationError` where cases at home are asked for and no gates were calibrated away.
    """
    every = cases(CaseSet.SCORING, arguments.cases)
    own = {site: tuple(case.name for case in every if case.site is site) for site in Site}
    answers = []
    if arguments.site in (None, Site.AWAY):
        answers.append(Answering(None, own[Site.AWAY]))
    if arguments.site in (None, Site.HOME):
        top.mkdir(parents=True, exist_ok=True)
        answers.append(Answering(freeze.write_away(top), own[Site.HOME]))
    return tuple(answers)


def batches(
    arguments: argparse.Namespace, folders: Folders, answers: tuple[Answering, ...]
) -> list[Batch]:
    """The cases of a set, a few at a time."""
    return [
        Batch(
            which=arguments.which,
            count=arguments.cases,
            first=first,
            last=min(first + BATCH, arguments.cases),
            site=arguments.site,
            sets=arguments.sets,
            quick=arguments.quick,
            folders=folders,
            workers=1 if arguments.cluster else arguments.workers,
            keep=arguments.keep_bags,
            answers=answers,
        )
        for first in range(0, arguments.cases, BATCH)
    ]


def through(waiting: Sequence[Batch], cluster: str | None) -> None:
    """One after the other, or each by a worker of a Dask cluster that sees the same folders; ends
    with the status of one that fails.
    """
    if cluster:
        # only here: Dask is an extra
        from distributed import as_completed

        from crane_identification.scale.cluster import connected

        with connected(cluster) as client:
            futures = client.map(run_batch, waiting, pure=False)
            _follow(waiting, (one.result() for one in as_completed(futures, loop=client.loop)))
        return
    _follow(waiting, map(run_batch, waiting))


def _follow(waiting: Sequence[Batch], statuses: Iterable[int]) -> None:
    for status in statuses:
        if status:
            raise SystemExit(status)
        one = waiting[0]
        if one.answers:
            print(f"{len(done(one.folders.answers))} of {one.count} cases answered", flush=True)


def score(folders: Folders, workers: int) -> None:
    """Score what is answered, and print it."""
    if status := stage("score_cases", folders, workers):
        raise SystemExit(status)


def main(argv: Sequence[str] | None = None) -> int:
    """Run the benchmark; exit status 1 if thresholds are not frozen or a stage fails."""
    parser = cli.command_line(prog="discrepancy", description=__doc__.splitlines()[0])
    add = parser.add_argument
    add("--set", type=CaseSet, choices=list(CaseSet), default=CaseSet.SCORING, dest="which")
    add("--site", type=Site, choices=list(Site), help="only cases of machines from there")
    add("--cases", type=int, help=", ".join(f"{n} ({s.value})" for s, n in COUNTS.items()))
    add("--sets", type=int, default=2, help="of three recordings to train on, in each case")
    add("--quick", action="store_true", help="one short recording each: to try the machinery")
    add("--workers", type=int, default=os.cpu_count() or 1, help="processes")
    add("--out", type=Path, default=Path("runs/discrepancy_benchmark"), help="folder")
    add("--keep-bags", action="store_true", help="100 MB a case; to answer again")
    add("--bags-only", action="store_true", help="make the bags of all cases, and stop")
    add(
        "--cluster", metavar="ADDRESS", help="of a Dask scheduler whose workers see the same folder"
    )
    add("--freeze", action="store_true", help="write the calibrated thresholds to the package")
    add("--gates", type=Path, help="file for thresholds that these clean cases calibrate")
    add("--thresholds", type=Path, help="answer with these (YAML; default: the packaged ones)")
    arguments = parser.parse_args(argv)
    if arguments.freeze and arguments.which not in CLEAN:
        parser.error(f"--freeze: calibrate with --set {' or '.join(CLEAN)}")
    if arguments.gates and arguments.which not in CLEAN:
        parser.error(f"--gates: calibrate with cases that hide nothing, --set {' or '.join(CLEAN)}")
    if arguments.cases is None:
        arguments.cases = COUNTS[arguments.which]
    return cli.run(lambda: run(arguments))


if __name__ == "__main__":
    sys.exit(main())
