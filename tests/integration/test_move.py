"""Motions other than excitation: joint trajectories from a topic, paths of the tip by `move`."""

from collections.abc import Iterator

import numpy as np
import pytest
from integration.driver_stage import Stage
from integration.experiments import Experiments
from integration.processes import RUN, start
from laboratory_crane import JOINTS
from rclpy.publisher import Publisher
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from crane_model import load_machine, tip_position

MOVE = RUN.format(module="crane_trajectory.move_node")
TOPIC = "/trajectory/joint_trajectory"
OFF = 0.03  # m, of a tip that the PD controller has brought to rest
MOVING = 0.02  # rad/s, m/s
BOOM = JOINTS.index("inner_boom")


@pytest.fixture(scope="module")
def crane(stage: Stage, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Experiments]:
    found = Experiments(stage, tmp_path_factory.mktemp("move"))
    yield found
    stage.end(found.process)


@pytest.fixture
def sender(crane: Experiments) -> Iterator[Publisher]:
    publisher = crane.stage.node.create_publisher(JointTrajectory, TOPIC, 10)
    crane.stage.until_there(lambda: publisher.get_subscription_count() == 1)
    yield publisher
    crane.stage.node.destroy_publisher(publisher)


def message(joints: dict[str, float], seconds: float, **derivatives: float) -> JointTrajectory:
    point = JointTrajectoryPoint(positions=list(joints.values()))
    for name, value in derivatives.items():
        setattr(point, name, [value] * len(joints))
    point.time_from_start.sec = int(seconds)
    point.time_from_start.nanosec = round(seconds % 1.0 * 1e9)
    return JointTrajectory(joint_names=list(joints), points=[point])


def last_result(crane: Experiments) -> str:
    _, _, values = crane.stage.diagnostics.get("trajectory: experiment", (b"", "", {}))
    return values.get("last result", "")


def sent(crane: Experiments, sender: Publisher, wanted: JointTrajectory) -> None:
    crane.stage.enabled()
    crane.references.clear()
    sender.publish(wanted)


def test_a_joint_trajectory_is_followed_to_its_last_point(
    crane: Experiments, sender: Publisher
) -> None:
    before = np.array(crane.stage.measured().position)
    goal = {"outer_boom": before[2] + 0.15, "inner_boom": before[1] - 0.1}
    sent(crane, sender, message(goal, 4.0))
    crane.stage.until(lambda: "COMPLETED: the motion has been run" in last_result(crane))
    after = np.array(crane.stage.measured().position)
    wanted = before + [0.0, -0.1, 0.15, 0.0]
    np.testing.assert_allclose(after, wanted, atol=0.01)
    references = np.array([reference.position for reference in crane.references])
    np.testing.assert_allclose(references[-1], wanted, atol=1e-3)
    crane.holds_still()


def moving(crane: Experiments, sender: Publisher) -> None:
    here = crane.stage.measured().position[BOOM]
    far = here + (0.6 if here < 0.4 else -0.6)
    sent(crane, sender, message({"inner_boom": far}, 12.0))
    crane.stage.until(lambda: abs(crane.stage.states[-1].velocity[BOOM]) > MOVING)


def test_an_empty_joint_trajectory_ends_the_motion(crane: Experiments, sender: Publisher) -> None:
    moving(crane, sender)
    sender.publish(JointTrajectory())
    crane.stage.until(
        lambda: last_result(crane) == "CANCELED: ended by an empty trajectory, the crane is at rest"
    )
    crane.holds_still()


def test_the_motion_ends_at_rest_when_its_sender_is_gone(crane: Experiments) -> None:
    publisher = crane.stage.node.create_publisher(JointTrajectory, TOPIC, 10)
    crane.stage.until_there(lambda: publisher.get_subscription_count() == 1)
    moving(crane, publisher)
    crane.stage.node.destroy_publisher(publisher)
    crane.stage.until(
        lambda: last_result(crane) == "CANCELED: its sender is gone, the crane is at rest"
    )
    crane.holds_still()


@pytest.mark.parametrize(
    ("wanted", "reason"),
    [
        (message({"elbow": 0.1}, 3.0), "no position of ['elbow']"),
        (message({"inner_boom": 0.5}, 0.0), "at least 2 entries"),
        (message({"inner_boom": 0.5}, 3.0, velocities=0.1), "at the last point, got 0 and 0.1"),
        (message({"telescope": 9.0}, 60.0), "telescope: position 9 m"),
        (message({"inner_boom": 0.5}, 0.05), "above the limit"),
    ],
)
def test_a_wrong_joint_trajectory_moves_nothing(
    crane: Experiments, sender: Publisher, wanted: JointTrajectory, reason: str
) -> None:
    sent(crane, sender, wanted)
    crane.stage.until(lambda: reason in last_result(crane))
    assert last_result(crane).startswith("TRAJECTORY_REFUSED: ")
    crane.holds_still()


def test_move_takes_the_tip_where_it_is_told_to(crane: Experiments) -> None:
    machine = load_machine()
    crane.stage.disabled()
    here = tip_position(machine, np.array([crane.stage.measured().position]))[0]
    rise = ("--relative", "--to", "0.2", "0", "0.3", "--speed", "0.15", "--run", "--enable")
    process = start(MOVE, *rise, *crane.stage.ros())
    crane.stage.until(lambda: process.poll() is not None)
    assert process.stdout is not None
    told = process.stdout.read()
    assert process.returncode == 0, told
    assert "0.361 m in" in told and "COMPLETED: the motion has been run" in told
    there = tip_position(machine, np.array([crane.stage.measured().position]))[0]
    assert np.linalg.norm(there - here - [0.2, 0.0, 0.3]) < OFF
