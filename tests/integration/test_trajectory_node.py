"""The trajectory node over driver and simulated crane: experiments that run, end early, or do not
begin."""

import math
import os
import signal
from collections.abc import Iterator

import numpy as np
import pytest
import yaml
from integration.driver_stage import Stage, made
from integration.experiments import MOVING, SHORT, TRAJECTORY, Experiments
from integration.processes import IMPATIENT
from laboratory_crane import JOINTS
from lifecycle_msgs.msg import Transition
from sensor_msgs.msg import JointState

from crane_interfaces.action import RunExcitation
from crane_nodes.managed import UNNAMED
from crane_trajectory import Outcome
from crane_trajectory.run_excitation_action import LONGEST_MESSAGE

ALIASES = "\n".join(f"x{i}: &x{i} [*x{i - 1}, *x{i - 1}]" for i in range(1, 20))
EXCITATION = RunExcitation.Feedback.EXCITATION


@pytest.fixture(scope="module")
def crane(stage: Stage, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Experiments]:
    folder = tmp_path_factory.mktemp("trajectory")
    one = Experiments(stage, folder, program=IMPATIENT + TRAJECTORY)
    yield one
    stage.end(one.process)


def test_a_goal_is_refused_while_the_driver_is_disabled(crane: Experiments) -> None:
    crane.stage.disabled()
    result = crane.refused()
    assert result.outcome == Outcome.NOT_READY
    assert "/driver: the driver is disabled; call enable" in result.message


def test_a_trajectory_outside_the_limits_is_refused(crane: Experiments) -> None:
    wild = crane.folder / "wild.yaml"
    joints = SHORT["joints"] | {"telescope": {"offset": 1.0, "sine": [0.8], "cosine": [0.0]}}
    wild.write_text(yaml.safe_dump(SHORT | {"joints": joints}))
    crane.stage.enabled()
    result = crane.refused(wild)
    assert result.outcome == Outcome.TRAJECTORY_REFUSED
    assert "telescope: position 1.8 m" in result.message
    assert "above the limit 1.55 m" in result.message


@pytest.mark.parametrize(
    ("file", "periods", "reason"),
    [
        ("absent.yaml", 1, "absent.yaml: no such file"),
        ("short.yaml", 0, "periods: must be at"),
        ("long" * 2000, 1, "trajectory: File name too long: /"),
    ],
    ids=["absent", "no periods", "long name"],
)
def test_a_goal_that_cannot_be_run_is_refused(
    file: str, periods: int, reason: str, crane: Experiments
) -> None:
    result = crane.refused(crane.folder / file, periods)
    assert result.outcome == Outcome.TRAJECTORY_REFUSED
    assert reason in result.message
    assert len(result.message) < LONGEST_MESSAGE + 50


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        (yaml.safe_dump(SHORT | {"period": 1e-9}), "line 23: key 'period': must be at least 1.0"),
        ("x0: &x0 [1, 1]\n" + ALIASES, "line 1: holds more than 200000 values"),
        ("name: " + "x" * 1_000_000, "must have at most 1000000 bytes"),
        ("".join(f"{'key' * 100}{i}: 1\n" for i in range(3000)), "characters left out) ..."),
    ],
    ids=["period", "aliases", "size", "keys"],
)
def test_a_file_that_would_take_the_machine_is_refused(
    text: str, reason: str, crane: Experiments
) -> None:
    hostile = crane.folder / "hostile.yaml"
    hostile.write_text(text)
    result = crane.refused(hostile)
    assert result.outcome == Outcome.TRAJECTORY_REFUSED
    assert reason in result.message
    assert len(result.message) < LONGEST_MESSAGE + 50


def test_while_a_file_is_read_the_node_answers(crane: Experiments) -> None:
    """Within the second that this one takes to be parsed, a goal is canceled."""
    long = crane.folder / "long.yaml"
    long.write_text(f"name: {[0.25] * 80_000}")

    def canceled() -> bool:
        """Unless this test was late by that second."""
        handle = crane.send(long)
        handle.cancel_goal_async()
        result = crane.result(handle)
        return (result.outcome, result.message) == (Outcome.CANCELED, "canceled, nothing has moved")

    crane.stage.until(canceled)


def test_an_experiment_is_completed(crane: Experiments) -> None:
    result = crane.ended(Outcome.COMPLETED)
    assert list(result.name) == list(JOINTS)
    rms = np.array(result.rms_tracking_error)
    assert rms[0] < 0.005  # slew is held
    assert (rms[1:] > 1e-4).all()
    assert (rms < [0.005, 0.05, 0.1, 0.05]).all()
    crane.holds_still()
    crane.stage.until(lambda: {one.phase for one in crane.feedback} == {1, 2, 3})
    assert [one.phase for one in crane.feedback] == sorted(one.phase for one in crane.feedback)
    stamps = np.array([made(one) for one in crane.references])
    position = np.array([one.position for one in crane.references])
    velocity = np.array([one.velocity for one in crane.references])
    assert (np.diff(stamps) > 0.0).all()
    change = np.diff(position, axis=0) - velocity[1:] * np.diff(stamps)[:, None]
    assert np.abs(change).max() < 2e-3  # the reference is continuous
    assert np.ptp(position[:, 0]) == 0.0
    assert crane.stage.report()[0] == "enabled"  # commands that end at neutral leave no fault


def test_canceled_the_crane_comes_to_rest_and_holds_still(crane: Experiments) -> None:
    handle = crane.moving()
    handle.cancel_goal_async()
    result = crane.result(handle)
    assert not any(one.phase == EXCITATION for one in crane.feedback)
    assert (result.outcome, result.message) == (
        Outcome.CANCELED,
        "canceled, the crane is at rest",
    )
    assert all(math.isnan(one) for one in result.rms_tracking_error)
    crane.holds_still()


def test_a_second_goal_is_refused_and_the_first_goes_on(crane: Experiments) -> None:
    first = crane.moving()
    second = crane.result(crane.send())
    assert second.outcome == Outcome.NOT_READY
    assert second.message == "another goal runs; cancel it first"
    assert crane.stage.node.count_publishers("/valve_command") == 1
    first.cancel_goal_async()
    assert crane.result(first).outcome == Outcome.CANCELED


def test_joint_states_of_somebody_else_end_it_and_are_refused(crane: Experiments) -> None:
    """A bag that is played back beside the driver, say; ROS may not know its name yet."""
    node = crane.stage.node
    handle = crane.moving()
    other = node.create_publisher(JointState, "/joint_states", 1)
    try:
        lost, refused = crane.result(handle), crane.refused()
    finally:
        node.destroy_publisher(other)
    assert (lost.outcome, refused.outcome) == (Outcome.STATES_LOST, Outcome.NOT_READY)
    for result in (lost, refused):
        said = [f"driver, {name} publish /joint_states" for name in (node.get_name(), UNNAMED)]
        assert any(one in result.message for one in said), result.message
    crane.stage.until(lambda: node.count_publishers("/joint_states") == 1)


def test_parameters_change_while_the_crane_moves_where_that_is_safe(crane: Experiments) -> None:
    handle = crane.moving()
    assert crane.set("gains.outer_boom.kp", 5.0) == (True, "")
    for name, value, reason in (
        ("gains.outer_boom.kp", -1.0, "gains.outer_boom.kp out of range Min: 1e-06, Max: 1000.0"),
        ("gains.outer_boom.kp", 100.0, "kp times position_tolerance is 0.4, more than dead_band"),
        ("saturation", 2.0, "saturation out of range Min: 0.01, Max: 1.0, value: 2.0"),
        ("clearance", "x.yaml", "parameter 'clearance' is read when the node is configured"),
        ("machine", "x.yaml", "read-only parameter: machine"),
    ):
        done, why = crane.set(name, value)
        assert not done
        assert reason in why, why
    assert crane.set("tracking_tolerance.outer_boom", 1e-4) == (True, "")
    result = crane.result(handle)
    assert crane.set("tracking_tolerance.outer_boom", 0.2) == (True, "")
    assert crane.set("gains.outer_boom.kp", 4.0) == (True, "")
    assert result.outcome == Outcome.TRACKING_LOST
    assert "outer_boom: tracking error" in result.message
    assert "is beyond the tolerance 0.0001 rad" in result.message
    crane.holds_still()


def test_deactivated_the_crane_comes_to_rest_and_does_not_jump_after(crane: Experiments) -> None:
    handle = crane.moving()
    crane.change(Transition.TRANSITION_DEACTIVATE)
    result = crane.result(handle)
    assert result.outcome == Outcome.DEACTIVATED
    crane.holds_still()
    assert "the node is inactive" in crane.refused().message
    before = crane.position
    crane.change(Transition.TRANSITION_ACTIVATE)
    crane.holds_still()
    assert np.abs(crane.position - before).max() < 0.01
    crane.moving().cancel_goal_async()
    crane.holds_still()


def test_a_fault_of_the_driver_ends_the_experiment(crane: Experiments) -> None:
    handle = crane.moving()
    crane.stage.call("emergency_stop")
    result = crane.result(handle)
    assert result.outcome == Outcome.DRIVER_FAULT
    assert "emergency stop" in result.message
    crane.holds_still()


def test_lost_states_end_the_experiment(crane: Experiments) -> None:
    handle = crane.moving()
    os.kill(crane.stage.driver.pid, signal.SIGSTOP)
    try:
        result = crane.result(handle)
    finally:
        os.kill(crane.stage.driver.pid, signal.SIGCONT)
    assert result.outcome == Outcome.STATES_LOST
    assert "limit " in result.message
    crane.stage.until(lambda: crane.speed() < MOVING)
    crane.holds_still()


def test_ended_by_a_signal_the_crane_is_at_rest_first(crane: Experiments) -> None:
    handle = crane.moving()
    ending = handle.get_result_async()
    crane.process.send_signal(signal.SIGTERM)
    crane.stage.until(ending.done)
    assert ending.result().result.outcome == Outcome.DEACTIVATED
    assert crane.stage.end(crane.process) == 0
    crane.holds_still()
    assert crane.stage.report()[0] == "enabled"
