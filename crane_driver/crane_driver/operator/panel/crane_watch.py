"""State of the crane, gathered from its topics for the page of the panel."""

import math
import time
from collections import deque
from collections.abc import Sequence
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.node import Node
from rclpy.qos import QoSProfile
from sensor_msgs.msg import JointState

from crane_driver import constants
from crane_driver.operator import by_hand
from crane_interfaces.action import RunExcitation
from crane_interfaces.msg import CylinderPressures, DriverState
from crane_model.machine import Machine
from crane_nodes.driver_client import DriverClient
from crane_nodes.executor import Polled

SUPPLY, TANK = "supply", "tank"
BUTTONS = {
    "enable": "Enable",
    "disable": "Disable",
    "reset_fault": "Reset",
    "emergency_stop": "Stop",
}
"""Labels of the page's buttons, by the service of the driver."""

Content = dict[str, Any]

NEWEST_READING = QoSProfile(depth=1)
WATCH_DEPTH = 10  # messages
ACTION = "run_excitation"
NONE_YET = "none"  # as the trajectory node says it
PHASES = {
    RunExcitation.Feedback.APPROACH: "approach",
    RunExcitation.Feedback.EXCITATION: "excitation",
    RunExcitation.Feedback.STOP: "coming to rest",
}
LATCHED_STATES = (DriverState.STATE_FAULT, DriverState.STATE_EMERGENCY_STOP)


def plain(content: Any) -> Any:
    """`content` for the page: null for a number that is not finite, buttons for services."""
    if isinstance(content, dict):
        return {key: plain(value) for key, value in content.items()}
    if isinstance(content, list):
        return [plain(value) for value in content]
    if isinstance(content, float) and not math.isfinite(content):
        return None
    return by_hand(content, BUTTONS) if isinstance(content, str) else content


class ShownReadings:
    """The newest numbers of a topic by name, and when they came [s, steady clock]."""

    def __init__(self) -> None:
        self._values: dict[str, tuple[float, ...]] = {}
        self._came = -math.inf

    def take(self, names: Sequence[str], *columns: Sequence[float], now: float) -> None:
        """Columns of numbers (j,) that belong to `names`; what is shorter lacks the others."""
        rows = zip(*columns, strict=False)
        self._values = dict(zip(names, rows, strict=False))
        self._came = now

    def of(self, name: str, count: int, now: float) -> list[float | None]:
        """(count,) of a name: null where not finite, not there, or old."""
        values = (
            self._values.get(name, ()) if now - self._came <= constants.OLDEST_READING_S else ()
        )
        if len(values) != count:
            return [None] * count
        numbers: list[float | None] = plain([float(value) for value in values])
        return numbers

    def unknown_joints(self, known: Sequence[str]) -> list[str]:
        return sorted(self._values.keys() - set(known))


def joints(machine: Machine, readings: ShownReadings, now: float) -> list[Content]:
    """Each joint against its limits (Table 2) [rad, m and per s]."""
    shown = []
    for joint, unit in machine.units.items():
        limits = machine.limits[joint]
        position, velocity = readings.of(joint, 2, now)
        shown.append(
            {
                "name": joint,
                "unit": unit,
                "position": position,
                "velocity": velocity,
                "lowest": limits.position_min,
                "highest": limits.position_max,
                "slowest": limits.velocity_min,
                "fastest": limits.velocity_max,
            }
        )
    return shown


def pressures(
    machine: Machine, chambers: ShownReadings, lines: ShownReadings, now: float
) -> Content | None:
    """Pressures of each cylinder, SUPPLY and TANK [Pa]; None if the machine has no oil.

    `highest` is the pressure of the relief valve, the end of every scale.
    """
    if machine.supply is None:
        return None
    rows = [(joint, chambers.of(joint, 2, now)) for joint in machine.cylinders]
    return {
        "highest": machine.supply.relief_pressure,
        "supply": lines.of(SUPPLY, 1, now)[0],
        "tank": lines.of(TANK, 1, now)[0],
        "cylinders": [{"name": name, "a": a, "b": b} for name, (a, b) in rows],
    }


class CraneWatch:
    """Listens for `node`, in its thread; positions and pressures are taken when they are shown."""

    def __init__(self, node: Node, machine: Machine):
        self.driver = DriverClient(node, self._told)
        self.faults: deque[Content] = deque(maxlen=constants.FAULTS_KEPT)  # the newest first
        self._machine, self._namespace = machine, node.get_namespace()
        self._positions = ShownReadings()
        self._chambers, self._lines = ShownReadings(), ShownReadings()
        self._joint_topic = Polled(node, JointState, "joint_states", NEWEST_READING)
        self._pressure_topic = Polled(node, CylinderPressures, "cylinder_pressures", NEWEST_READING)
        self._known = (DriverState.STATE_UNKNOWN, DriverState.FAULT_NONE, "")
        self._feedback: Any = None
        self._fed = 0.0
        self._last = ""  # how the last experiment ended
        self._status_name = f"{node.get_namespace()}/trajectory: experiment".lstrip("/")
        node.create_subscription(DiagnosticArray, "/diagnostics", self._diagnosed, WATCH_DEPTH)
        node.create_subscription(
            RunExcitation.Impl.FeedbackMessage,
            f"{ACTION}/_action/feedback",
            self._fed_back,
            WATCH_DEPTH,
        )

    def picture(self) -> Content:
        now = time.monotonic()
        self._take(now)
        state = self.driver.state
        content = {
            "machine": self._machine.name,
            "namespace": self._namespace,
            "time": wall_clock(),
            "state": {
                "number": state.state,
                "word": state.text,
                "cause": state.cause,
                "remedy": state.remedy,
                "further_faults": state.further_faults,
                "last_refusal": state.last_refusal,
            },
            "joints": joints(self._machine, self._positions, now),
            "unknown_joints": self._positions.unknown_joints(self._machine.joint_names),
            "pressures": pressures(self._machine, self._chambers, self._lines, now),
            "faults": list(self.faults),
            "experiment": self._experiment(now),
        }
        return {key: plain(value) for key, value in content.items()}

    def _take(self, now: float) -> None:
        for message, _ in self._joint_topic.take():
            self._positions.take(message.name, message.position, message.velocity, now=now)
        for message, _ in self._pressure_topic.take():
            self._chambers.take(message.name, message.chamber_a, message.chamber_b, now=now)
            self._lines.take((SUPPLY, TANK), (message.supply, message.tank), now=now)

    def _told(self, state: DriverState) -> None:
        known, self._known = self._known, (state.state, state.fault, state.source)
        if state.state in LATCHED_STATES and known != self._known:
            self.faults.appendleft(
                {
                    "time": wall_clock(),
                    "word": state.text,
                    "cause": state.cause,
                    "remedy": state.remedy,
                }
            )

    def _experiment(self, now: float) -> Content:
        feedback = self._feedback if now - self._fed <= constants.EXPERIMENT_SILENCE_S else None
        if feedback is None:
            return {"running": False, "last": self._last}
        return {
            "running": True,
            "phase": PHASES.get(feedback.phase, "unknown"),
            "elapsed": feedback.elapsed,
            "duration": feedback.duration,
            "errors": [
                {"name": name, "unit": unit, "error": error}
                for name, unit, error in zip(
                    feedback.name, feedback.unit, feedback.tracking_error.tolist(), strict=False
                )
            ],
        }

    def _fed_back(self, message: Any) -> None:
        self._feedback, self._fed = message.feedback, time.monotonic()

    def _diagnosed(self, message: DiagnosticArray) -> None:
        for status in message.status:
            if status.name == self._status_name:
                values = {pair.key: pair.value for pair in status.values}
                last = values.get("last result", NONE_YET)
                self._last = "" if last == NONE_YET else last


def wall_clock() -> str:
    """Now, as people write it."""
    return time.strftime("%H:%M:%S")
