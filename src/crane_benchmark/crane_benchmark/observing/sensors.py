"""`sensors`: what the sensor monitor is to find, and what it finds, on machines at work."""

import math
import tempfile
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from scipy.optimize import isotonic_regression

from crane_benchmark.measured import MeasuredRow, tell
from crane_benchmark.observing.failing import (
    FAULT_AIMS,
    FAULTLESS_SECONDS,
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
from crane_model import cli
from crane_model.cli import between, whole
from crane_model.model_file import Model, load_model, save_model
from crane_model.progress_bar import progress_bar
from crane_observer.monitor.finding import Part, SensorFinding, Wrong
from crane_observer.monitor.replay import compare
from crane_observer.monitor.tolerance import learn
from crane_observer.recording import HeardRecording

if TYPE_CHECKING:
    from matplotlib.axes import Axes


UNITS = {
    "jump": "rad, m",
    "drift": "rad/s, m/s",
    "noise": "rad, m",
    "backlash": "rad, m",
    "slow": "s",
    "leaking": "m³/(s Pa)",
}
OF_PRESSURE = {"offset": "Pa", "drift": "Pa/s", "noise": "Pa"}
PANELS_PER_ROW = 4
WITHIN = OTHERS[0].within  # s
SOONEST_DRAWN_S = 0.02  # s that are drawn
MISSED = 1.8 * WITHIN  # s, where what was not found in time is drawn
ALARMS = 0.1  # an hour, at most
RIGHT = 0.9  # of what is found, at least
LYING_STOPS = 0.99  # of the encoders that are found to lie, at least
SENSOR_COLUMNS = ("quantity", "target", "cases", "reached", "smallest", "median delay [s]")
LEARNING, WITHOUT, WITH = 10_000, 20_000, 30_000  # seeds, beside that of the command


def shares(answers: Sequence[MonitorAnswer]) -> tuple[np.ndarray, np.ndarray]:
    """Sizes (n,) in their order, and the share (n,) that is found in time of faults so large: what
    fits the cases best of all that never falls as faults grow.
    """
    if not answers:
        return np.zeros(0), np.zeros(0)
    ordered = sorted(answers, key=lambda answer: abs(answer.case.fault.size))
    size = np.abs([answer.case.fault.size for answer in ordered])
    found = np.array(
        [answer.delay <= answer.case.question.within for answer in ordered], dtype=float
    )
    return size, np.asarray(isotonic_regression(found).x)


def _mark(axis: "Axes", answers: Sequence[MonitorAnswer]) -> None:
    """Cases by what came of them."""
    for label, marker, color, right, in_time in (
        ("found", "o", "tab:blue", True, True),
        ("another sensor named", "x", "tab:red", False, True),
        ("not found in time", "^", "gray", None, False),
    ):
        marked = [
            answer
            for answer in answers
            if (answer.delay <= WITHIN) == in_time and right in (None, answer.right)
        ]
        size = [abs(answer.case.fault.size) for answer in marked]
        delay = [max(answer.delay, SOONEST_DRAWN_S) if in_time else MISSED for answer in marked]
        axis.plot(size, delay, marker, color=color, markersize=4, alpha=0.7, label=label)


def draw_curves(path: Path, answers: Sequence[MonitorAnswer]) -> None:
    """Draw each kind: cases by size and time until found, and the share found in time."""
    from matplotlib.figure import Figure  # a second to import
    from matplotlib.ticker import NullFormatter

    asked = [question for question in OTHERS if question.sizes[0] < question.sizes[1]]
    rows = -(-len(asked) // PANELS_PER_ROW)
    figure = Figure(figsize=(11.0, 2.3 * rows), layout="constrained")
    axes = figure.subplots(rows, PANELS_PER_ROW, sharey=True).ravel()
    for k, (axis, question) in enumerate(zip(axes, asked, strict=False)):
        of_question = [answer for answer in answers if answer.case.question == question]
        _mark(axis, of_question)
        share = axis.twinx()
        size, found = shares(of_question)
        share.step(size, 100.0 * found, where="mid", color="tab:blue", alpha=0.5)
        share.set_ylim(0.0, 108.0)
        share.set_yticks([0, 50, 100])
        share.tick_params(
            labelsize=7, labelcolor="tab:blue", labelright=k % PANELS_PER_ROW == PANELS_PER_ROW - 1
        )
        axis.set_xscale("log")
        axis.set_xlim(*question.sizes)
        axis.xaxis.set_minor_formatter(NullFormatter())
        pressed = question.parts[0].startswith("pressure")
        unit = (OF_PRESSURE if pressed else UNITS).get(question.kind, "share")
        axis.set_title(question.what.replace("_", " "), fontsize=9)
        axis.set_xlabel(f"[{unit}]", fontsize=8)
        axis.tick_params(labelsize=7)
        axis.set_yscale("log")
        axis.set_ylim(SOONEST_DRAWN_S, 1.5 * MISSED)
    for axis in axes[len(asked) :]:
        axis.set_visible(False)
    for axis in axes[::PANELS_PER_ROW]:
        axis.set_ylabel("found after [s]", fontsize=8)
    handles, labels = axes[0].get_legend_handles_labels()
    (curve,) = figure.axes[len(axes)].lines  # the share of the first panel
    handles, labels = [*handles, curve], [*labels, f"share found within {WITHIN:g} s [%]"]
    figure.legend(handles, labels, loc="lower right", fontsize=9)
    figure.savefig(path, dpi=110)


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
        made = partial(with_fault, self.observed, self.model, case)
        return self.kept.recording(f"fault_{case.seed}_{case.fault}", made)

    def watched(self) -> WatchedMachine:
        """By tolerances that are learnt from the bag, and from work."""
        batches = range(round(LEARNT_FROM / FAULTLESS_SECONDS))
        heard = [HeardRecording.read(self.train, self.model.joints)]
        heard += [self.without(k, learning=True).heard for k in batches]
        sums = [compare(recording, self.model, None).sums for recording in heard]
        tolerance = learn(self.model.joints, sums, "the bag of the model, and work")
        return WatchedMachine(self.observed, self.model, tolerance)


def rows_of(
    name: str, seconds: float, found: int, answers: Sequence[MonitorAnswer]
) -> list[MeasuredRow]:
    """Aims and findings of the monitor; `found` in `seconds` without fault."""
    hours = (seconds + sum(answer.before for answer in answers)) / HOUR
    alarms = found + sum(answer.alarms for answer in answers)
    told = [answer for answer in answers if answer.first is not None]
    right = sum(answer.right for answer in told) / max(len(told), 1)
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
    encoders = [answer.first for answer in told if answer.case.part is Part.ENCODER]
    outside_encoders = [answer.first for answer in told if answer.case.part is not Part.ENCODER]
    rows += [
        _stopped(f"{name}: faulty encoders, the crane stops", LYING_STOPS, encoders),
        _stopped(f"{name}: another part is faulty, the crane stops", None, outside_encoders),
    ]
    return rows + [
        _row(name, [answer for answer in answers if answer.case.question == question])
        for question in (*FAULT_AIMS, *OTHERS)
    ]


def _stopped(what: str, aim: float | None, found: Sequence[SensorFinding | None]) -> MeasuredRow:
    """How many findings the driver heeds; noise of an encoder is none of them."""
    asked = [
        lift for lift in found if lift and (lift.part, lift.kind) != (Part.ENCODER, Wrong.NOISE)
    ]
    share = sum(question.dangerous for question in asked) / max(len(asked), 1)
    values = {"cases": float(len(asked)), "share": share, "excess": (aim or 0.0) - share}
    cells = [what, f"{aim:.0%}" if aim else "", "{cases:.0f}", "{share:.1%}", "", ""]
    return MeasuredRow(cells=cells, values=values)


def _row(name: str, answers: Sequence[MonitorAnswer]) -> MeasuredRow:
    question = answers[0].case.question
    delays = np.array([answer.delay for answer in answers])
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
    """Measure the sensor monitor on a machine at work: blind cases with a fault, and hours without.

    The exit status is 1 if a target is missed.
    """
    parser = cli.command_line(description=main.__doc__)
    add = parser.add_argument
    add("--on", choices=list(MACHINES), default="stock", help="machine (default: stock)")
    add(
        "--cases",
        type=whole(1),
        default=300,
        help="approximate number of cases with a fault (default: 300)",
    )
    add(
        "--hours",
        type=between(0.1, 1000.0),
        default=20.0,
        help="duration without fault [h] (default: 20)",
    )
    add("--seed", type=whole(0), default=1, help="seed of motion, loads, faults and noise")
    add("--out", type=Path, help="file for the results (JSON)")
    add(
        "--kept",
        type=Path,
        default=Path("runs/observer/sensors"),
        help="folder for the recordings, from which an interrupted run continues "
        "(default: runs/observer/sensors)",
    )
    add(
        "--picture",
        type=Path,
        help="picture of the smallest faults found, and of the delays, for each kind",
    )
    arguments = parser.parse_args(argv)

    def body() -> None:
        if arguments.picture:
            cli.check_out(arguments.picture, replace=True)
        name, seed = arguments.on, arguments.seed
        work = BenchmarkWork.of(name, seed, arguments.kept)
        cases = drawn(work.observed, arguments.cases, seed + WITH)
        batches = range(math.ceil(arguments.hours * HOUR / FAULTLESS_SECONDS))
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
        tell(rows, SENSOR_COLUMNS, command, arguments.out, missed(rows))

    return cli.run(body)
