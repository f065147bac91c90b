"""Cranes in namespaces: several in one ROS domain, each with its own topics, services and bags."""

import signal
from contextlib import ExitStack, closing
from pathlib import Path
from subprocess import Popen

import numpy as np
import pytest
import rclpy
from integration.driver_stage import Stage, commander
from integration.patient_files import patient_safety
from integration.processes import RUN, end, start
from integration.test_manual_nodes import INHERITED, NODES
from rclpy.lifecycle import LifecycleNode, TransitionCallbackReturn
from rclpy.node import Node

from crane_identification.data.bag_log import read_bag

RECORDER = RUN.format(module="crane_nodes.recording.recorder")
BAGS = ("bag", "next_bag", "last_bag")
HEARD = 60.0  # s; a busy computer takes 20 to start a recorder and to tell what it hears
TRAVEL = 0.02  # rad
SHARED = {"/diagnostics"}  # by all nodes of a domain; names of statuses begin with the node's
READY = {
    "trajectory": "ready: listens to /left/driver/state, /left/joint_states; publishes "
    "/left/joint_reference, /diagnostics; serves /left/trajectory/save_learnt, "
    "/left/run_excitation",
    "identification": "ready: listens to /left/joint_states, /left/cylinder_pressures; publishes "
    "/diagnostics, /left/parameter_estimate, /left/generalized_forces; serves "
    "/left/identification/reset_estimator, /left/identification/save_model",
}


@pytest.mark.parametrize("name", NODES)
def test_all_names_of_a_node_are_in_its_namespace(
    name: str, ros_domain: int, capfd: pytest.CaptureFixture[str]
) -> None:
    rclpy.init(args=["--ros-args", "-r", "__ns:=/left"], domain_id=ros_domain)
    node = NODES[name]()
    if name in READY:
        activate(node)
        assert f"[left.{name}]: {READY[name]}" in capfd.readouterr().err
    topics = {one.topic_name for one in (*node.publishers, *node.subscriptions)}
    services = {one.service_name for one in (*node.services, *node.clients)}
    assert {one for one in topics | services if not one.startswith("/left/")} <= SHARED | INHERITED
    node.destroy_node()
    rclpy.shutdown()


def newest(crane: Stage) -> np.ndarray:
    """Positions (4,) that are measured after this call [rad, m]."""
    return np.array(crane.measured().position)


def recording(crane: Stage, folder: Path, *topics: str) -> tuple[Popen[str], Path]:
    """A recorder that hears these topics of a crane, and its bag.

    It is started again, as it tells to, where it does not hear one that others hear: ROS may fail
    to bring the two together on a busy test machine.
    """
    space = crane.node.get_namespace()
    for name in BAGS:
        recorder = start(RECORDER, "--out", str(folder / name), "--ros-args", *crane.remapping)

        def heard(name: str = name) -> bool:
            """As it reports."""
            _, _, values = crane.diagnostics.get(f"{space[1:]}/recorder: {name}", (b"", "", {}))
            return all(int(values.get(f"{space}/{topic} messages", "0")) for topic in topics)

        if crane.within(heard, HEARD):
            return recorder, folder / name
        end(recorder)
    raise AssertionError(f"{topics} not recorded: {crane.diagnostics}")


def activate(node: Node) -> None:
    assert isinstance(node, LifecycleNode)
    for transition in (node.trigger_configure, node.trigger_activate):
        assert transition() is TransitionCallbackReturn.SUCCESS


@pytest.mark.realtime
def test_two_cranes_run_side_by_side(
    ros_domain: int, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """Each is moved while the other, enabled and commanded neutral, stands still; a recorder beside
    the left one records that one alone, and its bag is read like any other.
    """
    with ExitStack() as stack:
        cranes = []
        for name in ("left", "right"):
            (folder := tmp_path / name).mkdir()
            safety = patient_safety(folder)
            one = Stage(folder, [], namespace=name, safety=safety)
            cranes.append(stack.enter_context(closing(one)))
        left, right = cranes
        of_left, of_right = (stack.enter_context(commander(one)) for one in cranes)
        recorder, bag = recording(left, tmp_path, "joint_states", "valve_command")
        stack.callback(end, recorder)
        for moved, still, mover, other in (
            (left, right, of_left, of_right),
            (right, left, of_right, of_left),
        ):
            other.send(slew=0.0)
            still.enabled()
            begin, before, frames = newest(moved), newest(still), len(still.valves)
            moved.moved(
                mover,
                lambda: moved.states[-1].position[1] - begin[1] >= TRAVEL,  # noqa: B023
                inner_boom=0.3,
            )
            mover.send(slew=0.0)
            # it sinks by leakage alone, the further the longer a slow computer takes for this
            assert np.abs(newest(still) - before).max() < TRAVEL
            assert not any(any(one.commands.values()) for one in still.valves[frames:])
            moved.disabled()
        said = capfd.readouterr().err
        for one in ("left", "right"):
            heard = f"/{one}/valve_command, /{one}/sensor_findings"
            assert f"[{one}.driver]: ready: listens to {heard}; publishes " in said
        assert end(recorder, signal.SIGINT) == 0
    log = read_bag(bag, ["inner_boom"])
    assert log.position.origin == "/left/joint_states"
    assert np.ptp(log.position.value[:, 0]) >= TRAVEL
    assert log.command is not None
