"""The running driver as a bring-up sees it: samples in, and one valve commanded at a time."""

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from typing import Any

import numpy as np
from rcl_interfaces.srv import GetParameters
from rclpy.node import Node
from rclpy.parameter import parameter_value_to_python
from rclpy.publisher import Publisher
from rclpy.task import Future
from sensor_msgs.msg import JointState

from crane_driver import constants
from crane_driver.operator.bringup.estimates import JointInstant
from crane_driver.operator.bringup.motion import MotionError, StoppedError, Tick
from crane_interfaces.msg import CylinderPressures, DriverState, ValveCommand
from crane_model.errors import DataError
from crane_nodes.driver_client import DriverClient, NoDriverError
from crane_nodes.executor import KeptExecutor
from crane_nodes.managed import Stop, say_ready
from crane_nodes.node_time import NodeTime, nanoseconds

SAMPLES_DEPTH = 50  # messages


class CraneClient(Node):
    """One thread: whoever waits, spins."""

    def __init__(self, stop: Stop):
        super().__init__("bringup")
        self._stop = stop
        self._executor = KeptExecutor()
        self._executor.add_node(self)
        self.time = NodeTime(self)
        self.time.listen()
        self.patience = self.time.patience(constants.DRIVER_ANSWER_TIMEOUT_S)
        self.joints: tuple[str, ...] = ()
        self.samples: list[JointInstant] = []
        self.pressures: list[dict[str, float]] = []
        self._received = -np.inf
        self.trouble = ""  # why the driver has stopped the crane
        self._refused: int | None = None  # commands, as the driver has told since it was enabled
        subscribe = self.create_subscription
        states = subscribe(JointState, "joint_states", self._joint_state, SAMPLES_DEPTH)
        cylinders = subscribe(
            CylinderPressures, "cylinder_pressures", self._cylinder_pressures, SAMPLES_DEPTH
        )
        self._states, self._cylinders = states.topic_name, cylinders.topic_name
        self._driver = DriverClient(self, self._told)

    def spin(self, seconds: float) -> None:
        end = self.time.now() + seconds
        while (left := end - self.time.now()) > 0.0:
            self._executor.spin_once(timeout_sec=min(left, constants.LONGEST_SPIN_S))

    def connect(self) -> None:
        """Wait for the driver and its joints; `DataError` if it is not there."""
        self._until(
            lambda: self.samples and self._driver.ready,
            f"no {self._states} and no driver/state come; start the driver, with the bus and the "
            "files of this crane (-p bus.interface, bus.channel, machine, dbc, mapping, safety)",
        )
        say_ready(self)

    def parameters(self, names: Sequence[str]) -> dict[str, Any]:
        ask = self.create_client(GetParameters, f"{self._driver.newest.node}/get_parameters")
        self._until(ask.service_is_ready, f"there is no service {ask.srv_name}")
        answer = self._answer(ask.call_async(GetParameters.Request(names=names)))
        self.destroy_client(ask)
        values = map(parameter_value_to_python, answer.values)
        return dict(zip(names, values, strict=True))

    def record(self, seconds: float) -> np.ndarray:
        """Positions (n, j) of the joints in a time from now on [rad, m]; `samples` begins there."""
        self.samples.clear()
        self._wait(seconds)
        self._until(  # where this computer was too busy to take more
            lambda: len(self.samples) >= constants.FEWEST_READINGS,
            f"no {self._states} in {seconds + self.patience:g} s, or fewer than "
            f"{constants.FEWEST_READINGS}; see /diagnostics",
        )
        return np.array([sample.position for sample in self.samples])

    def record_pressures(self, seconds: float) -> dict[str, np.ndarray]:
        """Readings (n,) of each pressure in a time from now on: JOINT.a, ..., supply, tank [Pa]."""
        self.pressures.clear()
        self._wait(seconds)
        if not self.pressures:
            raise DataError(f"no {self._cylinders} in {seconds:g} s; see /diagnostics")
        names = self.pressures[0].keys()
        return {name: np.array([reading[name] for reading in self.pressures]) for name in names}

    @contextmanager
    def drive(self, joint: str) -> Iterator["NodeDrive"]:
        """Commands to one valve. However the block is left: neutral, disabled, no publisher."""
        publisher = self.create_publisher(ValveCommand, "valve_command", 1)
        drive = NodeDrive(self, publisher, joint)
        try:
            self._until(
                lambda: publisher.get_subscription_count() > 0, "the driver takes no commands"
            )
            self._enable(drive)
            yield drive
        finally:
            drive.leave()
            with suppress(NoDriverError):
                future = self._driver.disable()
                self._executor.spin_until_future_complete(future, timeout_sec=1.0)
            self.destroy_publisher(publisher)

    def recover(self, drive: "NodeDrive") -> None:
        drive.enabled = False
        answer = self._answer(self._driver.reset_fault(), drive)
        if not answer.success:
            raise MotionError(f"the driver does not reset its fault: {answer.message}")
        for _ in range(constants.NEUTRAL_CYCLES):
            drive.tick(0.0)
        self._enable(drive)

    def cycle(self, end: float) -> None:
        """Take what comes until `end` [s], and see whether the crane may go on."""
        while (left := end - self.time.now()) > 0.0 and not self._stop.requested:
            self._executor.spin_once(timeout_sec=min(left, constants.LONGEST_SPIN_S))
        if self._stop.requested:
            raise KeyboardInterrupt

    def seen(self, since: float) -> bool:
        """Return whether a joint state later than `since` [s] has come."""
        return self._received > since

    def await_state(self, since: float) -> None:
        """Take what comes until a joint state later than `since` [s], for a real time at most."""
        end = time.monotonic() + constants.LONGEST_SPIN_S
        while not self.seen(since) and (left := end - time.monotonic()) > 0.0:
            self._executor.spin_once(timeout_sec=left)

    def require_well(self) -> None:
        """`StoppedError` if the crane is not seen, or the driver has stopped it."""
        if (age := self.time.now() - self._received) > constants.STATE_TIMEOUT_S:
            raise StoppedError(
                f"no {self._states} for {age * 1e3:.0f} ms, "
                f"limit {constants.STATE_TIMEOUT_S * 1e3:.0f} ms"
            )
        if self.trouble:
            raise StoppedError(f"the driver has stopped the crane: {self.trouble}")
        if (count := self.count_publishers("valve_command")) > 1:
            raise MotionError(f"{count} publishers command the valves; stop the others")

    def _enable(self, drive: "NodeDrive") -> None:
        for _ in range(20):  # the driver wants to see a neutral command first
            drive.tick(0.0)
        answer = self._answer(self._driver.enable(), drive)
        if not answer.success:
            raise MotionError(f"the driver does not enable the crane: {answer.message}")
        drive.enabled = True
        self.trouble, self._refused = "", None

    def _wait(self, seconds: float) -> None:
        end = self.time.now() + seconds
        while (now := self.time.now()) < end:
            self.cycle(min(end, now + 10.0 * constants.COMMAND_PERIOD_S))

    def _until(self, condition: Callable[[], object], otherwise: str) -> None:
        end = time.monotonic() + self.patience
        while not condition():
            if time.monotonic() > end:
                raise DataError(otherwise)
            self.cycle(self.time.now() + constants.COMMAND_PERIOD_S)

    def _answer(self, future: Future, drive: "NodeDrive | None" = None) -> Any:
        """The answer of the driver; meanwhile the drive, if there is one, commands neutral."""
        end = time.monotonic() + self.patience
        while not future.done():
            if time.monotonic() > end:
                raise DataError(f"the driver does not answer within {self.patience:g} s")
            if drive:
                drive.tick(0.0)
            else:
                self.cycle(self.time.now() + constants.COMMAND_PERIOD_S)
        return future.result()

    def _joint_state(self, message: JointState) -> None:
        self.joints = tuple(message.name)
        stamp = message.header.stamp
        self._received = self.time.of(stamp)
        self.samples.append(
            JointInstant(
                stamp.sec + stamp.nanosec * 1e-9,
                np.array(message.position),
                np.array(message.velocity),
            )
        )

    def _cylinder_pressures(self, message: CylinderPressures) -> None:
        reading = {"supply": message.supply, "tank": message.tank}
        for name, a, b in zip(message.name, message.chamber_a, message.chamber_b, strict=True):
            reading |= {f"{name}.a": a, f"{name}.b": b}
        self.pressures.append(reading)

    def _told(self, state: DriverState) -> None:
        if state.state in (DriverState.STATE_FAULT, DriverState.STATE_EMERGENCY_STOP):
            self.trouble = f"{state.cause}; {state.remedy}"
        if self._refused is not None and state.commands_refused > self._refused:
            self.trouble = f"it refuses commands: {state.last_refusal}"
        self._refused = state.commands_refused


class NodeDrive:
    """`Drive` over valve_command, at a fixed rate; in simulated time it answers each cycle."""

    def __init__(self, client: CraneClient, publisher: Publisher, joint: str):
        self._client, self._publisher, self._joint = client, publisher, joint
        self._due = client.time.now()
        self._sent = self._due
        self.enabled = False

    def tick(self, command: float) -> Tick:
        if self.enabled:
            if (pause := self._client.time.now() - self._sent) > constants.LONGEST_PAUSE_S:
                if command:  # a neutral one begins anew
                    raise StoppedError(
                        f"no command for {pause * 1e3:.0f} ms, limit "
                        f"{constants.LONGEST_PAUSE_S * 1e3:.0f} ms: this computer "
                        "is too busy; stop other programs"
                    )
                self._client.spin(constants.COMMAND_PERIOD_S)  # what has come meanwhile
            self._client.require_well()
        self._client.samples.clear()
        sent = self._publish(command)
        now = self._client.time.now
        if self._client.time.simulated:  # the crane waits for a command in each cycle
            while (
                not self._client.seen(self._sent) and now() - self._sent < constants.STATE_TIMEOUT_S
            ):
                self._client.await_state(self._sent)
                self._client.cycle(now())
        else:
            self._due = max(self._due + constants.COMMAND_PERIOD_S, self._sent)
            self._client.cycle(self._due)
        return Tick(sent, list(self._client.samples))

    def recover(self) -> None:
        self._client.recover(self)

    def leave(self) -> None:
        now, patience = self._client.time.now, time.monotonic() + self._client.patience
        end = now() + constants.NEUTRAL_AT_END_S
        while now() < end and time.monotonic() < patience:
            self._publish(0.0)
            if self._client.time.simulated:
                self._client.await_state(self._sent)
            else:
                self._client.spin(constants.COMMAND_PERIOD_S)

    def _publish(self, command: float) -> float:
        message = ValveCommand(name=[self._joint], command=[command])
        stamp = message.header.stamp = self._client.time.stamp()
        self._publisher.publish(message)
        self._sent = self._client.time.now()
        return nanoseconds(stamp) * 1e-9
