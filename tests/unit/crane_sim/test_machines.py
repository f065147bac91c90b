"""Every machine that ships with the suite, and others, as a simulated crane."""

import json
from pathlib import Path
from typing import Any, NamedTuple

import mujoco
import numpy as np
import pytest
import yaml

from crane_driver import DriverCodec, load_layout
from crane_machines import shipped
from crane_model import ConfigurationError, Machine, Record, load_machine, load_model, tip_position
from crane_model.hydraulics import ChamberValues, JointHydraulics, ValveValues
from crane_model.machine_files import machine_file
from crane_nodes.joint_notes import load_joint_notes
from crane_sim import (
    InjectedEffect,
    Plant,
    Sensors,
    SimulatedCrane,
    Spec,
    load_simulated_crane,
    record,
)
from crane_sim.drawing.scene import Scene
from crane_sim.effects.form import Where
from crane_sim.effects.sensing import faults
from crane_sim.ground_truth import check_joints, clean
from crane_sim.machine_on_bus import MachineOnBus
from crane_sim.parts.constants import pack_chain
from crane_sim.parts.mujoco_model import chain_positions, machine_spec
from crane_sim.parts.parameters import load_both
from crane_sim.parts.rigid_bodies import mass_and_bias
from crane_sim.plant.closed_loop import REST_S
from crane_sim.true_values import main as print_true_values
from crane_sim.true_values import true_parameters
from crane_trajectory import load_clearance, load_trajectory, plan
from crane_trajectory.control.controller import load_gains

MACHINES = shipped()
SLIDING = 5e-3  # rad/s, m/s; below it friction may hold with any force


class Made(NamedTuple):
    """A machine by its name, and its simulated crane."""

    name: str
    machine: Machine
    simulated: SimulatedCrane


@pytest.fixture(params=MACHINES)
def made(request: pytest.FixtureRequest) -> Made:
    return Made(request.param, *load_both(request.param, None))


def test_rigid_bodies_are_those_of_mujoco(made: Made) -> None:
    """Which moves every joint of the chain by itself: those that follow are led afterwards."""
    chain, model = pack_chain(made.simulated, made.machine), machine_spec(*made[:0:-1]).compile()
    data, joints = mujoco.MjData(model), len(made.machine.joint_names)
    leads = np.array([chain_positions(made.machine, row) for row in np.eye(joints)]).T
    rng = np.random.default_rng(4)
    mass, bias = np.empty((joints, joints)), np.empty(joints)
    theirs = np.empty((model.nv, model.nv))
    for q, v in rng.normal(size=(100, 2, joints)):
        mass_and_bias(chain, q, v, mass, bias)
        data.qpos[:], data.qvel[:] = leads @ q, leads @ v
        mujoco.mj_forward(model, data)
        mujoco.mj_fullM(model, data, theirs)
        np.testing.assert_allclose(mass, leads.T @ theirs @ leads, atol=1e-12 * mass.max())
        np.testing.assert_allclose(bias, leads.T @ data.qfrc_bias, atol=1e-12 * np.abs(bias).max())


def test_what_was_injected_explains_what_a_machine_needs(made: Made) -> None:
    """On its own excitation, by its own model: the bodies of the plant and those of the model are
    derived apart, and agree where all joints slide.
    """
    name, machine, simulated = made
    motion = plan(
        machine,
        load_trajectory(machine_file("excitation_20s.yaml", name)),
        simulated.start,
        1,
        load_clearance(machine_file("clearance.yaml", name)),
    )
    sensors = Sensors(simulated.sensors, machine, 1)
    gains = load_gains(machine_file("controller.yaml", name), machine)
    found = record(motion, Plant(simulated, machine, motion.start), sensors, gains)
    true = clean(machine, (), faults((), machine), found.truth)
    model = load_model(machine_file("model.yaml", name))
    columns = [machine.index(joint) for joint in model.joints]

    late = np.abs(found.reference.position - found.position).max(axis=0)
    notes = load_joint_notes(machine_file("joints.yaml", name), machine.units)
    assert (late < [notes[joint].tracking_tolerance for joint in machine.joint_names]).all(), late

    position, velocity, acceleration, drive = (
        values[:, columns]
        for values in (true.position, true.velocity, true.acceleration, true.drive)
    )
    seen = Record(
        joints=model.joints,
        time=true.time - REST_S,
        position=position,
        velocity=velocity,
        acceleration=acceleration,
    )
    theta = {entry.name: entry.value for entry in true_parameters(simulated, machine)}
    assert theta.keys() == {known.name for known in model.parameters}
    wanted = np.array([theta[known.name] for known in model.parameters])
    slides = (np.abs(velocity) > SLIDING).all(axis=1)
    regressor, drive = model.regressor(seen)[slides], drive[slides]
    assert slides.sum() * simulated.sensors.period > 5.0  # s
    left = drive - regressor @ wanted
    assert (np.sqrt(np.mean(left**2, axis=0)) < 4e-3 * np.sqrt(np.mean(drive**2, axis=0))).all()

    weight = 1.0 / np.sqrt(np.mean(drive**2, axis=0))
    stacked = (weight[:, np.newaxis] * regressor).reshape(-1, len(wanted))
    estimate, *_ = np.linalg.lstsq(stacked, (weight * drive).ravel(), rcond=None)
    for joint in model.joints:
        k = [known.name for known in model.parameters].index(f"f_c.{joint}")
        assert estimate[k] == pytest.approx(wanted[k], rel=0.03), joint


def test_a_machine_is_drawn_with_its_tip_where_it_is(made: Made) -> None:
    """And with the mass of its bodies alone."""
    scene = Scene(made.simulated, made.machine)
    assert scene.model.body_mass.sum() == pytest.approx(
        sum(body.mass for body in made.simulated.bodies.values())
    )
    low, high = (
        np.array([getattr(limits, f"position_{end}") for limits in made.machine.limits.values()])
        for end in ("min", "max")
    )
    pose = 0.7 * low + 0.3 * high
    scene.set_pose(pose)
    last = scene.data.body(f"{made.machine.joints[-1].name} link")
    tip = last.xpos + last.xmat.reshape(3, 3) @ made.machine.tool.matrix[:3, 3]
    np.testing.assert_allclose(tip, tip_position(made.machine, pose)[0], atol=1e-12)
    assert scene.data.ncon == 0


def test_a_machine_is_read_and_commanded_on_its_bus(made: Made) -> None:
    """By its own DBC file and mapping: every joint and every pressure that it measures."""
    name, machine, simulated = made
    layout = load_layout(machine, machine_file("can.yaml", name), machine_file("can.dbc", name))
    plant = Plant(simulated, machine, simulated.start)
    bus = MachineOnBus(layout, plant, Sensors(simulated.sensors, machine, 1), 0.0)
    driver, joint = DriverCodec(layout), machine.joint_names[-1]
    positions: dict[str, float] = {}
    pressures: dict[str, float] = {}
    now = 0.0
    for _ in range(150):
        frames = driver.command_frames({joint: 0.4}, enabled=True)
        answers = bus.exchange([frame._replace(steady=now) for frame in frames])
        now += bus.period
        bus.run(now)
        for read in filter(None, (driver.decode(one._replace(steady=now)) for one in answers)):
            positions |= read.positions
            pressures |= read.pressures
    assert positions.keys() == set(machine.joint_names)
    measured = {f"{one}.{ab}" for one in Where.ANY.joints(machine) for ab in "ab"}
    assert pressures.keys() == measured | {"supply", "tank"}
    assert positions[joint] > simulated.rest_pose[joint] + 0.02


def test_the_velocity_filter_is_as_the_driver_has_it(made: Made) -> None:
    """From the one place that says so."""
    notes = load_joint_notes(machine_file("joints.yaml", made.name), made.machine.units)
    assert made.simulated.jerk_density == {
        joint: note.jerk_density for joint, note in notes.items()
    }


def without_joint(content: dict[str, Any]) -> None:
    del content["friction"]["stick"]


def with_another(content: dict[str, Any]) -> None:
    content["rest_pose"]["telescope"] = 0.4


def on_no_link(content: dict[str, Any]) -> None:
    content["bodies"]["bucket"]["link"] = "grapple"


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            without_joint,
            "plant.yaml: key 'friction': no entry for stick; the machine has the joints sw",
        ),
        (
            with_another,
            "plant.yaml: key 'rest_pose': no joint telescope; the .* swing, boom, stick, b",
        ),
        (
            on_no_link,
            "plant.yaml: key 'bodies.bucket.link': no joint 'grapple'; small excavator has",
        ),
    ],
)
def test_a_simulated_crane_of_another_machine_is_refused_in_its_words(
    change: Any, message: str, tmp_path: Path
) -> None:
    content = yaml.safe_load(machine_file("simulated_crane.yaml", "excavator").read_text())
    change(content)
    path = tmp_path / "plant.yaml"
    path.write_text(yaml.safe_dump(content))
    with pytest.raises(ConfigurationError, match=message):
        load_simulated_crane(
            path, load_machine("excavator"), machine_file("joints.yaml", "excavator")
        )


def test_every_link_needs_a_body() -> None:
    machine, simulated = load_both("excavator", None)
    bodies = {name: body for name, body in simulated.bodies.items() if name != "stick"}
    with pytest.raises(ConfigurationError, match="key 'bodies': no body has the link stick"):
        pack_chain(simulated.model_copy(update={"bodies": bodies}), machine)


@pytest.mark.parametrize(
    ("effect", "message"),
    [
        ({"effect": "hose_mass"}, "a joint which slides: of small excavator, no such"),
        ({"effect": "slew_coupling"}, "first joint turns and is not measured: of small exc"),
        (
            {"effect": "pad_friction", "joint": "stick"},
            "that slides, .* small excavator, no",
        ),
        (
            {"effect": "stribeck", "joint": "telescope"},
            "stick, bucket; got 'telescope'",
        ),
    ],
)
def test_effects_are_refused_where_a_machine_has_no_place_for_them(
    effect: dict[str, Any], message: str
) -> None:
    spec = Spec(effects=(InjectedEffect(relative_magnitude=0.05, **effect),))
    with pytest.raises(ConfigurationError, match=message):
        check_joints(spec, load_machine("excavator"), "spec.yaml")


def test_its_hydraulics_are_printed_as_a_model_file_has_them(
    made: Made, capsys: pytest.CaptureFixture[str]
) -> None:
    """With the names of parameters, so that `identify` can show them beside what it finds."""
    assert print_true_values(["--machine", made.name, "--json"]) == 0
    printed = json.loads(capsys.readouterr().out)
    measured = [j for j, one in made.machine.cylinders.items() if one.pressure_sensors]
    names = [f"{name}.{joint}" for joint in measured for name in JointHydraulics.units]
    theta = {one.name: one.value for one in true_parameters(made.simulated, made.machine)}
    assert printed.items() >= theta.items()
    assert sorted(printed.keys() - theta.keys()) == sorted(names)
    for joint in measured:
        values = {name: printed[f"{name}.{joint}"] for name in JointHydraulics.units}
        for part in (ValveValues, ChamberValues):
            part(**{n: {"value": values[n], "unit": unit} for n, unit in part.units.items()})
