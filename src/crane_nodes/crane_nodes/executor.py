"""An executor for the control loop: rclpy's for one thread, with its wait set kept.

rclpy builds a new wait set for each wait and a coroutine for each callback: with the 45 entities
of a driver, ten times the processor time of the wait itself. Here the entities are collected when
one is created or destroyed, and a plain callback is simply called.
"""

import inspect
import time
from collections.abc import Callable
from typing import Any, TypeVar

from rclpy.client import Client
from rclpy.event_handler import EventHandler
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor, TimeoutObject
from rclpy.guard_condition import GuardCondition
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node
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
        """Serve a node no longer."""
        self._changed = True
        super().remove_node(node)

    def spin_once(self, timeout_sec: float | None = None) -> None:
        """Wait for at most `timeout_sec`, without end if it is None, and serve all that is ready.

        Raises
        ------
        ExternalShutdownException
            If the context of the executor was shut down.
        Exception
            Whatever a callback raises.
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
            found = [one for node in nodes for one in kind(node)]
            return [one for one in found if one.callback_group.can_execute(one)]

        self._subscriptions: list[Subscription] = served(lambda node: node.subscriptions)
        self._timers: list[Timer] = served(lambda node: node.timers)
        self._clients: list[Client] = served(lambda node: node.clients)
        self._services: list[Service] = served(lambda node: node.services)
        self._guards: list[GuardCondition] = served(lambda node: node.guards)
        self._guards += [self._guard, self._sigint_gc]
        waitables = served(lambda node: node.waitables)
        self._events: list[EventHandler] = [
            one for one in waitables if isinstance(one, EventHandler)
        ]
        self._waitables: list[Waitable] = [one for one in waitables if one not in self._events]
        count = [one.get_num_entities() for one in waitables]
        self._wait_set = rclpy_implementation.WaitSet(
            len(self._subscriptions) + sum(one.num_subscriptions for one in count),
            len(self._guards) + sum(one.num_guard_conditions for one in count),
            len(self._timers) + sum(one.num_timers for one in count),
            len(self._clients) + sum(one.num_clients for one in count),
            len(self._services) + sum(one.num_services for one in count),
            sum(one.num_events for one in count),
            self._context.handle,
        )

    def _serve(self, wait_set: Any) -> None:
        waitables = [*self._waitables, *(self._events if self._with_events else ())]
        ready = [one for one in waitables if one.is_ready(wait_set)]
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
            for one in self._subscriptions:
                if one.handle.pointer in subscriptions:
                    self._take_message(one)
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
            self._tasks = [one for one in self._tasks if not (one[0].done() or one[0].cancelled())]
