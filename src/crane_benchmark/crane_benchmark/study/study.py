"""make study: the report's experiment, from the design of 20 + 2 trajectories to its figures.

Trajectories are designed as a campaign, recorded with the simulated crane, identified by the fit
to all periods and by the recursion, and validated on two recordings of trajectories that were
designed apart. Then hydraulics are identified behind a bus, and every controller follows by them.
Everything but the machine behind the bus is done by the executables that a user would call; results
are left in runs/study, and what is there already is not designed or recorded again.
"""

import json
import os
import resource
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

from crane_benchmark.measured import RESULT_COLUMNS, tell
from crane_benchmark.study import figures
from crane_benchmark.study.figures import Took, following_rows
from crane_benchmark.study.following import FOLLOWING_STEPS, follow
from crane_benchmark.study.recordings import Campaign, StudyError, StudyPlan, design, record, run
from crane_model.cli import command_line
from crane_model.configuration import packaged
from crane_model.machine_files import machine_file

EMPS = packaged("crane_benchmark", "emps/model.yaml").parent  # model and column map
STUDY_SEEDS = {"training": 1, "validation": 101}


@contextmanager
def phase(console: Console, took: list[Took], name: str, total: int = 1) -> Iterator[Progress]:
    """Show a phase while it runs, and what it took: wall and CPU time, of its processes too."""
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
    )
    start, cpu = time.monotonic(), _cpu()
    with Progress(*columns, console=console, transient=True) as progress:
        progress.add_task(name, total=total)
        yield progress
    took.append(Took(name, time.monotonic() - start, _cpu() - cpu))
    console.print(f"{name}: {took[-1].wall:.0f} s, CPU {took[-1].cpu:.0f} s", highlight=False)


def _cpu() -> float:
    used = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(usage.ru_utime + usage.ru_stime for usage in used)


def study(
    out: Path, experiment: StudyPlan, training_count: int, validation_count: int, console: Console
) -> None:
    """Run the whole study in the folder `out`; `StudyError` if an executable fails."""
    fresh, took = not out.exists(), list[Took]()
    training = Campaign("training", training_count, STUDY_SEEDS["training"], out)
    validation = Campaign("validation", validation_count, STUDY_SEEDS["validation"], out)
    with phase(console, took, "trajectories designed", 2) as progress:
        for campaign in (training, validation):
            design(campaign, experiment)
            progress.advance(progress.task_ids[0])
    for campaign in (training, validation):
        merits = [trajectory.figures_of_merit for trajectory in campaign.designed]
        conditions = ", ".join(f"{merit['condition_number']:.0f}" for merit in merits)
        console.print(f"  cond Φ of each, {campaign.name}: {conditions}", highlight=False)
    with phase(console, took, "bags recorded", training.count + validation.count) as progress:
        record((training, validation), experiment, lambda: progress.advance(progress.task_ids[0]))
    reference = out / "true_values.json"
    reference.write_text(run("crane_sim", "true_values", "--json"), encoding="utf-8")
    with phase(console, took, "identified and validated"):
        run(
            *("crane_identification", "identify", "--recursive", "--replace", "--out", out),
            *("--model", machine_file("model.yaml")),
            *("--train", *training.bags, "--validate", *validation.bags),
            *("--reference-values", reference),
        )
    summary = json.loads((out / "summary.json").read_text(encoding="utf-8"))
    true = json.loads(reference.read_text(encoding="utf-8"))
    with phase(console, took, "hydraulics and controllers", FOLLOWING_STEPS) as progress:
        followed = follow(
            out / "following",
            true,
            experiment.periods,
            lambda: progress.advance(progress.task_ids[0]),
        )
    found = [
        *figures.rows(summary, true, training.designed, took if fresh else ()),
        *following_rows(followed),
    ]
    tell(found, RESULT_COLUMNS, figures.STUDY_COMMAND, out / "figures.json", ())
    for folder in (out, out / "following" / "identified"):
        console.print(f"Report: {folder}/report.html   Model: {folder}/model.yaml", highlight=False)
    emps(out / "emps", console)


def emps(out: Path, console: Console) -> None:
    """The same identification of a real axis, where its recording is there."""
    folder = Path(os.environ.get("CRANE_REAL_DATA", "../shared/data"))
    data = folder / "emps" / "DATA_EMPS.mat"
    if not data.is_file():
        console.print(f"EMPS: {data} is not there; set CRANE_REAL_DATA to the folder of emps/")
        return
    run(
        *("crane_identification", "identify", "--no-average", "--replace", "--out", out),
        *("--train", data),
        *("--model", EMPS / "model.yaml", "--columns", EMPS / "columns.yaml"),
    )
    console.print(f"EMPS, a real axis: {out}/report.html", highlight=False)


def main(argv: Sequence[str] | None = None) -> int:
    """Run the study; exit status 1 if one of its executables fails."""
    parser = command_line(
        prog="study", description="Repeat the experiment of the paper on the simulated crane."
    )
    add = parser.add_argument
    add("--out", type=Path, default=Path("runs/study"), help="folder for the results")
    add("--training", type=int, default=20, help="number of training trajectories")
    add("--validation", type=int, default=2, help="number of validation trajectories")
    add("--period", type=float, default=66.0, help="period of each trajectory [s]")
    add("--harmonics", type=int, default=5, help="number of harmonics")
    add("--periods", type=int, default=3, help="number of recorded periods of each trajectory")
    add("--starts", type=int, default=2, help="number of random starts for each trajectory")
    arguments = parser.parse_args(argv)
    try:
        study(
            arguments.out,
            StudyPlan(arguments.period, arguments.harmonics, arguments.starts, arguments.periods),
            arguments.training,
            arguments.validation,
            Console(),
        )
    except StudyError as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
