"""An executor for the control loop: rclpy's for one thread, with its wait set kept.

rclpy builds a new wait set for each wait and a coroutine for each callback: with the 45 entities
of a driver, ten times the processor time of the wait itself. Here the entities are collected when
one is created or destroyed, and a plain callback is simply called. Messages of a `Polled` topic are
taken from its queue now and then, without the executor.
"""

import inspect
import time
from collections.abc import Callable, Iterator
from typing import Any, TypeVar

from rclpy.callback_groups import CallbackGroup
from rclpy.client import Client
from rclpy.event_handler import EventHandler
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor, TimeoutObject
from rclpy.guard_condition import GuardCondition
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.service import Service
from rclpy.subscription import Subscription
from rclpy.task import Future
from rclpy.timer import Timer
from rclpy.waitable import Waitable

EVENTS_PERIOD_S = 0.5  # between two looks at the events of the middleware, which warn in the log
InvalidHandle = rclpy_implementation.InvalidHandle
Entity = TypeVar("Entity")


class KeptExecutor(SingleThreadedExecutor):
    """Waits for all entities of its nodes, in the thread that calls `spin_once`."""

    def __init__(self, **arguments: Any) -> None:
        self._changed = True
        super().__init__(**arguments)
        self._events_due = 0.0  # s, steady

    def wake(self) -> None:
        """Collect the entities anew: one was created or destroyed."""
        self._changed = True
        super().wake()

    def add_node(self, node: Node) -> bool:
        """Serve a node; return whether it is a new one."""
        self._changed = True
        return bool(super().add_node(node))

    def remove_node(self, node: Node) -> None:
        self._changed = True
        super().remove_node(node)

    def spin_once(self, timeout_sec: float | None = None) -> None:
        """Wait for at most `timeout_sec`, without end if it is None, and serve all that is ready.

        `ExternalShutdownException` if the context of the executor was shut down.
        """
        wait_set = self._filled()
        wait_set.wait(-1 if timeout_sec is None else int(timeout_sec * 1e9))
        if not self._context.ok():
            raise ExternalShutdownException
        self._serve(wait_set)
        self._run_tasks()

    def spin_once_until_future_complete(
        self, future: Future, timeout_sec: float | TimeoutObject | None = None
    ) -> None:
        """Do the same, unless `future` is done."""
        if not future.done():
            limited = isinstance(timeout_sec, TimeoutObject)
            self.spin_once(timeout_sec.timeout if limited else timeout_sec)  # type: ignore

    def _filled(self) -> Any:
        """The wait set, with all entities: a wait takes out those that are not ready."""
        if self._changed:
            self._collect()
        wait_set = self._wait_set
        try:
            wait_set.clear_entities()
            for subscription in self._subscriptions:
                wait_set.add_subscription(subscription.handle)
            for guard in self._guards:
                wait_set.add_guard_condition(guard.handle)
            for timer in self._timers:
                wait_set.add_timer(timer.handle)
            for client in self._clients:
                wait_set.add_client(client.handle)
            for service in self._services:
                wait_set.add_service(service.handle)
            for waitable in self._waitables:
                waitable.add_to_wait_set(wait_set)
        except InvalidHandle:  # destroyed by another thread meanwhile
            self._changed = True
            return self._filled()
        self._with_events = time.monotonic() >= self._events_due
        if self._with_events:
            self._events_due = time.monotonic() + EVENTS_PERIOD_S
            for event in self._events:
                event.add_to_wait_set(wait_set)
        return wait_set

    def _collect(self) -> None:
        self._changed = False
        nodes = self.get_nodes()

        def served(kind: Callable[[Node], Any]) -> list[Any]:
            """Those that their callback group does not hold back for good, as it does `Polled`."""
            found = [entity for node in nodes for entity in kind(node)]
            return [entity for entity in found if entity.callback_group.can_execute(entity)]

        self._subscriptions: list[Subscription] = served(lambda node: node.subscriptions)
        self._timers: list[Timer] = served(lambda node: node.timers)
        self._clients: list[Client] = served(lambda node: node.clients)
        self._services: list[Service] = served(lambda node: node.services)
        self._guards: list[GuardCondition] = served(lambda node: node.guards)
        self._guards += [self._guard, self._sigint_gc]
        waitables = served(lambda node: node.waitables)
        self._events: list[EventHandler] = [
            waitable for waitable in waitables if isinstance(waitable, EventHandler)
        ]
        self._waitables: list[Waitable] = [
            waitable for waitable in waitables if waitable not in self._events
        ]
        count = [waitable.get_num_entities() for waitable in waitables]
        self._wait_set = rclpy_implementation.WaitSet(
            len(self._subscriptions) + sum(counted.num_subscriptions for counted in count),
            len(self._guards) + sum(counted.num_guard_conditions for counted in count),
            len(self._timers) + sum(counted.num_timers for counted in count),
            len(self._clients) + sum(counted.num_clients for counted in count),
            len(self._services) + sum(counted.num_services for counted in count),
            sum(counted.num_events for counted in count),
            self._context.handle,
        )

    def _serve(self, wait_set: Any) -> None:
        waitables = [*self._waitables, *(self._events if self._with_events else ())]
        ready = [waitable for waitable in waitables if waitable.is_ready(wait_set)]
        guards = wait_set.get_ready_entities("guard_condition")
        subscriptions = wait_set.get_ready_entities("subscription")
        clients = wait_set.get_ready_entities("client")
        services = wait_set.get_ready_entities("service")
        for timer in self._timers:
            try:
                if not timer.handle.is_timer_ready():
                    continue
                timer.handle.call_timer()
            except InvalidHandle:  # destroyed by a callback of this turn
                continue
            self._call(timer.callback)
        if guards:
            for guard in self._guards:
                if guard.callback and guard.handle.pointer in guards:
                    self._call(guard.callback)
        if subscriptions:
            for subscription in self._subscriptions:
                if subscription.handle.pointer in subscriptions:
                    self._take_message(subscription)
        if services or clients:
            for service in self._services:
                if service.handle.pointer in services:
                    self._run(self._take_service(service))
            for client in self._clients:
                if client.handle.pointer in clients:
                    self._run(self._take_client(client))
        for waitable in ready:
            self._run(self._take_waitable(waitable))

    def _take_message(self, subscription: Subscription) -> None:
        try:
            taken = subscription.handle.take_message(subscription.msg_type, subscription.raw)
        except InvalidHandle:
            return
        if taken is None:
            return
        with_about = subscription._callback_type is not Subscription.CallbackType.MessageOnly
        self._call(subscription.callback, *(taken if with_about else taken[:1]))

    def _call(self, callback: Callable[..., Any], *arguments: Any) -> None:
        """Call what may be a coroutine function: the rest of it is done between callbacks."""
        if inspect.iscoroutine(begun := callback(*arguments)):
            self.create_task(begun)

    def _run(self, work: Callable[[], Any] | None) -> None:
        if work is not None:
            self.create_task(work)

    def _run_tasks(self) -> None:
        """Go on with every coroutine, as long as one that ends may have made others ready."""
        ended = bool(self._tasks)
        while ended:
            ended = False
            for task, _, _ in list(self._tasks):
                task()
                if task.done():
                    ended = True
                    if (error := task.exception()) is not None:
                        self._forget_ended()
                        raise error
            if ended:
                self._forget_ended()

    def _forget_ended(self) -> None:
        with self._tasks_lock:
            self._tasks = [
                task for task in self._tasks if not (task[0].done() or task[0].cancelled())
            ]


class _Alone(CallbackGroup):
    """Entity that the executor leaves alone."""

    def can_execute(self, entity: object) -> bool:
        return False

    def beginning_execution(self, entity: object) -> bool:
        return False

    def ending_execution(self, entity: object) -> None:
        pass


class Polled:
    """One topic. A callback through the executor costs 0.3 ms a message, taking a message from the
    queue of its subscription a hundredth of that. The time of reception is stamped by the
    middleware, so that nothing is lost by coming for it later, as long as the queue holds it.
    """

    def __init__(
        self, node: Node, msgtype: type[Any], topic: str, qos: QoSProfile, raw: bool = False
    ):
        """raw: the messages are taken as they were serialized."""
        self._node, self._msgtype, self._depth, self._raw = node, msgtype, qos.depth, raw
        never: Callable[[Any], None] = lambda message: None  # noqa: E731
        self._subscription: Subscription = node.create_subscription(
            msgtype, topic, never, qos, callback_group=_Alone(), raw=raw
        )

    def take(self) -> Iterator[tuple[Any, dict[str, Any]]]:
        """Messages since the last call, at most a queue full, with their stamps."""
        for _ in range(self._depth):
            if (taken := self._subscription.handle.take_message(self._msgtype, self._raw)) is None:
                break
            yield taken

    def close(self) -> None:
        self._node.destroy_subscription(self._subscription)
