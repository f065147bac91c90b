"""`loads`: what the scale is to reach, and what it reaches, on machines at work."""

import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from crane_benchmark.measured import MeasuredRow, tell
from crane_benchmark.observing.machines import WorkCycles
from crane_benchmark.observing.observer import MACHINES, heard, identified
from crane_model import cli
from crane_model.array import Array, Flags
from crane_model.cli import between, whole
from crane_model.errors import DataError
from crane_model.machine import Machine
from crane_observer.payload.estimator import (
    PAYLOAD_WINDOW,
    STANDING,
    WITHOUT_ESTIMATE,
    PayloadEstimate,
    PayloadEstimator,
    replay,
)
from crane_observer.payload.filter import CENTRED
from crane_sim.plant.closed_loop import REST_S

PAYLOAD_AIMS = {"stock": (0.005, 0.005), "hard": (0.03, 0.02)}
"""Root mean square of the error over the load: without tare, with one."""
COVERED = 0.90, 0.98  # share of the loads that lie in their 95 % interval
CONFIDENCE = 1.96  # standard deviations
LEAST_MOTION = 2.0  # s, in which a load was moved; the aims are for such
BEFORE = 0.05  # s before a load changes, when it is read
LOAD_COLUMNS = ("quantity", "target", "lifts", "error, rms", "largest", "in their 95 % interval")


class WeighedLift(NamedTuple):
    """A load, and what the scale said of it at last."""

    load: float  # kg
    moved: float  # s of motion, by what truly happened, from its pick-up on
    mass: float  # kg
    deviation: float  # kg
    permitted: bool  # to weigh, by some pose of it; else the scale said that none was

    @property
    def error(self) -> float:
        """Error of the load."""
        return (self.mass - self.load) / self.load

    @property
    def covered(self) -> bool:
        """Return whether the 95 % interval holds the true load."""
        return abs(self.mass - self.load) <= CONFIDENCE * self.deviation


def weighed(
    cycles: WorkCycles, time: Array, moving: Flags, found: Sequence[PayloadEstimate]
) -> list[WeighedLift]:
    """Loads as known when put down; `moving` (n,): whether the machine moved at `time` (n,) [s]."""
    rest_before = np.concatenate([[0.0], cycles.ends[:-1]])
    changes = REST_S + (rest_before + cycles.begins) / 2.0
    moved = np.concatenate([[0.0], np.cumsum(np.diff(time) * moving[1:])])
    times, answers, came = np.array([weighing.time for weighing in found]), [], 0.0
    for k in np.flatnonzero(np.diff(cycles.loads) != 0.0):
        load, goes = float(cycles.loads[k]), float(changes[k + 1])
        last = int(np.searchsorted(times, goes - BEFORE)) - 1
        if load > 0.0 and last >= 0:
            told = found[last].load
            begin, end = np.interp([came, goes], time, moved)
            first = int(np.searchsorted(times, came + PAYLOAD_WINDOW))
            alone = found[first : last + 1]  # windows with this load alone
            permitted = any(one.condition not in WITHOUT_ESTIMATE for one in alone)
            answers.append(
                WeighedLift(load, float(end - begin), told.mass, told.deviation, permitted)
            )
        came = goes
    return answers


def in_motion(machine: Machine, joints: tuple[str, ...], velocity: Array) -> Flags:
    """(n,) whether one of the `joints` moves, with velocity (n, j) of them [rad/s, m/s]."""
    slow = STANDING * machine.ranges(joints).slower_speed
    moving: Flags = np.logical_or.reduce(np.abs(velocity) > slow, axis=1)
    return moving


def measure(name: str, seconds: float, seed: int, machines: int) -> list[MeasuredRow]:
    """Measure all lifts of machines that are identified one by one, each with its own error."""
    of_machines = [lifts(name, seconds, seed + k) for k in range(machines)]
    rows = []
    for what, aim in zip(of_machines[0], PAYLOAD_AIMS[name], strict=True):
        rows += rows_of(
            f"{name}: {what}", aim, [lift for found in of_machines for lift in found[what]]
        )
    return rows


def lifts(name: str, seconds: float, seed: int) -> dict[str, list[WeighedLift]]:
    """Without tare, and with one at the end of the first move, which is empty."""
    make_it, _, _ = MACHINES[name]
    observed = make_it()
    with tempfile.TemporaryDirectory() as folder:
        model = identified(observed, seed, Path(folder))
    given = observed.machine, observed.simulated.start, seconds, seed
    cycles = WorkCycles.drawn(*given, hung=CENTRED)
    made, _ = observed.at_work(seconds, seed, hung=CENTRED)
    columns = [observed.machine.index(joint) for joint in model.joints]
    moving = in_motion(observed.machine, model.joints, made.truth.velocity[:, columns])
    recording, time = heard(made, model, observed), made.time - made.time[0]
    tares = {"without tare": np.nan, "with tare": REST_S + float(cycles.ends[0])}
    return {
        what: weighed(cycles, time, moving, replay(PayloadEstimator(model), recording, tared))
        for what, tared in tares.items()
    }


def rows_of(what: str, aim: float, answers: Sequence[WeighedLift]) -> list[MeasuredRow]:
    """Loads that were moved as long as the aim asks and that the scale weighed; beside it those
    of which it says that no pose of theirs permits that, and those that were hardly moved.
    `DataError` where no load is left to be counted.
    """
    low, high = COVERED
    words = f"{aim:.1%}; {low:.0%} to {high:.0%} in their interval"
    little = [lift for lift in answers if lift.moved < LEAST_MOTION]
    refused = [lift for lift in answers if lift.moved >= LEAST_MOTION and not lift.permitted]
    enough = [lift for lift in answers if lift.moved >= LEAST_MOTION and lift.permitted]
    if not enough:
        raise DataError(
            f"{what}: of {len(answers)} loads, none was moved for {LEAST_MOTION:g} s or more in a "
            "pose that permits weighing, so there is no error to tell; ask for more --seconds"
        )
    rows = [_row([what, words], {"aim": aim}, enough)]
    if refused:
        rows.append(_row([f"{what}, no pose permits weighing, it says", ""], {}, refused))
    if little:
        rows.append(_row([f"{what}, moved for less than {LEAST_MOTION:g} s", ""], {}, little))
    return rows


def _row(what: list[str], values: dict[str, float], answers: Sequence[WeighedLift]) -> MeasuredRow:
    errors = np.array([lift.error for lift in answers])
    return MeasuredRow(
        cells=[*what, "{lifts:.0f}", "{rms:.2%}", "{largest:.1%}", "{covered:.1%}"],
        values={
            **values,
            "lifts": float(len(errors)),
            "rms": float(np.sqrt(np.mean(errors**2))),
            "largest": float(np.abs(errors).max()),
            "covered": float(np.mean([lift.covered for lift in answers])),
        },
    )


def missed(rows: Sequence[MeasuredRow]) -> list[str]:
    """Aims that are not reached, in words."""
    low, high = COVERED
    wrong = []
    for row in rows:
        values = row.values
        if "aim" not in values:
            continue
        if values["rms"] > values["aim"]:
            wrong.append(f"{row.cells[0]}: {values['rms']:.2%}, aim {values['aim']:.1%}")
        if not low <= values["covered"] <= high:
            wrong.append(f"{row.cells[0]}: {values['covered']:.1%} in their 95 % interval")
    return wrong


def main(argv: Sequence[str] | None = None) -> int:
    """Measure the payload estimator on machines at work, with loads of 20 to 150 kg that come and
    go without notice. The exit status is 1 if a target is missed.
    """
    parser = cli.command_line(description=main.__doc__)
    add = parser.add_argument
    add(
        "--seconds",
        type=between(60.0, 36000.0),
        default=600.0,
        help="duration of the work [s] (default: 600)",
    )
    add("--machines", type=whole(1), default=6, help="number of machines of each kind (default: 6)")
    add("--seed", type=whole(0), default=101, help="seed of the first machine (default: 101)")
    add("--out", type=Path, help="file for the results (JSON)")
    arguments = parser.parse_args(argv)

    def body() -> None:
        given = arguments.seconds, arguments.seed, arguments.machines
        rows = [row for name in MACHINES for row in measure(name, *given)]
        command = "ros2 run crane_benchmark loads --seconds {:g} --seed {} --machines {}"
        tell(rows, LOAD_COLUMNS, command.format(*given), arguments.out, missed(rows))

    return cli.run(body)
