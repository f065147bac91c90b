"""`ros2 run crane_trajectory tune`: try a controller on the identified simulation."""

from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from crane_model import cli
from crane_model.cli import between
from crane_model.errors import ConfigurationError, CraneError
from crane_model.hydraulics.simulation import MAX_CYCLE_S, IdentifiedSimulation, identified
from crane_model.machine import Machine
from crane_model.machine_files import machine_file
from crane_model.model_file import Model, load_model
from crane_model.progress_bar import progress_bar
from crane_trajectory.control.choice import NAMES, PD_DEAD_BAND, PREDICTIVE, controller
from crane_trajectory.control.controller import (
    ControlCondition,
    Controller,
    Point,
    SensorReading,
    Wanted,
    load_gains,
)
from crane_trajectory.control.dead_time import LEAST_MARGINS, PredictiveFlow
from crane_trajectory.motion.check import load_clearance
from crane_trajectory.motion.motion import Motion, plan
from crane_trajectory.motion.periodic import PeriodicTrajectory, load_trajectory

SWING_FREQUENCY = 3.0  # Hz, above which speed beside the reference is ripple
SWINGING = 0.1  # ripple over speed, from which a joint swings
SCALES = (1.0, 1.5, 2.0, 3.0, 4.0, 6.0)
DELAYS = (0.02, 0.05, 0.1, 0.15)  # s
WANTED_SCALE, WANTED_DELAY = 2.0, 0.05

Steps = Callable[[Iterable[int]], Iterable[int]]


class GainTrial(NamedTuple):
    """A run beside others."""

    scale: float  # of the gains
    late: float  # s, more than the loop is


TRIALS = (
    *(GainTrial(scale, 0.0) for scale in SCALES),
    *(GainTrial(1.0, late) for late in DELAYS),
    GainTrial(WANTED_SCALE, WANTED_DELAY),
)


class Tried(NamedTuple):
    """Results of N trials over the periods of a motion; j joints of the model."""

    rms: np.ndarray  # (N, j) of the tracking error, rad, m
    ripple: (
        np.ndarray
    )  # (N, j) rms of speed beside the reference above `SWING_FREQUENCY` over its own rms
    worst: tuple[ControlCondition, ...]  # (N,)

    @property
    def steady(self) -> np.ndarray:
        """(N, j) whether the joint does not swing and the controller does not stop."""
        stopped = np.array([condition.stops for condition in self.worst])
        steady: np.ndarray = (self.ripple < SWINGING) & ~stopped[:, np.newaxis]
        return steady


def run_trials(
    model: Model,
    motion: Motion,
    trials: Sequence[GainTrial],
    controller: Callable[[float], Controller],
    progress: Steps = iter,
) -> Tried:
    """Move the identified simulation once for each trial; `controller` makes one of a scale.

    Joints that the model lacks stand on their reference. Sensors show the truth.
    """
    machine, known = identified(model)
    columns = [machine.index(joint) for joint in model.joints]
    delay = float(np.mean([known.joints[joint].valve.delay for joint in model.joints]))
    start = np.tile(motion.start[columns], (len(trials), 1))
    simulation = IdentifiedSimulation(
        model, start, delay + np.array([trial.late for trial in trials])
    )
    made = [controller(trial.scale) for trial in trials]
    for trial_controller in made:
        trial_controller.start(np.zeros(len(motion.start)))
    times = np.arange(0.0, motion.excitation_end, MAX_CYCLE_S)
    now, ahead = (motion.reference(times + later) for later in (0.0, made[0].preview))
    shape = (len(times), *start.shape)
    error, beside = np.empty(shape), np.empty(shape)
    worst = [ControlCondition.AT_REST] * len(trials)
    for k in progress(range(len(times))):
        here, there = (Point(*(part[k] for part in reference[:3])) for reference in (now, ahead))
        wanted = Wanted(here, there)
        q, v = simulation.position, simulation.velocity
        error[k] = now.position[k, columns] - q
        beside[k] = v - now.velocity[k, columns]
        p_a, p_b, supply = simulation.pressures
        u = np.empty(start.shape)
        for n, trial_controller in enumerate(made):
            reading = SensorReading(
                _beside(now.position[k], columns, q[n]),
                _beside(np.zeros(len(motion.start)), columns, v[n]),
                _beside(np.full(len(motion.start), np.nan), columns, p_a[n]),
                _beside(np.full(len(motion.start), np.nan), columns, p_b[n]),
                float(supply[n]),
            )
            u[n] = trial_controller.command(MAX_CYCLE_S, reading, wanted)[columns]
            worst[n] = max(worst[n], *trial_controller.conditions)
        simulation.advance(u, MAX_CYCLE_S)
    inside = times >= motion.excitation_start
    speed = np.sqrt(np.mean(now.velocity[inside][:, columns] ** 2, axis=0))
    spectrum = np.fft.rfft(beside[inside], axis=0)
    spectrum[np.fft.rfftfreq(int(inside.sum()), MAX_CYCLE_S) < SWING_FREQUENCY] = 0.0
    swings = np.fft.irfft(spectrum, int(inside.sum()), axis=0)
    return Tried(
        np.sqrt(np.mean(error[inside] ** 2, axis=0)),
        np.sqrt(np.mean(swings**2, axis=0)) / np.maximum(speed, 1e-9),
        tuple(worst),
    )


def _beside(unknown: np.ndarray, columns: list[int], values: np.ndarray) -> np.ndarray:
    found = unknown.copy()
    found[columns] = values
    return found


class JointMargins(NamedTuple):
    """Largest trials up to which a joint does not swing; 0 if it always does."""

    gain: float  # of the gains
    delay: float  # s
    both: bool  # whether it stands `WANTED_SCALE` and `WANTED_DELAY` at once

    @property
    def suffice(self) -> bool:
        """Return whether the margins are as large as they ought to be."""
        return self.gain >= WANTED_SCALE and self.delay >= WANTED_DELAY

    @property
    def advised(self) -> float:
        """Gains that leave the wanted margins, as far as the trials show."""
        by_gain = self.gain / WANTED_SCALE if self.gain else 0.25
        by_delay = max(self.delay / WANTED_DELAY, 0.25)
        return min(1.0, by_gain, by_delay)


def margins(tried: Tried, trials: Sequence[GainTrial] = TRIALS) -> tuple[JointMargins, ...]:
    """Margins of each joint, from trials that contain those of `TRIALS`."""
    found = []
    for column in tried.steady.T:
        of = dict(zip(trials, column.tolist(), strict=True))
        gain = largest_steady([(trial.scale, of[trial]) for trial in trials if trial.late == 0.0])
        delay = largest_steady([(trial.late, of[trial]) for trial in trials if trial.scale == 1.0])
        found.append(JointMargins(gain, delay, of[GainTrial(WANTED_SCALE, WANTED_DELAY)]))
    return tuple(found)


def largest_steady(steps: list[tuple[float, bool]]) -> float:
    """The last value of increasing ones up to which all are steady; 0 without one."""
    last = 0.0
    for value, steady in steps:
        if not steady:
            break
        last = value
    return last


class MarginError(CraneError):
    """A joint of the identified simulation swings with gains or delays that it ought to stand."""


class TuneRequest(NamedTuple):
    """Request of `tune`."""

    model: Path
    law: str
    feedback_scale: float
    machine: str
    controller: Path | None
    trajectory: Path


def main(argv: Sequence[str] | None = None) -> int:
    """Test a controller on the identified simulation, and print its margins. Nothing moves."""
    parser = cli.command_line(prog="tune", description=main.__doc__)
    parser.add_argument(
        "--model", type=Path, required=True, help="model file with identified hydraulics"
    )
    parser.add_argument(
        "--law",
        choices=NAMES,
        default=PD_DEAD_BAND,
        help="controller, as in the trajectory node (default: %(default)s)",
    )
    parser.add_argument(
        "--feedback-scale",
        type=between(0.05, 2.0),
        default=1.0,
        help="scale of the feedback gains of model-based controllers (default: 1)",
    )
    cli.add_machine(parser)
    parser.add_argument(
        "--controller",
        type=Path,
        help="gains of the PD controller (YAML; default: controller.yaml of the machine)",
    )
    parser.add_argument(
        "--trajectory",
        type=Path,
        default=Path("excitation_20s.yaml"),
        help="trajectory file, or the bare name of one in the machine folder (default:"
        " excitation_20s.yaml)",
    )
    request = TuneRequest(**vars(parser.parse_args(argv)))
    return cli.run(lambda: _tune(request))


def _tune(options: TuneRequest) -> None:
    model = load_model(options.model)
    machine, _ = identified(model)
    name = options.machine
    gains = load_gains(machine_file("controller.yaml", name, options.controller), machine).arrays
    if options.law == PREDICTIVE:
        _tell_margins(controller(options.law, machine, gains, model, options.feedback_scale))
        return
    trajectory = load_trajectory(machine_file("", name, options.trajectory))
    motion = trial_motion(machine, trajectory, machine_file("clearance.yaml", name))

    def made(scale: float) -> Controller:
        scaled = gains._replace(kp=scale * gains.kp, kd=scale * gains.kd)
        return controller(options.law, machine, scaled, model, scale * options.feedback_scale)

    def progress(cycles: Iterable[int]) -> Iterable[int]:
        return progress_bar("tune", over=cycles)

    tried = run_trials(model, motion, TRIALS, made, progress)
    found = dict(zip(model.joints, margins(tried), strict=True))
    _tell(machine, options.law, tried, found)
    if lacking := [joint for joint in machine.joint_names if joint not in model.joints]:
        print(f"not tried, the model lacks them: {', '.join(lacking)}")
    bad = {joint: margin for joint, margin in found.items() if not margin.suffice}
    if bad:
        raise MarginError(
            f"{', '.join(bad)}: too near to swinging; wanted are {WANTED_SCALE:g} times the gains "
            f"and {1e3 * WANTED_DELAY:g} ms. "
            + _advice(options, bad, dict(zip(machine.joint_names, gains.kp, strict=True)))
        )
    swinging = [joint for joint, margin in found.items() if not margin.both]
    print(
        f"each margin suffices; both at once make {', '.join(swinging)} oscillate"
        if swinging
        else "margins suffice, also both at once"
    )


def _tell_margins(predictive: Controller) -> None:
    """Print those of loops with dead time, which are calculated; `MarginError` if they lack."""
    assert isinstance(predictive, PredictiveFlow)
    print("\n".join(predictive.margin_lines()))
    if lacking := predictive.lacking():
        gain, phase, delay = LEAST_MARGINS
        raise MarginError(
            f"{', '.join(lacking)}: too near to swinging; wanted are {gain:g} times the gain, "
            f"{phase:g} degree and {delay:.0%} of the lag. Lower --feedback-scale"
        )


def trial_motion(machine: Machine, trajectory: PeriodicTrajectory, clearance: Path) -> Motion:
    """One period from rest where it begins; other joints in the middle of their ranges."""
    start = machine.ranges().middle
    begin = trajectory.evaluate(np.zeros(1)).position[0]
    for joint, position in zip(trajectory.joint_names, begin, strict=True):
        if joint not in machine.joint_names:
            raise ConfigurationError(
                f"trajectory '{trajectory.name}': moves {joint}, which {machine.name} does not have"
            )
        start[machine.index(joint)] = position
    return plan(machine, trajectory, start, 1, load_clearance(clearance))


def _tell(machine: Machine, law: str, tried: Tried, found: dict[str, JointMargins]) -> None:
    most = f"{SCALES[-1]:g} times the gains and {1e3 * DELAYS[-1]:g} ms"
    print(f"{law} in the simulation, up to {most}:")
    print(f"{'joint':16s}{'RMS error':>14s}{'gain margin':>14s}{'delay margin':>14s}  both")
    for (joint, margin), rms in zip(found.items(), tried.rms[0], strict=True):
        error = f"{1e3 * rms:.2f} m{machine.units[joint]}"
        gain = f"{_least(margin.gain, SCALES)}{margin.gain:g}"
        delay = f"{_least(margin.delay, DELAYS)}{1e3 * margin.delay:g} ms"
        both = "stable" if margin.both else "oscillates"
        print(f"{joint:16s}{error:>14s}{gain:>14s}{delay:>14s}  {both}")
    print(f"both: {WANTED_SCALE:g} times the gains and {1e3 * WANTED_DELAY:g} ms at once")


def _least(value: float, steps: Sequence[float]) -> str:
    return ">= " if value == steps[-1] else ""


def _advice(options: TuneRequest, bad: dict[str, JointMargins], kp: dict[str, float]) -> str:
    if options.law == PD_DEAD_BAND:
        changes = (
            f"kp of {joint} to {margin.advised * kp[joint]:.3g}" for joint, margin in bad.items()
        )
        return f"Lower {', '.join(changes)} in the controller file, kd likewise, and tune again"
    scale = options.feedback_scale * min(margin.advised for margin in bad.values())
    return f"Give feedback_scale {scale:.2g} to the trajectory node, and tune with it again"
