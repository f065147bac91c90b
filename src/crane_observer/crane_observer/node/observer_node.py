"""What the managed nodes of this package have in common: lifecycle, queues, a report a second."""

from collections.abc import Sequence
from typing import Any, TypeAlias

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.clock import Clock, ClockType
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from rclpy.qos import QoSProfile

from crane_bags.clocks import TimeBack
from crane_model.errors import CraneError
from crane_nodes.machine_parameter import MACHINE
from crane_nodes.managed import AUTOSTART
from crane_nodes.names import full_name
from crane_nodes.node_time import NodeTime, Pacing, tell_back
from crane_nodes.parameters import NodeParameter, declare, hold
from crane_nodes.polled import Polled
from crane_nodes.ready import say_ready
from crane_nodes.stamps import nanoseconds
from crane_observer.node.topics import report_message

PUBLISH = 1.0  # s, of diagnostics
AHEAD = 0.05  # s, by which simulated time may be ahead: the driver moves joints by estimates
HeardTopic: TypeAlias = tuple[str, type, QoSProfile]


class ObserverNode(LifecycleNode):
    """Listens while it is active; a node says by `read` to `report` what becomes of that.

    If the stamps of a topic go back, it begins anew.
    """

    def __init__(
        self,
        name: str,
        parameters: Sequence[NodeParameter],
        heard: Sequence[HeardTopic],
        visit: float,
        tells: str,
    ):
        """`heard` is looked at every `visit` s; `tells` names the status on /diagnostics."""
        super().__init__(name)
        declare(self, parameters, read_only=(AUTOSTART, MACHINE))
        self._configured = self._active = False
        hold(self, parameters, lambda: "configured" if self._configured else "unconfigured")
        self.clock = NodeTime(self)
        self.clock.listen()
        self._pacing: Pacing | None = None
        self._back = TimeBack()
        self._set_backs = 0  # that were told
        self._heard, self._tells = heard, tells
        self._queues: list[Polled] = []
        self._diagnostics = self.create_publisher(DiagnosticArray, "/diagnostics", 10)
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(visit, self._visit, clock=steady)
        self.create_timer(PUBLISH, self._report, clock=steady)

    def read(self) -> None:
        """Files and parameters; `CraneError` or `OSError` keeps the node unconfigured."""
        raise NotImplementedError

    def begin(self) -> None:
        """Before anything is heard."""
        raise NotImplementedError

    def end(self) -> None:
        """After everything was heard."""

    def hear(self, topic: int, message: Any) -> None:
        """A message of the topic at this place of those that are heard."""
        raise NotImplementedError

    def tell(self) -> None:
        """What follows from what was heard since the last visit."""
        raise NotImplementedError

    def report(self, status: DiagnosticStatus) -> None:
        """How an active node is doing, into a status that is OK and says nothing yet."""
        raise NotImplementedError

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Read; refused where that fails."""
        try:
            self.read()
        except (CraneError, OSError) as error:
            self.get_logger().error(str(error))
            return TransitionCallbackReturn.FAILURE
        self._configured = True
        return super().on_configure(state)

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Listen; nothing is known yet."""
        activated = super().on_activate(state)
        self._queues = [Polled(self, msgtype, topic, qos) for topic, msgtype, qos in self._heard]
        self._back, self._set_backs = TimeBack(), 0
        self.begin()
        self._active = True
        self._pacing = Pacing(self, self.clock, AHEAD)
        say_ready(self)
        return activated

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Listen no more; what was found is forgotten."""
        for queue in self._queues:
            queue.close()
        self._queues = []
        if self._pacing is not None:
            self._pacing.close()
        self._finish()
        return super().on_deactivate(state)

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Another model may be read."""
        self._configured = False
        return super().on_cleanup(state)

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Leave nothing half done."""
        self._finish()
        return super().on_shutdown(state)

    def _finish(self) -> None:
        if self._active:
            self._active = False
            self.end()

    def _visit(self) -> None:
        if not self._active:
            return
        for topic, queue in enumerate(self._queues):
            for message, _ in queue.take():
                if self._back.comes(self._heard[topic][0], nanoseconds(message.header.stamp)):
                    if self._back.times != self._set_backs:
                        self._set_backs = self._back.times
                        self.get_logger().warning(str(self._back))
                    self.end()
                    self.begin()
                self.hear(topic, message)
        self.tell()
        if self._pacing is not None:
            self._pacing.taken()

    def _report(self) -> None:
        status = DiagnosticStatus(
            name=f"{full_name(self)}: {self._tells}", level=DiagnosticStatus.OK
        )
        if self._active:
            self.report(status)
            tell_back(self._back, status)
        else:
            status.message = "not active"
        self._diagnostics.publish(report_message(status, self.clock.stamp()))
