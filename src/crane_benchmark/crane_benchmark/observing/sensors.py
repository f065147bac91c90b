"""`sensors`: what the sensor monitor is to find, and what it finds, on machines at work."""

import tempfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from crane_benchmark.measured import MeasuredRow
from crane_benchmark.observing.beside_aims import tell
from crane_benchmark.observing.failing import AIMS, OTHERS, drawn
from crane_benchmark.observing.observer import MACHINES, identified
from crane_benchmark.observing.picture import draw_curves
from crane_benchmark.observing.watched import (
    BATCH,
    LEARNT_FROM,
    MonitorAnswer,
    WatchedMachine,
    answered,
    false_alarms,
    smallest,
    work,
)
from crane_model import cli
from crane_model.arguments import between, whole
from crane_model.progress_bar import progress_bar
from crane_observer.monitor.finding import SensorFinding
from crane_observer.monitor.replay import watch
from crane_observer.monitor.signatures import Part, Wrong
from crane_observer.monitor.tolerance import learn

ALARMS = 0.1  # an hour, at most
RIGHT = 0.9  # of what is found, at least
LYING_STOPS = 0.99  # of the encoders that are found to lie, at least
COLUMNS = ("what", "aim", "cases", "reached", "smallest", "median delay [s]")
LEARNING, WITHOUT, WITH = 10_000, 20_000, 30_000  # seeds, beside that of the command


def prepared(name: str, seed: int) -> WatchedMachine:
    """The machine identified from a bag, and tolerances learnt from it and from work."""
    make_it, _, _ = MACHINES[name]
    observed = make_it()
    with tempfile.TemporaryDirectory() as folder:
        model = identified(observed, seed, Path(folder))
        trained = watch(Path(folder) / "train", model, None).sums
    batches = range(round(LEARNT_FROM / BATCH))
    sums = [trained, *work(observed, model, [seed + LEARNING + k for k in batches])]
    return WatchedMachine(
        observed, model, learn(model.joints, sums, "the bag of the model, and work")
    )


def rows_of(
    name: str, hours: float, found: int, answers: Sequence[MonitorAnswer]
) -> list[MeasuredRow]:
    """Every aim of the monitor, and what else it finds."""
    alarms = found + sum(one.before for one in answers)
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
    add("--picture", type=Path, help="new picture of what is found by size, for each kind")
    arguments = parser.parse_args(argv)

    def body() -> None:
        if arguments.picture:
            cli.check_out(arguments.picture, replace=True)
        watched = prepared(arguments.on, arguments.seed)
        cases = drawn(watched.observed, arguments.cases, arguments.seed + WITH)
        answers = []
        with progress_bar("faults", len(cases)) as bar:
            for case in cases:
                answers.append(answered(watched, case))
                bar.update()
        for answer in answers:
            if not answer.right:
                print(f"{answer.case.fault}: {answer.first or 'not found'}")
        hours, found = false_alarms(watched, arguments.hours, arguments.seed + WITHOUT)
        for one in found:
            print(f"false alarm: {one}")
        rows = rows_of(arguments.on, hours, len(found), answers)
        if arguments.picture:
            draw_curves(arguments.picture, answers)
        command = (
            f"ros2 run crane_benchmark sensors --on {arguments.on} --cases {arguments.cases} "
            f"--hours {arguments.hours:g} --seed {arguments.seed}"
        )
        tell(rows, COLUMNS, command, arguments.out, missed(rows))

    return cli.run(body)
