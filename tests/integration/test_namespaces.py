"""Cranes in namespaces: several in one ROS domain, each with its own topics, services and bags."""

import signal
from contextlib import ExitStack, closing
from pathlib import Path
from subprocess import Popen

import numpy as np
import pytest
import rclpy
from integration.driver_stage import Stage, commander
from integration.processes import RUN, end, start
from integration.test_manual_nodes import INHERITED, NODES
from rclpy.lifecycle import LifecycleNode, TransitionCallbackReturn
from rclpy.node import Node

from crane_identification import read_bag

RECORDER = RUN.format(module="crane_nodes.recording.recorder_node")
TRAVEL = 0.02  # rad
SHARED = {"/diagnostics"}  # by all nodes of a domain; names of statuses begin with the node's
READY = {
    "trajectory": "ready: listens to /left/driver/state, /left/joint_states, "
    "/left/trajectory/joint_trajectory; publishes /left/joint_reference, /diagnostics; serves "
    "/left/trajectory/save_learnt, /left/run_excitation",
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


def recording(crane: Stage, bag: Path, *topics: str) -> Popen[str]:
    """A recorder that hears these topics of a crane."""
    space = crane.node.get_namespace()
    recorder = start(RECORDER, "--out", str(bag), *crane.ros())

    def heard() -> bool:
        """As it reports."""
        _, _, values = crane.diagnostics.get(f"{space[1:]}/recorder: {bag.name}", (b"", "", {}))
        return all(int(values.get(f"{space}/{topic} messages", "0")) for topic in topics)

    crane.until(heard)
    return recorder


def activate(node: Node) -> None:
    assert isinstance(node, LifecycleNode)
    for transition in (node.trigger_configure, node.trigger_activate):
        assert transition() is TransitionCallbackReturn.SUCCESS


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
            one = Stage(folder, [], namespace=name)
            cranes.append(stack.enter_context(closing(one)))
        left, right = cranes
        of_left, of_right = (stack.enter_context(commander(one)) for one in cranes)
        bag = tmp_path / "bag"
        recorder = recording(left, bag, "joint_states", "valve_command")
        stack.callback(end, recorder)
        for moved, still, mover, other in (
            (left, right, of_left, of_right),
            (right, left, of_right, of_left),
        ):
            other.send(slew=0.0)
            still.enabled()
            begin, before, frames = newest(moved), newest(still), len(still.valves)

            def there(moved: Stage = moved, still: Stage = still, begin: float = begin[1]) -> bool:
                still.spin()  # its time goes on, too
                return bool(moved.states[-1].position[1] - begin >= TRAVEL)

            moved.moved(mover, there, inner_boom=0.3)
            mover.send(slew=0.0)
            still.until(lambda: len(still.valves) > frames + 20)  # noqa: B023
            assert np.abs(newest(still) - before).max() < TRAVEL
            assert not any(any(one.commands.values()) for one in still.valves[frames:])
            moved.disabled()
        said = capfd.readouterr().err
        for one in ("left", "right"):
            heard = f"/{one}/lock_step, /{one}/valve_command, /{one}/sensor_findings"
            assert f"[{one}.driver]: ready: listens to {heard}; publishes " in said
        assert left.end(recorder, signal.SIGINT) == 0
    log = read_bag(bag, ["inner_boom"])
    assert log.position.origin == "/left/joint_states"
    assert np.ptp(log.position.value[:, 0]) >= TRAVEL
    assert log.command is not None
