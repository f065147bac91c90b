"""The robot_state_publisher of ROS with the URDF of the driver: transforms of the whole crane."""

import json
import os
import signal
import sys
import time
from collections.abc import Callable
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest
import rclpy
from ament_index_python.packages import PackageNotFoundError, get_package_prefix
from geometry_msgs.msg import Transform
from integration.processes import PATIENCE, RUN, end, start
from rclpy.qos import QoSProfile
from sensor_msgs.msg import JointState
from std_msgs.msg import String

from crane_machines import shipped
from crane_model import forward_kinematics, load_machine
from crane_model.urdf import urdf
from crane_nodes.driver_client import LATCHED

PROGRAM = RUN.format(module="crane_nodes.robot_state_publisher")
POSES = 20
SPACING = 0.1  # s between stamps: it publishes at 20 Hz at most
QUOTED = 'a "quote": {x: 1}  # no comment\n\t- \\n ünder'
STAND_IN = f"""#!{sys.executable}
import json, sys, rclpy
rclpy.init(args=sys.argv)
node = rclpy.create_node("by_another_name")
given = [node.declare_parameter(name, "").value for name in ("robot_description", "frame_prefix")]
own = node.resolve_topic_name("robot_description")
open(sys.argv[0] + ".json", "w").write(json.dumps([*given, node.get_fully_qualified_name(), own]))
"""


class Crane:
    """A driver as far as its URDF and joint states go, and what comes of them."""

    def __init__(self, domain: int, namespace: str, description: str):
        rclpy.init(domain_id=domain)
        self.node = rclpy.create_node("driver", namespace=namespace)
        publisher = self.node.create_publisher(String, "robot_description", LATCHED)
        publisher.publish(String(data=description))
        self.states = self.node.create_publisher(JointState, "joint_states", 10)

    def until(self, condition: Callable[[], bool]) -> None:
        deadline = time.monotonic() + PATIENCE
        while not condition():
            assert time.monotonic() < deadline
            rclpy.spin_once(self.node, timeout_sec=0.01)

    def close(self) -> None:
        self.node.destroy_node()
        rclpy.shutdown()


@pytest.fixture(params=["", "/left"], ids=["alone", "left"])
def namespace(request: pytest.FixtureRequest) -> str:
    return str(request.param)


def started(namespace: str) -> list[str]:
    return ["--ros-args", "-r", f"__ns:={namespace}"] if namespace else []


def test_it_is_given_the_urdf_and_the_namespace(
    namespace: str, ros_domain: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As ROS then reads them; a stand-in for the program writes down what it was given."""
    (index := tmp_path / "share/ament_index/resource_index/packages").mkdir(parents=True)
    (index / "robot_state_publisher").touch()
    program = tmp_path / "lib/robot_state_publisher/robot_state_publisher"
    program.parent.mkdir(parents=True)
    program.write_text(STAND_IN)
    program.chmod(0o755)
    prefixes = f"{tmp_path}{os.pathsep}{os.environ['AMENT_PREFIX_PATH']}"
    monkeypatch.setenv("AMENT_PREFIX_PATH", prefixes)
    with closing(Crane(ros_domain, namespace, QUOTED)) as crane:
        process = start(PROGRAM, *started(namespace))
        crane.until(lambda: process.poll() is not None)
    assert process.returncode == os.EX_OK
    name = f"{namespace}/by_another_name"
    prefix = "left/" if namespace else ""
    given = json.loads(program.with_name(f"{program.name}.json").read_text())
    assert given == [QUOTED, prefix, name, f"{name}/robot_description"]


def test_where_there_is_none_it_says_so(ros_domain: int, capfd: pytest.CaptureFixture[str]) -> None:
    if _real():
        pytest.skip("there is one")
    assert start(PROGRAM).wait(PATIENCE) == 1
    assert "apt install ros-jazzy-robot-state-publisher" in capfd.readouterr().err


@pytest.mark.parametrize("name", shipped())
def test_the_tip_is_where_the_model_has_it_at_any_pose(
    name: str, namespace: str, ros_domain: int
) -> None:
    if _real() is None:
        pytest.skip("no robot_state_publisher here: ROS as Python packages comes without it")
    from tf2_msgs.msg import TFMessage

    machine = load_machine(name)
    low = np.array([machine.limits[joint].position_min for joint in machine.joint_names])
    high = np.array([machine.limits[joint].position_max for joint in machine.joint_names])
    poses = low + (high - low) * np.random.default_rng(1).random((POSES, len(low)))
    frames: dict[float, dict[str, tuple[str, np.ndarray]]] = {}

    def take(message: TFMessage) -> None:
        for one in message.transforms:
            stamp = one.header.stamp.sec + one.header.stamp.nanosec / 1e9
            found = frames.setdefault(round(stamp, 3), {})
            found[one.child_frame_id] = (one.header.frame_id, matrix(one.transform))

    with closing(Crane(ros_domain, namespace, urdf(machine))) as crane:
        crane.node.create_subscription(TFMessage, "/tf", take, 100)
        latched = QoSProfile(depth=10, durability=LATCHED.durability)
        static: list[TFMessage] = []
        crane.node.create_subscription(TFMessage, "/tf_static", static.append, latched)
        process = start(PROGRAM, *started(namespace))
        try:
            crane.until(lambda: bool(static) and crane.states.get_subscription_count() == 1)
            crane.until(lambda: crane.node.count_publishers("/tf") == 1)
            for i, pose in enumerate(poses):
                message = JointState(name=list(machine.joint_names), position=list(pose))
                stamp = round(1000.0 + i * SPACING, 3)
                message.header.stamp.sec = int(stamp)
                message.header.stamp.nanosec = round((stamp % 1) * 1e9)
                crane.states.publish(message)
                crane.until(lambda: stamp in frames)  # noqa: B023
        finally:
            end(process, signal.SIGINT)
    (fixed,) = (one for message in static for one in message.transforms)
    prefix = "left/" if namespace else ""
    tips = forward_kinematics(machine, poses)
    assert len(frames) == POSES
    for found, tip in zip((frames[stamp] for stamp in sorted(frames)), tips, strict=True):
        assert set(found) == {f"{prefix}{joint.name}" for joint in machine.joints}
        tree = found | {fixed.child_frame_id: (fixed.header.frame_id, matrix(fixed.transform))}
        pose = placed(tree, f"{prefix}tip", f"{prefix}base_link")
        np.testing.assert_allclose(pose, tip, atol=1e-9)


def placed(found: dict[str, tuple[str, np.ndarray]], frame: str, base: str) -> np.ndarray:
    """The pose of a frame in the base's, by the chain of its parents."""
    pose = np.eye(4)
    while frame != base:
        frame, transform = found[frame]
        pose = transform @ pose
    return pose


def matrix(transform: Transform) -> np.ndarray:
    x, y, z, w = (getattr(transform.rotation, axis) for axis in "xyzw")
    result = np.eye(4)
    result[:3, :3] = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    result[:3, 3] = transform.translation.x, transform.translation.y, transform.translation.z
    return result


def _real() -> str | None:
    """Where the program of ROS is installed."""
    try:
        return str(get_package_prefix("robot_state_publisher"))
    except PackageNotFoundError:
        return None
