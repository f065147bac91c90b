"""The driver on simulated time: it lets the simulated crane go on, cycle by cycle.

In each cycle the readings of the crane come, and their time behind them. The samples are published,
whoever commands the crane answers them, and then valve frames are sent and the crane goes on. The
load of the computer makes nothing late, and a run can be repeated to the last bit.

The driver waits, each time for at most `PATIENCE_S` of real time, for

- the command that answers a cycle, if its sender has answered the cycle before;
- nodes that must not be left behind, as they say by `Pacing`.

While nobody commands the crane, simulated time passes no faster than real time. With `listeners`
it begins when these nodes hear the joint states, and stands still while the crane rests. Then the
driver is enabled and reset at such a standstill alone, so that every motion begins at a time that
the computer has no part in.
"""

import time
from collections import deque
from collections.abc import Sequence
from typing import Any

from rclpy.task import Future
from rosgraph_msgs.msg import Clock as ClockMessage
from std_msgs.msg import Header

from crane_bags.clocks import NANOSECONDS
from crane_bags.types import JOINT_STATES
from crane_driver import constants
from crane_driver.active_driver import ActiveDriver
from crane_driver.can.frame import TIME, Frame, step_frame, told_time
from crane_driver.safety.supervisor import SafetyState
from crane_interfaces.msg import ValveCommand
from crane_nodes.executor import Polled
from crane_nodes.managed import full_name
from crane_nodes.node_time import (
    CLOCK_PROFILE,
    CLOCK_TOPIC,
    TAKEN_PROFILE,
    TAKEN_TOPIC,
    NodeTime,
    nanoseconds,
    stamp_of,
)
from crane_nodes.this_computer import PATIENCE_S, RealTimeSettings

QUIET_NS = NANOSECONDS  # after which a crane that rests needs no more time
NOBODY, NO_COMMANDER, PACE = "", "no commander", "pace"


class LockStepDriver(ActiveDriver):
    """An `ActiveDriver` whose time comes from the bus."""

    def __init__(self, clock: NodeTime, listeners: Sequence[str], *arguments: Any) -> None:
        super().__init__(*arguments)
        self._clock, self._listeners = clock, frozenset(listeners)
        self._time = 0  # of the newest cycle [ns]
        self._gone = 0.0  # s that time went on without the crane: it never goes back
        self._frames: deque[Frame] = deque()
        self._train: list[Frame] = []  # of the cycle that is coming
        self._joined = False  # whether the frames of a cycle are heard from its first one on
        self._waiting = False  # whether the crane waits for this driver
        self._since = self._stepped = self._asked = self._ticked = time.monotonic()
        self._answered = 0  # stamp of the newest command [ns]
        self._state, self._changed = SafetyState.OFFLINE, 0
        self._taken: dict[str, int] = {}  # by node, how far the crane may go [ns]
        self._absent = sorted(self._listeners)
        self._remark = ""
        self._next_look = Future()

    def begin(self, realtime: RealTimeSettings) -> None:
        self._ticks = self._node.create_publisher(ClockMessage, CLOCK_TOPIC, CLOCK_PROFILE)
        self._paced = Polled(self._node, Header, TAKEN_TOPIC, TAKEN_PROFILE)
        super().begin(RealTimeSettings(priority=0, lock_memory=False))

    def end(self) -> None:
        super().end()
        self._paced.close()
        self._node.destroy_publisher(self._ticks)

    # time

    def _now(self) -> float:
        """Simulated time [s]; if the crane is gone, the steady clock goes on from there."""
        return self._time / NANOSECONDS + self._gone + max(0.0, self._silent() - PATIENCE_S)

    def _silent(self) -> float:
        """For how long nothing has come from the crane that is to go on [s, real]."""
        return 0.0 if self._waiting else time.monotonic() - self._since

    def _stamp(self) -> int:
        return self._time

    def _runs(self) -> float:
        return self._now()  # the crane waits for a driver that is late: it never stalls

    def _pause(self) -> None:
        if self._waiting:
            self._step()
        while not self._arrived() and self._silent() < constants.ASK_PERIOD_S:
            time.sleep(1e-4)
        self._train.clear()

    # cycles

    def receive(self) -> None:
        while self._arrived():
            self._tick()
            frames, self._train = self._train, []
            self._publish(frames)
            self._judge(self._now(), self._now())
            self._go_on_if(led=True)

    def _arrived(self) -> bool:
        """Collect the frames of a cycle; return whether its time has come, which ends it."""
        self._frames += self.link.take()
        while self._frames:
            frame = self._frames.popleft()
            if (told := told_time(frame, TIME)) is None:
                self._train.append(frame)
            elif not self._joined:  # what came before may lack frames; the crane repeats them
                self._joined = True
                self._train.clear()
            elif told != self._time:
                self._gone += max(0.0, self._silent() - PATIENCE_S)
                self._time, self._waiting, self._since = told, True, time.monotonic()
                steady = self._now()
                self._train = [frame._replace(stamp=told, steady=steady) for frame in self._train]
                return True
            else:  # the crane repeats itself, and may have missed the answer
                self._train.clear()
                if not self._waiting:
                    self._step()
        del self._train[: -constants.MOST_TRAIN_FRAMES]
        return False

    def _tick(self) -> None:
        message = ClockMessage(clock=stamp_of(self._time))
        self._clock.tell(message)
        self._ticks.publish(message)
        self._ticked = time.monotonic()

    def _due(self) -> None:
        """Look, every cycle of real time, whether somebody is waited for who will not answer."""
        self._go_on_if(led=False)
        if self._waiting and time.monotonic() - self._ticked > constants.TICK_REPEAT_S:
            self._tick()  # for nodes that have come since
        if self._silent() > PATIENCE_S:  # the crane is gone
            self._judge(self._now(), self._now())
            self._answer(self._now())
        self._say()
        looked, self._next_look = self._next_look, Future()
        looked.set_result(None)

    def _command(self, message: ValveCommand, info: dict[str, Any]) -> None:
        self._commanded(message, self._now())
        self._answered = nanoseconds(message.header.stamp)
        self._go_on_if(led=True)

    def _go_on_if(self, led: bool) -> None:
        """Let the crane go on unless somebody is waited for; `led`: because a message came."""
        if not self._waiting or self._awaited(led):
            return
        self._answer(self._now())
        self._step()

    def _step(self) -> None:
        self._send([step_frame(self._time)])
        if self._waiting:
            self._waiting, self._since = False, time.monotonic()
            self._stepped = self._since

    def _awaited(self, led: bool) -> str:
        """Name what the driver waits for before the crane goes on; empty if nothing."""
        supervisor, waited = self.loop.supervisor, time.monotonic() - self._since
        open_valves = any(supervisor.sent.values())
        if supervisor.state is not self._state or open_valves:
            self._state, self._changed = supervisor.state, self._time
        if behind := self._behind():
            if waited < PATIENCE_S:
                return behind
            del self._taken[behind]  # until it says again how far it has come
        cycles = (self._time - self._answered) / (self.loop.cycle * NANOSECONDS)
        if supervisor.letting_through and self._commanders():
            if cycles < 0.5:
                return NOBODY
            if cycles < 1.5 and waited < PATIENCE_S:
                return "the command that answers this cycle"
        if self._listeners and (absent := self._missing()):
            return absent
        if self._rests:
            return NO_COMMANDER
        early = time.monotonic() - self._stepped < constants.PACE_CYCLES * self.loop.cycle
        return PACE if led or early else NOBODY

    @property
    def _rests(self) -> bool:
        """Return whether simulated time stands still until somebody commands the crane."""
        supervisor = self.loop.supervisor
        if not self._listeners or any(supervisor.sent.values()):
            return False
        quiet = self._time - self._changed > QUIET_NS and self._state is not SafetyState.OFFLINE
        return supervisor.letting_through or quiet

    async def settled(self) -> None:
        """Wait until a crane that comes to rest needs no more time: always at the same one."""
        while self._listeners and self._state is not SafetyState.OFFLINE and not self._rests:
            await self._next_look

    def substitute(self, joint: str) -> str:
        """Do the same as in real time; what it changes is to be seen, so time goes on."""
        said = super().substitute(joint)
        self._changed = self._time
        return said

    def _behind(self) -> str:
        """Name a node that the crane would leave behind."""
        if not self._late():
            return NOBODY
        self._hear()
        if (late := self._late()) and self._may_ask():
            there = self._pacing()
            self._taken = {name: until for name, until in self._taken.items() if name in there}
            late = self._late()
        return late

    def _pacing(self) -> set[str]:
        """Full names of the nodes that say how far they have come."""
        there = self._node.get_publishers_info_by_topic(TAKEN_TOPIC)
        return {f"{endpoint.node_namespace.rstrip('/')}/{endpoint.node_name}" for endpoint in there}

    def _hear(self) -> None:
        self._taken |= {
            header.frame_id: nanoseconds(header.stamp) for header, _ in self._paced.take()
        }

    def _late(self) -> str:
        return next((name for name, until in self._taken.items() if until < self._time), NOBODY)

    def _missing(self) -> str:
        """Name the listeners that are not there yet; once they were, time has begun."""
        if self._absent and self._may_ask():
            heard = self._node.get_subscriptions_info_by_topic(JOINT_STATES.relative)
            self._hear()
            silent = {name.rpartition("/")[2] for name in self._pacing() - self._taken.keys()}
            there = {endpoint.node_name for endpoint in heard} - silent
            self._absent = sorted(self._listeners - there)
        return ", ".join(self._absent)

    def _may_ask(self) -> bool:
        """Return whether it is time to ask the graph again, which is dear."""
        now = time.monotonic()
        if now - self._asked < constants.ASK_PERIOD_S:
            return False
        self._asked = now
        return True

    def _say(self) -> None:
        """Tell, once each, who keeps simulated time from going on."""
        remark = ""
        if time.monotonic() - self._since > constants.REMARK_AFTER_S:
            if self._waiting:
                remark = self._awaited(led=False)
            elif self._train:
                remark = "the simulated crane, which runs in real time: start it with --lock-step"
            else:
                remark = "the simulated crane"
        if remark != self._remark and remark not in (NO_COMMANDER, PACE):
            name = full_name(self._node)
            stands = f"simulated time stands still: {name} waits for {remark}"
            self._log.warning(stands) if remark else self._log.info("simulated time goes on")
            self._remark = remark
