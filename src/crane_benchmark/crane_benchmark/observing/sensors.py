"""`sensors`: what the sensor monitor is to find, and what it finds, on machines at work."""

import math
import tempfile
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np

from crane_benchmark.measured import MeasuredRow
from crane_benchmark.observing.beside_aims import tell
from crane_benchmark.observing.failing import (
    AIMS,
    BATCH,
    HOUR,
    LEARNT_FROM,
    OTHERS,
    FailingCase,
    MonitorAnswer,
    WatchedMachine,
    answered,
    drawn,
    smallest,
    with_fault,
    without_fault,
)
from crane_benchmark.observing.machines import HeardWork, KeptRecordings, Observed
from crane_benchmark.observing.observer import MACHINES, identified
from crane_benchmark.observing.picture import draw_curves
from crane_model import cli
from crane_model.cli import between, whole
from crane_model.model_file import Model, load_model, save_model
from crane_model.progress_bar import progress_bar
from crane_observer.monitor.finding import SensorFinding
from crane_observer.monitor.replay import compare
from crane_observer.monitor.signatures import Part, Wrong
from crane_observer.monitor.tolerance import learn
from crane_observer.recording import HeardRecording

ALARMS = 0.1  # an hour, at most
RIGHT = 0.9  # of what is found, at least
LYING_STOPS = 0.99  # of the encoders that are found to lie, at least
COLUMNS = ("what", "aim", "cases", "reached", "smallest", "median delay [s]")
LEARNING, WITHOUT, WITH = 10_000, 20_000, 30_000  # seeds, beside that of the command


class BenchmarkWork(NamedTuple):
    """All recordings of a run, each made when it is asked for, unless it is kept."""

    observed: Observed
    model: Model
    train: Path
    kept: KeptRecordings
    seed: int

    @classmethod
    def of(cls, name: str, seed: int, folder: Path) -> "BenchmarkWork":
        """The machine, identified from a bag."""
        make_it, _, _ = MACHINES[name]
        observed, kept = make_it(), KeptRecordings(folder / f"{name}_{seed}")
        model_file, train = kept.folder / "model.yaml", kept.folder / "train"
        if not model_file.exists():
            with tempfile.TemporaryDirectory(dir=kept.folder) as made:
                model = identified(observed, seed, Path(made))
                (Path(made) / "train").rename(train)
            save_model(model_file, model)
        return cls(observed, load_model(model_file), train, kept, seed)

    def without(self, k: int, learning: bool = False) -> HeardWork:
        """Work without fault, the k-th."""
        seed = self.seed + (LEARNING if learning else WITHOUT) + k
        made = partial(without_fault, self.observed, self.model, seed)
        return self.kept.recording(f"{'learning' if learning else 'without'}_{k:03d}", made)

    def failing(self, case: FailingCase) -> HeardWork:
        """That of a case."""
        made = partial(with_fault, self.observed, self.model, case)
        return self.kept.recording(f"fault_{case.seed}_{case.fault}", made)

    def watched(self) -> WatchedMachine:
        """By tolerances that are learnt from the bag, and from work."""
        batches = range(round(LEARNT_FROM / BATCH))
        heard = [HeardRecording.read(self.train, self.model.joints)]
        heard += [self.without(k, learning=True).heard for k in batches]
        sums = [compare(one, self.model, None).sums for one in heard]
        tolerance = learn(self.model.joints, sums, "the bag of the model, and work")
        return WatchedMachine(self.observed, self.model, tolerance)


def rows_of(
    name: str,
    seconds: float,
    found: int,
    answers: Sequence[MonitorAnswer],
) -> list[MeasuredRow]:
    """Every aim of the monitor, and what else it finds; `found` in `seconds` without fault, to
    which what comes before a fault is added.
    """
    hours = (seconds + sum(one.before for one in answers)) / HOUR
    alarms = found + sum(one.alarms for one in answers)
    told = [one for one in answers if one.first is not None]
    right = sum(one.right for one in told) / max(len(told), 1)
    rows = [
        MeasuredRow(
            cells=[f"{name}: false alarms an hour", f"{ALARMS:g}", "{hours:.1f} h", "{rate:.2f}"]
            + ["", ""],
            values={"hours": hours, "rate": alarms / hours, "excess": alarms / hours - ALARMS},
        ),
        MeasuredRow(
            cells=[f"{name}: right sensor, of what is found", f"{RIGHT:.0%}", "{told:.0f}"]
            + ["{right:.1%}", "", ""],
            values={"told": len(told), "right": right, "excess": RIGHT - right},
        ),
    ]
    encoders = [one.first for one in told if one.case.part is Part.ENCODER]
    others = [one.first for one in told if one.case.part is not Part.ENCODER]
    rows += [
        _stopped(f"{name}: encoders that lie, the crane stops", LYING_STOPS, encoders),
        _stopped(f"{name}: another is at fault, the crane stops", None, others),
    ]
    return rows + [
        _row(name, [one for one in answers if one.case.question == question])
        for question in (*AIMS, *OTHERS)
    ]


def _stopped(what: str, aim: float | None, found: Sequence[SensorFinding | None]) -> MeasuredRow:
    """How many findings the driver heeds; noise of an encoder is none of them."""
    asked = [one for one in found if one and (one.part, one.kind) != (Part.ENCODER, Wrong.NOISE)]
    share = sum(one.dangerous for one in asked) / max(len(asked), 1)
    values = {"cases": float(len(asked)), "share": share, "excess": (aim or 0.0) - share}
    cells = [what, f"{aim:.0%}" if aim else "", "{cases:.0f}", "{share:.1%}", "", ""]
    return MeasuredRow(cells=cells, values=values)


def _row(name: str, answers: Sequence[MonitorAnswer]) -> MeasuredRow:
    question = answers[0].case.question
    delays = np.array([one.delay for one in answers])
    share = float(np.mean(delays <= question.within))
    least = smallest(answers, question)
    ranged = question.sizes[0] < question.sizes[1]
    values = {"cases": float(len(answers)), "share": share, "excess": question.aim - share}
    seen = delays[np.isfinite(delays)]
    if len(seen):
        values["delay"] = float(np.median(seen))
    if ranged and np.isfinite(least):
        values["least"] = least
    return MeasuredRow(
        cells=[
            f"{name}: {question.what}, within {question.within:g} s",
            f"{question.aim:.0%}" if question.aim else "",
            "{cases:.0f}",
            "{share:.1%}",
            ("{least:.2g}" if "least" in values else "none") if ranged else "",
            "{delay:.2f}" if "delay" in values else "",
        ],
        values=values,
    )


def missed(rows: Sequence[MeasuredRow]) -> list[str]:
    """Aims that are not reached, in words."""
    return [
        f"{row.shown[0]}: {row.shown[3]}, aim {row.cells[1]}"
        for row in rows
        if row.cells[1] and row.values["excess"] > 0.0
    ]


def main(argv: Sequence[str] | None = None) -> int:
    """Measure the sensor monitor on a machine at work: blind cases of faults that begin at a
    moment, and hours without fault, beside its aims.

    The exit status is 1 where an aim is missed.
    """
    parser = cli.command_line(description=main.__doc__)
    add = parser.add_argument
    add("--on", choices=list(MACHINES), default="stock", help="machine (default: stock)")
    add("--cases", type=whole(1), default=300, help="about so many with a fault (default: 300)")
    add("--hours", type=between(0.1, 1000.0), default=20.0, help="without fault (default: 20)")
    add("--seed", type=whole(0), default=1, help="of motion, loads, faults and noise")
    add("--out", type=Path, help="file for the figures (JSON)")
    add(
        "--kept",
        type=Path,
        default=Path("runs/observer/sensors"),
        help="folder in which recordings are kept, so that an interrupted run goes on (default: "
        "%(default)s)",
    )
    add("--picture", type=Path, help="picture of what is found by size, and when, for each kind")
    arguments = parser.parse_args(argv)

    def body() -> None:
        if arguments.picture:
            cli.check_out(arguments.picture, replace=True)
        name, seed = arguments.on, arguments.seed
        work = BenchmarkWork.of(name, seed, arguments.kept)
        cases = drawn(work.observed, arguments.cases, seed + WITH)
        batches = range(math.ceil(arguments.hours * HOUR / BATCH))
        with progress_bar("recordings", len(cases) + len(batches)) as bar:  # before the first is
            for case in cases:  # watched, so that what goes on does not watch the same again
                work.failing(case)
                bar.update()
            for k in batches:
                work.without(k)
                bar.update()
        watched = work.watched()
        with progress_bar("faults", len(cases)) as bar:
            answers = []
            for case in cases:
                answers.append(answered(watched, case, work.failing(case)))
                bar.update()
        seconds, found = 0.0, []
        with progress_bar("without fault", len(batches)) as bar:
            for k in batches:
                healthy = work.without(k)
                seconds += healthy.seconds
                found += watched.findings(healthy)
                bar.update()
        for answer in answers:
            if not answer.right:
                print(f"{answer.case.fault}: {answer.first or 'not found'}")
        for finding in found:
            print(f"false alarm: {finding}")
        rows = rows_of(name, seconds, len(found), answers)
        if arguments.picture:
            draw_curves(arguments.picture, answers)
        command = (
            f"ros2 run crane_benchmark sensors --on {arguments.on} --cases {arguments.cases} "
            f"--hours {arguments.hours:g} --seed {arguments.seed}"
        )
        tell(rows, COLUMNS, command, arguments.out, missed(rows))

    return cli.run(body)
