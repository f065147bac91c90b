"""The driver of a node's namespace, by whatever name it runs."""

import time
from collections.abc import Callable

from rclpy.client import Client
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.task import Future
from std_srvs.srv import Trigger

from crane_interfaces.msg import DriverState
from crane_model.errors import CraneError
from crane_nodes.this_computer import PATIENCE_S

STATE_TOPIC = "driver/state"
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
ALL_DRIVERS = QoSProfile(depth=10, durability=DurabilityPolicy.TRANSIENT_LOCAL)
"""With a depth of 1, what one driver tells would replace what another one has told."""

DRIVER_SILENCE_S = 2.5  # after which a driver is gone; it tells its state once a second
SERVICES = ("enable", "disable", "reset_fault", "emergency_stop")


class NoDriverError(CraneError):
    """A request cannot be made.

    Examples: no driver was ever heard, two run in one namespace, its services are gone.
    """


class DriverWatch:
    """Listener to driver/state, for `node` and in its thread.

    `told`, if given, is called with every message.
    """

    def __init__(self, node: Node, told: Callable[[DriverState], None] = lambda state: None):
        self._node, self._told = node, told
        self._states: dict[str, tuple[float, DriverState]] = {}  # by driver, and when it came
        self._simulated = node.get_parameter("use_sim_time").value is True
        self.newest = DriverState()  # however old; of whichever driver has told it
        topic = node.create_subscription(DriverState, STATE_TOPIC, self._receive, ALL_DRIVERS)
        self._topic = topic.topic_name

    @property
    def state(self) -> DriverState:
        """The newest state; STATE_UNKNOWN, with cause and remedy, if not exactly one tells it."""
        states = self._heard()
        if len(states) == 1:
            return states[0]
        names = ", ".join(sorted(state.node for state in states))
        if names:
            cause = f"{names} are drivers in one namespace"
            remedy = "stop all but one, or give each crane a namespace"
        else:
            cause = f"no driver publishes its state on {self._topic}"
            remedy = "start it: ros2 run crane_driver driver"
        return DriverState(
            text="several drivers" if names else "no driver", cause=cause, remedy=remedy
        )

    @property
    def problem(self) -> str:
        """Obstacle between commands and valves, with the remedy; empty if there is none."""
        state = self.state
        if state.state == DriverState.STATE_ENABLED:
            return ""
        return ": ".join(filter(None, (state.node, f"{state.cause}; {state.remedy}")))

    def _heard(self) -> list[DriverState]:
        silence = PATIENCE_S if self._simulated else DRIVER_SILENCE_S
        since = time.monotonic() - silence
        return [state for came, state in self._states.values() if came >= since]

    def _receive(self, message: DriverState) -> None:
        self.newest = message
        self._states[message.node] = time.monotonic(), message
        if message.state == DriverState.STATE_FINALIZED:
            del self._states[message.node]  # another one may take its place at once
        self._told(message)


class DriverClient(DriverWatch):
    """The state of the driver of a node's namespace, and its services.

    `enable`, `disable` and `reset_fault` return a future with the Trigger.Response.

    Parameters
    ----------
    node
        Node in whose namespace and thread it listens.
    told
        Called with every state that the driver tells.

    Raises
    ------
    NoDriverError
        By each request, if there is not exactly one driver to ask.
    """

    def __init__(self, node: Node, told: Callable[[DriverState], None] = lambda state: None):
        self._services: dict[str, dict[str, Client]] = {}  # by driver
        super().__init__(node, told)

    @property
    def ready(self) -> bool:
        """Return whether there is one driver and its services are there."""
        services = self._services.get(self.state.node, {})
        return bool(services) and all(client.service_is_ready() for client in services.values())

    def enable(self) -> Future:
        return self._ask("enable")

    def disable(self) -> Future:
        return self._ask("disable")

    def reset_fault(self) -> Future:
        return self._ask("reset_fault")

    def stop(self) -> list[Future]:
        """Emergency stop: neutral at once, latched; of every driver that was ever heard."""
        if not self._services:
            raise NoDriverError(self.problem)
        stops = [clients["emergency_stop"] for clients in self._services.values()]
        return [client.call_async(Trigger.Request()) for client in stops]

    def _ask(self, service: str) -> Future:
        if not self._services or len(self._heard()) > 1:
            raise NoDriverError(self.problem)
        client = self._services[self.newest.node][service]  # it may be held up, and yet answer
        if not client.service_is_ready():
            raise NoDriverError(f"the service {client.srv_name} is not there")
        return client.call_async(Trigger.Request())

    def _receive(self, message: DriverState) -> None:
        driver = message.node
        if driver not in self._services:
            self._services[driver] = {
                service: self._node.create_client(Trigger, f"{driver}/{service}")
                for service in SERVICES
            }
        super()._receive(message)
