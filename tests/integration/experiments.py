"""The trajectory node as a process over driver and simulated crane, and what it says."""

import subprocess
from pathlib import Path
from typing import Any
from uuid import uuid4

import numpy as np
import yaml
from integration.driver_stage import Stage, made
from integration.matched import wait_until_heard
from integration.processes import RUN, start
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue
from rcl_interfaces.srv import SetParameters
from rclpy.action import ActionClient
from unique_identifier_msgs.msg import UUID

from crane_interfaces.action import RunExcitation
from crane_interfaces.msg import JointReference, ValveCommand
from crane_trajectory import Outcome

Feedback = RunExcitation.Impl.FeedbackMessage
TRAJECTORY = RUN.format(module="crane_trajectory.trajectory_node")
PERIOD = 5.0  # s
SHORT = {
    "name": "short",
    "period": PERIOD,
    "joints": {
        "inner_boom": {"offset": 0.35, "sine": [0.06], "cosine": [0.02]},
        "outer_boom": {"offset": -1.5, "sine": [0.0, 0.06], "cosine": [0.1, 0.0]},
        "telescope": {"offset": 0.4, "sine": [0.1], "cosine": [0.05]},
    },
}
MOVING = 0.03  # rad/s, m/s
LONG = 10  # periods, so that a goal does not end by itself


class Experiments:
    """The node under test, and what it says."""

    def __init__(
        self,
        stage: Stage,
        folder: Path,
        *arguments: str,
        trajectory: dict[str, Any] = SHORT,
        program: str = TRAJECTORY,
    ):
        """`arguments` are ROS arguments of the node."""
        self._program = program
        self.stage, self.folder, self.arguments = stage, folder, arguments
        self.file = folder / "short.yaml"
        self.file.write_text(yaml.safe_dump(trajectory))
        self.references: list[JointReference] = []
        self.commands: list[ValveCommand] = []
        self.feedback: list[Any] = []
        node = stage.node
        stage.listen(JointReference, "/joint_reference", self.references.append)
        stage.listen(ValveCommand, "/valve_command", self.commands.append)
        # The action client drops what it has not taken by the time of the result.
        stage.listen(Feedback, "/run_excitation/_action/feedback", self._told)
        self._goal = UUID()
        self.action = ActionClient(node, RunExcitation, "/run_excitation")
        self._set = node.create_client(SetParameters, "/trajectory/set_parameters")
        self._change = node.create_client(ChangeState, "/trajectory/change_state")
        self.process: subprocess.Popen[str]
        self.begin()

    def begin(self) -> None:
        self.process = start(self._program, *self.stage.ros(*self.arguments))
        for ready in (self.action.server_is_ready, self._set.service_is_ready):
            self.stage.until_there(ready)
        self.stage.until_there(self._change.service_is_ready)
        wait_until_heard(self.stage.node, "/trajectory", self.stage.until_there)
        self.stage.disabled()
        self.stage.until(lambda: "the driver is disabled" in self.refused().message)  # it hears it

    def send(self, file: Path | None = None, periods: int = 1) -> Any:
        """A goal; its handle. `feedback` is that of the newest goal."""
        request = RunExcitation.Goal(trajectory=str(file or self.file), periods=periods)
        self.feedback = []  # what comes late of the goal before does not get into it
        self._goal = UUID(uuid=list(uuid4().bytes))
        sent = self.action.send_goal_async(request, goal_uuid=self._goal)
        self.stage.until(sent.done)
        assert sent.result().accepted
        return sent.result()

    def _told(self, message: Feedback) -> None:
        if bytes(message.goal_id.uuid) == bytes(self._goal.uuid):
            self.feedback.append(message.feedback)

    def result(self, handle: Any) -> RunExcitation.Result:
        ending = handle.get_result_async()
        self.stage.until(ending.done)
        return ending.result().result

    def ended(
        self, outcome: Outcome, file: Path | None = None, periods: int = 1
    ) -> RunExcitation.Result:
        """The result of a goal that ends so, and alone in `commands` and `references`."""
        self.stage.enabled()
        self.commands.clear()
        self.references.clear()
        result = self.result(self.send(file, periods))
        assert result.outcome == outcome, f"{Outcome(result.outcome).name}: {result.message}"
        return result

    def refused(self, file: Path | None = None, periods: int = 1) -> RunExcitation.Result:
        """The result of a goal that must not move anything, however long it takes to be refused."""
        self.stage.spin()  # takes what was sent before
        since, asked = len(self.stage.valves), self.stage.now
        result = self.result(self.send(file, periods))
        assert not any(any(one.commands.values()) for one in self.stage.valves[since:])
        assert not any(np.any(one.command) for one in self.commands if made(one) > asked)
        return result

    def moving(self) -> Any:
        """The handle of a goal under which the crane moves."""
        self.stage.enabled()
        handle = self.send(periods=LONG)
        self.stage.measured(lambda _: self.speed() > MOVING)
        return handle

    def largest_step(self) -> float:
        """Of a command from cycle to cycle."""
        moving = np.array([one.command for one in self.commands])
        return float(np.abs(np.diff(moving, axis=0)).max())

    def speed(self) -> float:
        return float(np.abs(self.stage.states[-1].velocity).max())

    @property
    def position(self) -> np.ndarray:
        return np.array(self.stage.states[-1].position)

    def holds_still(self) -> None:
        """No publisher of commands; then, for half a second, nothing moves or creeps."""
        self.stage.until(lambda: self.stage.node.count_publishers("/valve_command") == 0)
        gone = self.stage.now

        def still() -> bool:
            last = self.stage.states[-100:]
            way = np.ptp([one.position for one in last], axis=0)
            return made(last[0]) > gone and self.speed() < MOVING and way.max() < 0.01

        self.stage.until(still)

    def set(self, name: str, value: float | str) -> tuple[bool, str]:
        given = (
            ParameterValue(type=ParameterType.PARAMETER_STRING, string_value=value)
            if isinstance(value, str)
            else ParameterValue(type=ParameterType.PARAMETER_DOUBLE, double_value=value)
        )
        request = SetParameters.Request(parameters=[Parameter(name=name, value=given)])
        future = self._set.call_async(request)
        self.stage.until(future.done)
        (answer,) = future.result().results
        return answer.successful, answer.reason

    def change(self, transition: int) -> None:
        assert self.tries(transition)

    def tries(self, transition: int) -> bool:
        request = ChangeState.Request(transition=Transition(id=transition))
        future = self._change.call_async(request)
        self.stage.until(future.done)
        return future.result().success
