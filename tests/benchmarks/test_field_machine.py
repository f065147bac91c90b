"""The field excavator, from an operator's work alone: hydraulics, mechanics, control.

Ten minutes of joystick work identify the machine, ten others validate it. Then its teeth follow
straight lines of 1 m at 0.2 m/s, by the PD controller with the best of several gains, and by
`predictive_flow` with the identified model.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
import yaml

from crane_identification import Options, validate
from crane_identification.data.sources import Sources
from crane_identification.hydraulics.joint_estimate import identify_joint
from crane_identification.identify import main as identify
from crane_identification.report.content import pooled
from crane_model import DataError, Machine, Model, load_model, tip_position
from crane_model.machine_files import machine_file
from crane_observer import HeardRecording, PositionEstimator, learn, unlearnt
from crane_observer.monitor.replay import compare
from crane_observer.payload.estimator import PayloadEstimator, lifts, replay
from crane_observer.payload.filter import Balanced
from crane_observer.position.replay import replay as replay_positions
from crane_sim import Plant, Sensors, SimulatedCrane, record
from crane_sim.make_bag import main as make_bag
from crane_sim.parts.parameters import load_both
from crane_sim.plant.closed_loop import REST_S
from crane_sim.true_values import hydraulics_of, true_parameters
from crane_trajectory import Clearance, Motion, plan
from crane_trajectory.control.choice import PREDICTIVE, controller
from crane_trajectory.control.controller import Controller, PdDeadBand, load_gains
from crane_trajectory.control.dead_time import PredictiveFlow
from crane_trajectory.motion.tip_path import StraightLine, plan_tip_path

Measured = Callable[..., None]
NAME = "field_excavator"
WORK_S = 600.0
WARM_S = 36_000.0  # s for which the machine has been running
DEAD_TIME_AIM, FORCE_AIM, TIP_AIM, TIMES_BETTER_AIM = 0.010, 0.03, 20.0, 5.0
LOADS = (300.0, 600.0, 1000.0)  # kg at the teeth
FULL_SCALE, PAYLOAD_AIM = 1200.0, 0.02  # kg, a bucket of earth; share
OBSERVED_S, FAULT_S, POSITION_AIM = 120.0, 40.0, 0.010  # s, s, rad
PD_SCALES = (0.5, 0.7, 1.0, 1.4, 2.0, 2.8)
LINES = {
    "away from the machine": ([0.0, 0.45, -1.75, -0.5], [1.0, 0.0, 0.0]),
    "towards it": ([0.0, 0.35, -1.2, -0.7], [-1.0, 0.0, 0.0]),
    "down": ([0.0, 0.55, -1.5, -0.6], [0.0, 0.0, -1.0]),
    "up": ([0.0, 0.35, -1.5, -0.6], [0.0, 0.0, 1.0]),
}
"""Where the joints begin [rad], and the direction of the line in the base frame."""


class Field(NamedTuple):
    """The machine, its simulated crane, and where recordings and results are."""

    machine: Machine
    simulated: SimulatedCrane
    folder: Path

    @property
    def model(self) -> Model:
        """What was identified."""
        return load_model(self.folder / "identified" / "model.yaml")


@pytest.fixture(scope="module")
def field(tmp_path_factory: pytest.TempPathFactory) -> Field:
    folder = tmp_path_factory.mktemp("field")
    work = ["--machine", NAME, "--work", str(WORK_S), "--running", str(WARM_S)]
    for seed, name in enumerate(("train", "validate"), start=1):
        assert make_bag([*work, "--seed", str(seed), "--out", str(folder / name)]) == 0
    given = ["--model", str(machine_file("model.yaml", NAME)), "--no-average"]
    bags = ["--train", str(folder / "train"), "--validate", str(folder / "validate")]
    assert identify([*given, *bags, "--out", str(folder / "identified")]) == 0
    return Field(*load_both(NAME, None), folder)


def test_dead_times(field: Field, measured: Measured) -> None:
    """From a command to the flow that it makes: the latency of the angles is not part of it."""
    hydraulics = field.model.hydraulics
    assert hydraulics is not None
    errors = {}
    for joint, known in hydraulics.joints.items():
        true = hydraulics_of(field.simulated, field.machine, joint)["lag"]
        errors[joint] = known.valve.lag.value - true
    text = ", ".join(f"{joint} {1e3 * error:+.1f}" for joint, error in errors.items())
    measured("dead times, error [ms]", "10", text, **{j: 1e3 * e for j, e in errors.items()})
    assert max(map(abs, errors.values())) < DEAD_TIME_AIM


def test_flow_of_a_shared_pump(field: Field, measured: Measured) -> None:
    """The share of flow that the balance leaves, with and without the pump that all share."""
    hydraulics, model = field.model.hydraulics, field.model
    assert hydraulics is not None and field.machine.supply is not None
    shared = {joint: known.unexplained for joint, known in hydraulics.joints.items()}
    logs = Sources(model, None, Options(), lambda *_: None).read([field.folder / "train"])
    left = {}
    for joint in shared:
        try:
            left[joint] = identify_joint(field.machine, joint, logs).values.unexplained
        except DataError:
            left[joint] = np.nan
    text = ", ".join(f"{joint} {share:.1%}" for joint, share in shared.items())
    without = ", ".join(
        f"{joint} {'refused' if np.isnan(share) else f'{share:.1%}'}"
        for joint, share in left.items()
    )
    measured("flow unexplained, with the shared pump", "", text, **shared)
    measured("the same, if each valve had the supply pressure", "", without)
    assert max(shared.values()) < 0.1


def test_force_on_held_out_work(field: Field, measured: Measured) -> None:
    """And with the true parameters that the sensors set."""
    model = field.model
    options = Options(average=False)
    held_out = Sources(model, None, options, lambda *_: None).read([field.folder / "validate"])
    true = {entry.name: entry.value for entry in true_parameters(field.simulated, field.machine)}
    theta = np.array([true[parameter.name] for parameter in model.parameters])
    exact = model.with_estimate(theta, np.zeros(len(theta)), "true values")
    found, bound = (
        pooled(each, validate(each, held_out, options, lambda *_: None)).relative
        for each in (model, exact)
    )
    for what, errors in (("identified", found), ("true parameters", bound)):
        text = ", ".join(
            f"{joint} {error:.1%}" for joint, error in zip(model.joints, errors, strict=True)
        )
        values = dict(zip(model.joints, errors, strict=True))
        measured(f"held-out force, {what}", f"{FORCE_AIM:.0%}", text, **values)
    assert (found < 1.3 * bound + 0.01).all()


class TipScore(NamedTuple):
    """Over a line [mm]: beside the reference, beside the line, and as the sensors show it."""

    behind: float
    beside: float
    shown: float


def follow(field: Field, motion: Motion, law: Controller) -> TipScore:
    """Lead the machine along a motion of its teeth."""
    plant = Plant(field.simulated, field.machine, motion.start, running=WARM_S)
    sensors = Sensors(field.simulated.sensors, field.machine, 5)
    gains = load_gains(machine_file("controller.yaml", NAME), field.machine)
    found = record(motion, plant, sensors, gains, controller=law)
    inside = (found.time - found.time[0] > REST_S) & (
        found.time - found.time[0] < REST_S + motion.duration
    )
    wanted, true, shown = (
        tip_position(field.machine, course[inside])
        for course in (found.reference.position, found.truth.position, found.position)
    )
    way = wanted[-1] - wanted[0]
    way /= np.linalg.norm(way)
    off = true - wanted
    across = off - np.outer(off @ way, way)
    return TipScore(
        *(
            1e3 * float(np.sqrt(np.mean((error**2).sum(axis=1))))
            for error in (off, across, shown - wanted)
        )
    )


def line(field: Field, name: str) -> Motion:
    """1 m at 0.2 m/s."""
    start, direction = (np.array(values) for values in LINES[name])
    end = tip_position(field.machine, start[np.newaxis])[0] + direction
    path = plan_tip_path(field.machine, start, [StraightLine(end)], 0.2, 0.15, name)
    assert not path.limited_by, path.limited_by
    free = Clearance(gripper_length=0.0, ground_clearance=None, pillar_clearance=None)
    return plan(field.machine, path.trajectory, start, 1, free)


def test_teeth_along_a_line(field: Field, measured: Measured) -> None:
    """By PD with the best of several gains over all lines, and by the predictor."""
    motions = [line(field, name) for name in LINES]
    gains = load_gains(machine_file("controller.yaml", NAME), field.machine).arrays

    def mean(scores: list[TipScore]) -> TipScore:
        return TipScore(*np.sqrt(np.mean(np.square(scores), axis=0)).tolist())

    def pd(scale: float) -> TipScore:
        tried = gains._replace(kp=scale * gains.kp)
        return mean([follow(field, motion, PdDeadBand(tried)) for motion in motions])

    tuned = min((pd(scale) for scale in PD_SCALES), key=lambda score: score.behind)
    model = field.model
    made = [controller(PREDICTIVE, field.machine, gains, model) for _ in motions]
    scores = [follow(field, motion, law) for motion, law in zip(motions, made, strict=True)]
    found = mean(scores)
    for what, score in (("PD, tuned", tuned), (PREDICTIVE, found)):
        measured(
            f"teeth on a line of 1 m at 0.2 m/s, {what}: RMS to the reference, across the line, "
            "to the reference by the sensors [mm]",
            f"{TIP_AIM:.0f}",
            f"{score.behind:.1f}, {score.beside:.1f}, {score.shown:.1f}",
            **score._asdict(),
        )
    times = tuned.behind / found.behind
    measured("times better than PD", f"{TIMES_BETTER_AIM:.0f}", f"{times:.1f}", times=times)
    assert found.behind < TIP_AIM and times > TIMES_BETTER_AIM


def test_margins_of_the_predictor(field: Field, measured: Measured) -> None:
    model = field.model
    gains = load_gains(machine_file("controller.yaml", NAME), field.machine).arrays
    law = controller(PREDICTIVE, field.machine, gains, model)
    assert isinstance(law, PredictiveFlow)
    found = law.margins.items()
    text = "; ".join(
        f"{joint} {margin.gain:.1f}, {margin.phase:.0f}°, {1e3 * margin.delay:.0f} ms"
        for joint, margin in found
    )
    measured("margins of gain, phase and delay", "2, 40°, 35 % of the lag", text)
    assert not law.lacking()


def test_payload(field: Field, measured: Measured) -> None:
    """One minute of work with a load at the teeth, and one of another operator."""
    plant = yaml.safe_load(machine_file("simulated_crane.yaml", NAME).read_text(encoding="utf-8"))
    errors, bounds, changes = [], [], 0
    for number, load in enumerate(LOADS):
        body = {"link": "bucket", "origin": [0.0] * 3, "mass": load, "inertia": [1.0] * 3}
        loaded = plant["bodies"] | {"load": body | {"centre_of_mass": [0.0] * 3}}
        file = field.folder / f"loaded_{load:g}.yaml"
        file.write_text(yaml.safe_dump(plant | {"bodies": loaded}), encoding="utf-8")
        for seed in (number + 3, number + 13):
            bag = field.folder / f"loaded_{load:g}_{seed}"
            given = ["--machine", NAME, "--plant", str(file), "--running", str(WARM_S)]
            assert make_bag([*given, "--work", "60", "--seed", str(seed), "--out", str(bag)]) == 0
            model = field.model
            estimator = PayloadEstimator(model)
            windows = windows_of(estimator)
            found = replay(estimator, HeardRecording.read(bag, model.joints))
            bounds.append(least_deviation(windows, model, load))
            changes += sum(estimate.changed for estimate in found)
            errors += [(lift.load.mass - load, load) for lift in lifts(found)]
    error, true = np.array(errors).T
    bound = np.array(bounds)
    of_scale, of_load = (
        float(np.sqrt(np.mean((error / scale) ** 2))) for scale in (FULL_SCALE, true)
    )
    measured(
        f"payload of {LOADS[0]:g} to {LOADS[-1]:g} kg in one minute of work, RMS: of "
        f"{FULL_SCALE:g} kg, of the load; false changes",
        f"{PAYLOAD_AIM:.0%}, {PAYLOAD_AIM:.0%}",
        f"{of_scale:.1%}, {of_load:.1%}; {changes} in {len(LOADS) * 2} min",
        of_scale=of_scale,
        of_load=of_load,
    )
    scale_bound, load_bound = (
        float(np.sqrt(np.mean((bound / scale) ** 2)))
        for scale in (FULL_SCALE, np.repeat(LOADS, len(bounds) // len(LOADS)))
    )
    measured(
        "payload: lower bound from sensor noise and friction uncertainty, RMS",
        "",
        f"{scale_bound:.1%}, {load_bound:.1%}",
        of_scale=scale_bound,
        of_load=load_bound,
    )
    assert of_scale < PAYLOAD_AIM


def windows_of(estimator: PayloadEstimator) -> list[Balanced]:
    """The windows that an estimator will have taken."""
    windows: list[Balanced] = []
    take = estimator._hypotheses.add

    def noted(time: float, window: Balanced) -> bool:
        windows.append(window)
        return take(time, window)

    estimator._hypotheses.add = noted  # type: ignore[method-assign]
    return windows


def least_deviation(windows: Sequence[Balanced], model: Model, load: float) -> float:
    """The bound of Cramer and Rao [kg] of a `load` [kg] at the tip that stays.

    From its weight, by the balance of the joints that move steadily, with the noise of their
    readings, and with dry and viscous friction as doubtful as their identification left them.
    """
    assert model.std_devs is not None and model.theta is not None
    names = [parameter.name for parameter in model.parameters]
    doubts = []
    for name in (f"{kind}.{joint}" for kind in ("f_c", "f_v") for joint in model.joints):
        k = names.index(name)
        doubts.append(float(model.std_devs[k] / model.theta[k]))
    information = np.diag([0.0, *1.0 / np.square(doubts)])
    for window in windows:
        balance = window.balance
        by_load, shown = (
            balance.inertia_of_load[0],
            np.linalg.solve(balance.inertia, balance.inertial),
        )
        inertia = balance.inertia + load * by_load
        noise = np.diag(window.noise**2) + inertia @ window.shaken @ inertia.T
        dry = np.where(window.upwards, balance.up, balance.down)
        slopes = np.column_stack(
            [balance.mass - by_load @ shown, np.diag(dry), np.diag(balance.viscous)]
        )[window.moving]
        noise = noise[np.ix_(window.moving, window.moving)]
        information += slopes.T @ np.linalg.solve(noise, slopes)
    return float(np.sqrt(np.linalg.inv(information)[0, 0]))


def test_position_without_an_encoder(field: Field, measured: Measured) -> None:
    """Two minutes of work; gravity does not turn the swing, whose position only flow tells."""
    model = field.model
    recording = HeardRecording.read(field.folder / "validate", model.joints)
    recording = during(recording, 0.0, OBSERVED_S)
    latency = field.machine.latency(model.joints)
    errors, told, observable = {}, {}, {}
    for j, joint in enumerate(model.joints):
        hidden = np.arange(len(model.joints)) == j
        course = replay_positions(
            PositionEstimator(model, recording.encoders[0].copy()), recording, hidden
        )
        shown = recording.encoders[:, j]
        true = np.interp(course.time + latency[j], recording.encoder_time, shown)
        errors[joint] = float(np.sqrt(np.mean((course.position[:, j] - true) ** 2)))
        told[joint] = float(np.sqrt(np.mean(course.deviation[:, j] ** 2)))
        observable[joint] = bool(course.observable[-1, j])
    text = ", ".join(
        f"{joint} {1e3 * error:.1f} ({1e3 * told[joint]:.0f})" for joint, error in errors.items()
    )
    measured(
        f"position without one encoder, {OBSERVED_S:g} s of work, RMS (standard deviation that the "
        "estimator reports) [mrad]",
        f"{1e3 * POSITION_AIM:.0f}",
        text,
        **errors,
    )
    weighed = [joint for joint in model.joints if joint != "swing"]
    assert all(errors[joint] < POSITION_AIM for joint in weighed)
    assert all(errors[joint] < 3.0 * told[joint] for joint in model.joints)
    assert observable == {joint: joint in weighed for joint in model.joints}


def during(recording: HeardRecording, begin: float, end: float) -> HeardRecording:
    """The readings from `begin` to `end` [s]."""
    changed = {}
    for clock, values in (
        ("encoder_time", ("encoders",)),
        ("pressure_time", ("chamber_a", "chamber_b", "supply")),
        ("command_time", ("commands",)),
    ):
        time = getattr(recording, clock)
        inside = (time >= begin) & (time < end)
        changed |= {name: getattr(recording, name)[inside] for name in (clock, *values)}
    return replace(recording, **changed)


def faulty(
    recording: HeardRecording, name: str, joint: int, fault: Callable[..., np.ndarray]
) -> HeardRecording:
    """With `fault` of readings (n,) and of the time since FAULT_S (n,) in a column from then on."""
    time = recording.encoder_time if name == "encoders" else recording.pressure_time
    values, since = getattr(recording, name).copy(), time >= FAULT_S
    values[since, joint] = fault(values[since, joint], time[since] - FAULT_S)
    return replace(recording, **{name: values})


FAULTS: dict[str, tuple[str, str, Callable[[np.ndarray, np.ndarray], np.ndarray]]] = {
    "boom encoder": ("encoders", "boom", lambda shown, _: np.full_like(shown, shown[0])),
    "bucket encoder": ("encoders", "bucket", lambda shown, _: shown + 0.05),
    "arm encoder": ("encoders", "arm", lambda shown, since: shown + 2e-3 * since),
    "boom pressure A": ("chamber_a", "boom", lambda shown, since: shown + 5e4 * since),
    "boom pressure B": ("chamber_b", "boom", lambda shown, _: np.full_like(shown, shown[0])),
}
"""By the sensor that is to be named: one that sticks, jumps by 50 mrad, drifts by 2 mrad/s and by
0.5 bar/s, and sticks."""


def test_sensor_monitor(field: Field, measured: Measured) -> None:
    """With a tolerance from the ten minutes that identified the model, over ten others."""
    model = field.model
    sums = compare(
        HeardRecording.read(field.folder / "train", model.joints), model, unlearnt(model.joints)
    ).sums
    tolerance = learn(model.joints, [sums], "ten minutes of work")
    recording = HeardRecording.read(field.folder / "validate", model.joints)
    healthy = compare(recording, model, tolerance)
    alone = compare(recording, model, None)
    measured(
        "alarms of the sensor monitor without a fault; the largest share of an alarm",
        "",
        f"{len(healthy.findings)} in {WORK_S / 60.0:.0f} min, {healthy.largest:.0%}",
        alarms=len(healthy.findings),
        largest=healthy.largest,
    )
    part = during(recording, 0.0, OBSERVED_S + FAULT_S)
    named = {}
    for sensor, (name, joint, fault) in FAULTS.items():
        wrong = compare(faulty(part, name, model.joints.index(joint), fault), model, tolerance)
        named[sensor] = [finding.sensor for finding in wrong.findings]
    right = sum(found[:1] == [sensor] for sensor, found in named.items())
    measured("sensor faults named", "", f"{right} of {len(FAULTS)}", right=right)
    assert not healthy.findings and not alone.findings
    assert right == len(FAULTS), named
