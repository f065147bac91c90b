"""`make_bag`: a recording of the simulated crane on an excitation trajectory, as an mcap bag.

>>> from crane_bags.reader import read_topics
>>> from crane_bags.types import JOINT_STATES
>>> from crane_model.machine_files import machine_file
>>> words = ["--trajectory", str(machine_file("excitation_20s.yaml")), "--periods", "1"]
>>> main([*words, "--out", "bag"])
written: bag, 33.1 s
0
>>> read_topics("bag", [JOINT_STATES])[JOINT_STATES.name].names
('slew', 'inner_boom', 'outer_boom', 'telescope')
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np

from crane_bags.types import (
    CYLINDER_PRESSURES,
    JOINT_REFERENCE,
    JOINT_STATES,
    ROBOT_DESCRIPTION,
    VALVE_COMMAND,
)
from crane_bags.writer import BagWriter
from crane_model import cli
from crane_model.cli import between, whole
from crane_model.cylinders import generalized_forces
from crane_model.errors import ConfigurationError
from crane_model.machine import Machine
from crane_model.machine_files import machine_file
from crane_model.model_file import load_model
from crane_model.progress_bar import progress_bar
from crane_model.urdf import urdf
from crane_sim.calibration import injected_in, slewing
from crane_sim.effects.form import InjectedForm, SensorFault
from crane_sim.effects.sensing import faults
from crane_sim.ground_truth import Clean, check_place, clean, load_injected, write_ground_truth
from crane_sim.parts.parameters import (
    MAX_RUNNING_S,
    SimulatedCrane,
    add_plant,
    add_running,
    load_both,
)
from crane_sim.plant.closed_loop import REST_S, Course, SimulatedRecording, Steps, record
from crane_sim.plant.plant import Plant
from crane_sim.plant.sampled import Build, Sensors
from crane_sim.sensor_faults import Faults, add_faults, parse
from crane_sim.work import Joysticks, WorkShift, load_work
from crane_trajectory.control.choice import NAMES, PD_DEAD_BAND, controller
from crane_trajectory.control.controller import Controller, Gains, load_gains
from crane_trajectory.motion.check import load_clearance
from crane_trajectory.motion.motion import plan
from crane_trajectory.motion.periodic import load_trajectory

STARTED = datetime(2025, 1, 1, tzinfo=UTC)  # fixed, so that the same seed gives the same bag

LEAST_WORK_S = 20.0


class Moment(NamedTuple):
    """When a recording begins: the machine was `started` then, and has been `running` [s] since."""

    started: datetime
    running: float


COLD = Moment(STARTED, 0.0)


def effort(machine: Machine, recording: SimulatedRecording) -> np.ndarray:
    """(n, j) generalized forces (27) from readings [N m, N]; NaN where there is no transducer."""
    tau = np.full_like(recording.position, np.nan)
    columns = [machine.index(joint) for joint in recording.cylinders]
    tau[:, columns] = generalized_forces(
        machine,
        recording.position[:, columns],
        recording.pressures.chamber_a,
        recording.pressures.chamber_b,
        recording.cylinders,
    )
    return tau


def write_bag(
    path: Path, machine: Machine, recording: SimulatedRecording, started: datetime = STARTED
) -> None:
    """The topics of the suite, each message stamped and logged when its sample was taken.

    `started` is when the machine was: the zero of the times of the recording.
    """
    tau, pressures, reference = effort(machine, recording), recording.pressures, recording.reference
    zero = round(started.timestamp() * 1e6) * 1000  # ns
    stamps = zero + np.round(recording.time * 1e9).astype(np.int64)
    with BagWriter(path) as bag:
        description = bag.add(ROBOT_DESCRIPTION)
        states = bag.add_arrays(JOINT_STATES, machine.joint_names)
        cylinders = bag.add_arrays(CYLINDER_PRESSURES, recording.cylinders)
        commands = bag.add_arrays(VALVE_COMMAND, machine.joint_names)
        text = bag.store.types[ROBOT_DESCRIPTION.msgtype](data=urdf(machine))
        description.write(int(stamps[0]), text)
        series = {
            states: (recording.position, recording.velocity, tau),
            cylinders: (pressures.chamber_a, pressures.chamber_b, pressures.supply, pressures.tank),
            commands: (recording.command,),
        }
        if np.isfinite(reference.position).any():  # an operator follows none
            series[bag.add_arrays(JOINT_REFERENCE, machine.joint_names)] = reference[:3]
        bag.write_together(stamps, series)


def make(
    out: Path,
    machine: Machine,
    simulated: SimulatedCrane,
    motion: Course,
    gains: Gains,
    seed: int,
    effects: Sequence[InjectedForm] = (),
    moment: Moment = COLD,
    progress: Steps = iter,
    controller: Controller | None = None,
    failing: Sequence[str] = (),
    build: Build | None = None,
    flaws: Sequence[SensorFault] = (),
) -> Clean:
    """Write a bag of a simulated crane with injected effects; nothing but readings tells of them.

    Parameters
    ----------
    out
        Folder of the new bag.
    machine, simulated
        Geometry and parameters of the simulated crane.
    motion
        Motion, as of `plan`.
    gains
        Of the controller (36).
    seed
        Of noise and jitter.
    effects
        Injected effects.
    moment
        When the recording begins.
    progress
        Wraps the cycles, as tqdm does.
    controller
        Leads the crane in place of (36).
    failing
        Faults that begin in the recording, as `crane_sim.sensor_faults.parse` reads them.
    build
        Makes the machine of `simulated`; by default the `Plant`.
    flaws
        Faults of sensors that count as noise.

    Returns
    -------
    What truly happened.

    Raises
    ------
    DataError
        If `out` exists or cannot be made.
    RangeError
        If the crane cannot start where the motion does.
    """
    made = build or partial(Plant, simulated, machine)
    plant = made(motion.start, effects, moment.running)
    timed = Faults(machine, failing, seed, zero=moment.running)
    sensors = Sensors(simulated.sensors, machine, seed, faults(effects, machine), timed, flaws)
    recording = record(slewing(motion, effects), plant, sensors, gains, progress, controller)
    write_bag(out, machine, recording, moment.started)
    return clean(machine, effects, sensors.faults, recording.truth, plant.machine)


def date(text: str) -> datetime:
    """ISO 8601, in UTC where it names no zone; `ValueError` if stamps cannot hold it."""
    date = datetime.fromisoformat(text)
    if not 1970 < date.year < 2200:
        raise ValueError
    return date if date.tzinfo else date.replace(tzinfo=UTC)


@dataclass(frozen=True)
class _Request:
    trajectory: Path | None
    periods: int | None
    work: float | None
    seed: int
    out: Path
    plant: Path | None
    fault: Sequence[str]
    machine: str | None
    gains: Path | None
    law: str
    model: Path | None
    started: datetime
    running: float  # s
    inject: Path | None
    ground_truth: Path | None


def main(argv: Sequence[str] | None = None) -> int:
    """Make a bag with the simulated crane: N periods of a trajectory, or an operator at work."""
    parser = cli.command_line(description=main.__doc__)
    parser.add_argument("--trajectory", type=Path, help="trajectory file (YAML)")
    parser.add_argument("--periods", type=whole(1), help="number of periods to record")
    parser.add_argument(
        "--work",
        type=between(LEAST_WORK_S, MAX_RUNNING_S),
        metavar="SECONDS",
        help="duration of simulated work of an operator [s], instead of a trajectory; "
        "work.yaml of the machine describes the work",
    )
    parser.add_argument(
        "--seed", type=whole(0), default=0, help="seed of sensor noise and jitter (default: 0)"
    )
    parser.add_argument("--out", type=Path, required=True, help="folder of the new bag")
    add_plant(parser)
    add_faults(parser)
    cli.add_machine(parser)
    parser.add_argument(
        "--gains", type=Path, help="gains of the PD controller (YAML; default: the packaged file)"
    )
    parser.add_argument(
        "--law",
        choices=NAMES,
        default=PD_DEAD_BAND,
        help="controller, as in the trajectory node (default: %(default)s)",
    )
    parser.add_argument(
        "--model",
        type=Path,
        help="model file with identified hydraulics, for every controller but the default",
    )
    parser.add_argument(
        "--started",
        type=date,
        default=STARTED,
        metavar="DATE",
        help="start of the machine (UTC; default: 2025-01-01T00:00:00); stamps count from it",
    )
    add_running(parser)
    parser.add_argument(
        "--inject", type=Path, help="effects to inject (YAML), or the ground truth of a bag"
    )
    parser.add_argument(
        "--ground-truth",
        type=Path,
        help="new file for the ground truth, outside the folder of the bag",
    )
    request = _Request(**vars(parser.parse_args(argv)))
    if (request.inject is None) != (request.ground_truth is None):
        parser.error("--inject and --ground-truth: give both or none")

    if (request.model is None) != (request.law == PD_DEAD_BAND):
        parser.error(f"--law and --model: every law but {PD_DEAD_BAND} needs a model")

    if (request.work is None) == (request.trajectory is None):
        parser.error("--trajectory and --work: give one of them")
    if (request.periods is None) != (request.trajectory is None):
        parser.error("--trajectory and --periods: give both or none")
    if request.work is not None and request.law != PD_DEAD_BAND:
        parser.error("--work and --law: an operator controls the machine, not a controller")

    def progress(cycles: Iterable[int]) -> Iterable[int]:
        return progress_bar(request.out.name, over=cycles)

    def body() -> None:
        cli.check_out(request.out)
        machine, parameters = load_both(request.machine, request.plant)
        motion: Course
        if request.trajectory is not None and request.periods is not None:
            motion = plan(
                machine,
                load_trajectory(machine_file("", request.machine, request.trajectory)),
                parameters.start,
                request.periods,
                load_clearance(machine_file("clearance.yaml", request.machine)),
            )
        else:
            motion = WorkShift(parameters.start, request.work or LEAST_WORK_S)
        duration = motion.duration + 2.0 * REST_S
        for text in request.fault:
            if (onset := parse(text, machine).onset or 0.0) >= duration:
                raise ConfigurationError(
                    f"fault '{text}': begins at {onset:g} s, when the bag of {duration:.1f} s has "
                    "ended; let it begin earlier, or record more periods"
                )
        gains = load_gains(machine_file("controller.yaml", request.machine, request.gains), machine)
        model = load_model(request.model) if request.model else None
        led: Controller | None = None
        if isinstance(motion, WorkShift):
            cycle = load_work(machine_file("work.yaml", request.machine), machine)
            led = Joysticks(machine, cycle, request.seed, motion.duration)
        elif model:
            led = controller(request.law, machine, gains.arrays, model)
        effects: tuple[InjectedForm, ...] = ()
        if request.inject is not None and request.ground_truth is not None:
            check_place(request.ground_truth, request.out)
            spec = load_injected(request.inject, machine, parameters)
            effects = injected_in(spec, machine, parameters, gains, request.machine)
        seed, moment = request.seed, Moment(request.started, request.running)
        truth = make(
            request.out, machine, parameters, motion, gains, seed, effects, moment, progress, led,
            request.fault,
        )  # fmt: skip
        if request.ground_truth is not None:
            write_ground_truth(
                request.ground_truth, request.out, seed, machine, parameters, effects, truth
            )
        print(f"written: {request.out}, {motion.duration:.1f} s")

    return cli.run(body)
