"""Parts of a rehearsal without a driver: margins, stopping distances, and sensor faults."""

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from crane_driver import constants
from crane_driver.safety.commands import SafetySettings
from crane_model.errors import ConfigurationError, RangeError
from crane_model.hydraulics.simulation import identified
from crane_model.machine import Machine
from crane_model.machine_files import machine_file
from crane_model.model_file import Model
from crane_model.result_file import Number, ResultPart
from crane_observer.monitor.replay import compare
from crane_observer.recording import HeardRecording
from crane_sim.make_bag import write_bag
from crane_sim.parts.parameters import SimulatedCrane
from crane_sim.plant.closed_loop import REST_S, record
from crane_sim.plant.plant import Plant
from crane_sim.plant.sampled import Sensors
from crane_sim.sensor_faults import KINDS, Faults, parse, parts_of
from crane_trajectory.control.choice import PD_DEAD_BAND, controller, suited_controller
from crane_trajectory.control.controller import Controller, load_gains
from crane_trajectory.motion.motion import Motion
from crane_trajectory.motion.periodic import load_trajectory
from crane_trajectory.tune import SCALES, GainTrial, largest_steady, run_trials, trial_motion

CYCLE = 0.005  # s, of commands while a stopping distance is measured
RISE = 1.0  # s, from neutral to the whole command
LONGEST_RUN, LONGEST_STOP = 4.0, 4.0  # s
RUN_SHARE = 0.5  # of the range that a joint may use to reach its speed
SLOW = 1e-3  # rad/s, m/s, below which a joint has stopped
OFF_WITHIN = 1.0  # s after the onset of a fault
ONSET_SHARE = 0.25  # of the excitation, after which a fault begins
MONITORED_PARTS = ("encoder", "pressure_a", "pressures", "valve")


class RehearsedMargin(ResultPart):
    """How a controller held a joint of the identified simulation."""

    controller: str
    """Name of the controller."""
    joint: str
    """Joint that is controlled."""
    delay: float
    """Measured dead time of the loop [s]."""
    error: float
    """Rms tracking error at that delay [rad, m]."""
    gain_margin: float
    """Largest factor of the gains at that delay without oscillation, up to 6; 0: none [-]."""
    gain_margin_twice: float
    """The same at twice that delay [-]."""


def refusal(machine_name: str, model: Model) -> str:
    """Return why the fitted model cannot control the machine; empty if it can."""
    try:
        machine, _ = identified(model)
        gains = load_gains(machine_file("controller.yaml", machine_name), machine).arrays
        controller(suited_controller(machine), machine, gains, model)
    except ConfigurationError as error:
        return str(error)
    return ""


def margins(machine_name: str, model: Model, trajectory: str) -> list[RehearsedMargin]:
    """Try the controllers on the identified simulation at its delay and at twice that delay."""
    machine, known = identified(model)
    gains = load_gains(machine_file("controller.yaml", machine_name), machine).arrays
    motion = trial_motion(
        machine,
        load_trajectory(machine_file(trajectory, machine_name)),
        machine_file("clearance.yaml", machine_name),
    )
    delay = float(np.mean([known.joints[joint].valve.delay for joint in model.joints]))
    trials = [GainTrial(scale, late) for late in (0.0, delay) for scale in SCALES]
    found = []
    refused = bool(refusal(machine_name, model))
    for name in (PD_DEAD_BAND,) if refused else (PD_DEAD_BAND, suited_controller(machine)):

        def made(scale: float, name: str = name) -> Controller:
            scaled = gains._replace(kp=scale * gains.kp, kd=scale * gains.kd)
            return controller(name, machine, scaled, model, scale)

        tried = run_trials(model, motion, trials, made)
        for joint, error, steady in zip(model.joints, tried.rms[0], tried.steady.T, strict=True):
            once, twice = (
                largest_steady(list(zip(SCALES, half.tolist(), strict=True)))
                for half in np.split(steady, 2)
            )
            found.append(
                RehearsedMargin(
                    controller=name,
                    joint=joint,
                    delay=delay,
                    error=float(error),
                    gain_margin=once,
                    gain_margin_twice=twice,
                )
            )
    return found


class StoppingDistance(ResultPart):
    """How far a joint of the simulated crane moves after its valve is told to close."""

    joint: str
    """Joint that is stopped."""
    direction: int
    """1 upwards, -1 downwards [-]."""
    speed: float
    """Speed when the command begins to fall [rad/s, m/s]."""
    distance: float
    """From there until the joint stops, at most [rad, m]."""
    allowed: float
    """Distance for which safety.yaml brakes before a limit at that speed [rad, m]."""


def stopping_distances(
    machine: Machine, simulated: SimulatedCrane, safety: SafetySettings, joints: Sequence[str]
) -> list[StoppingDistance]:
    """Bring each joint to its largest speed, close its valve along the ramp of the driver."""
    return [
        _stopped(machine, simulated, safety, joint, direction)
        for joint in joints
        for direction in (1, -1)
    ]


def _stopped(
    machine: Machine, simulated: SimulatedCrane, safety: SafetySettings, joint: str, direction: int
) -> StoppingDistance:
    j, limits = machine.index(joint), machine.limits[joint]
    length = limits.position_max - limits.position_min
    start = simulated.start.copy()
    begin = limits.position_min if direction > 0 else limits.position_max
    start[j] = begin + 0.1 * direction * length
    plant = Plant(simulated, machine, start)
    wanted = limits.velocity_max if direction > 0 else -limits.velocity_min
    u, opening, time = np.zeros(len(start)), 0.0, 0.0
    while (
        direction * plant.v[j] < wanted
        and abs(plant.q[j] - start[j]) < RUN_SHARE * length
        and time < LONGEST_RUN
    ):
        opening = min(1.0, opening + CYCLE / RISE)
        u[j] = direction * opening
        plant.advance(u, CYCLE)
        time += CYCLE
    speed, there, farthest, time = direction * float(plant.v[j]), plant.q[j], 0.0, 0.0
    while time < safety.ramp_time or (abs(plant.v[j]) > SLOW and time < LONGEST_STOP):
        opening = max(0.0, opening - CYCLE / safety.ramp_time)
        u[j] = direction * opening
        plant.advance(u, CYCLE)
        farthest = max(farthest, direction * float(plant.q[j] - there))
        time += CYCLE
    braking = speed**2 / (2.0 * safety.deceleration[joint])
    return StoppingDistance(
        joint=joint,
        direction=direction,
        speed=speed,
        distance=farthest,
        allowed=braking + speed * safety.reaction_time + constants.LIMIT_MARGIN,
    )


class RehearsedFault(ResultPart):
    """The effect of an injected fault on a recording, and the finding of the sensor monitor."""

    fault: str
    """The fault in the notation of `make_bag --fault`."""
    off: Number
    """Largest difference of the joint from its reference in the second after the onset [rad, m];
    null for a fault of no joint, or if the crane could not go on."""
    usual: Number
    """The same in the same second without a fault [rad, m]."""
    named: str
    """The first finding of the monitor; empty if there is none."""
    right: bool
    """The finding names the part that failed."""
    seconds: Number
    """Time from the onset to the finding [s]; null if there is none."""


def every_kind(machine: Machine, joint: str) -> list[str]:
    """Each kind of fault of the parts of one joint, as `make_bag --fault` writes it."""
    there = parts_of(machine)[joint]
    return [
        f"{joint}.{part}.{kind}"
        for part in MONITORED_PARTS
        if part in there
        for kind in KINDS[part]
    ]


def sensor_faults(
    machine_name: str,
    model: Model,
    simulated: SimulatedCrane,
    motion: Motion,
    faults: Sequence[str],
    folder: Path,
    seed: int,
) -> Iterator[RehearsedFault]:
    """Record the motion once with each fault, and give each recording to the sensor monitor.

    The monitor has not learnt the machine: these recordings, made without the bus, have other dead
    times than those of the rehearsal.
    """
    machine = model.machine
    assert machine is not None  # a model of a machine with hydraulics
    gains = load_gains(machine_file("controller.yaml", machine_name), machine)
    length = motion.excitation_end - motion.excitation_start
    onset = round(REST_S + motion.excitation_start + ONSET_SHARE * length, 1)

    def recorded(name: str, failing: Sequence[str]) -> tuple[np.ndarray, np.ndarray]:
        """(n,) time and (n, j) true position minus reference."""
        plant = Plant(simulated, machine, motion.start)
        timed = Faults(machine, failing, seed)
        sensors = Sensors(simulated.sensors, machine, seed, timed=timed)
        made = record(motion, plant, sensors, gains)
        write_bag(folder / name, machine, made)
        return made.time, made.truth.position - made.reference.position

    def largest(found: tuple[np.ndarray, np.ndarray], joint: str) -> float | None:
        if joint not in machine.joint_names:
            return None
        time, error = found
        inside = (time >= onset) & (time < onset + OFF_WITHIN)
        return float(np.abs(error[inside, machine.index(joint)]).max())

    healthy = recorded("healthy", ())
    for fault in faults:
        target, part, _ = fault.partition("=")[0].split(".")
        usual = largest(healthy, target)
        try:
            found = recorded(fault, [f"{fault}@{onset:g}"])
            watched = compare(HeardRecording.read(folder / fault, model.joints), model, None)
        except RangeError as error:
            yield RehearsedFault(
                fault=fault, off=None, usual=usual, named=f"not recorded: {error}", right=False,
                seconds=None,
            )  # fmt: skip
            continue
        first = min(watched.findings, key=lambda finding: finding.found, default=None)
        yield RehearsedFault(
            fault=fault,
            off=largest(found, target),
            usual=usual,
            named="" if first is None else f"{first.sensor}: {first.kind}",
            right=first is not None and _same(first.joint, str(first.part), target, part),
            seconds=None if first is None else first.found - onset,
        )


def _same(joint: str, named: str, target: str, part: str) -> bool:
    """Return whether the monitor's words for a part mean the part that failed."""
    words = {"pressure_a": "pressure A", "pressures": "pressures A and B"}
    return joint == target and named == words.get(part, part)


def check_faults(faults: Sequence[str], machine: Machine) -> None:
    """`ConfigurationError` if a user's fault is wrong, or has an onset."""
    for fault in faults:
        if parse(fault, machine).onset is not None:
            raise ConfigurationError(
                f"fault '{fault}': has an onset, but a rehearsal sets it; leave out @SECONDS"
            )
