"""The open bus: a thread that receives, stamps and queues frames, and comes back after losses."""

import math
import select
import threading
import time
import uuid
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from typing import Self

import can

from crane_driver import constants
from crane_driver.can.bus import (
    BusError,
    BusOffError,
    BusSettings,
    BusState,
    check_state,
    open_bus,
    state_of_error_frame,
)
from crane_driver.can.frame import Frame
from crane_driver.faults import Fault, FaultKind


class Link:
    """A CAN bus. Frames are taken and sent by one thread, received by another.

    Parameters
    ----------
    settings
        How the bus is opened.
    notify
        Called by the receiving thread after a cycle or a train of frames, and after each fault; it
        must only wake the taker up.
    capacity
        Frames that wait at most; if more come, the oldest are dropped.
    cycle
        Identifiers of the frames that come in every cycle: with the last of them the taker is woken
        at once. Frames that no cycle waits for wake nobody then.
    listen_only
        Whether `send` refuses every frame.
    """

    def __init__(
        self,
        settings: BusSettings,
        notify: Callable[[], None] = lambda: None,
        capacity: int = 4096,
        cycle: frozenset[int] = frozenset(),
        listen_only: bool = False,
    ):
        self._settings, self._notify, self._cycle = settings, notify, cycle
        self._listen_only = listen_only
        self._lock = threading.Lock()
        self._frames: deque[Frame] = deque(maxlen=capacity)
        self._faults: deque[Fault] = deque(maxlen=capacity)
        self._stop = threading.Event()
        self._thread: threading.Thread | None = None
        self._bus: can.BusABC | None = None
        self._overflowing = False
        self._fetched = -math.inf  # s, steady, stamp of the newest frame, whosever it is
        # udp_multicast gives back what this process sends; the field that other interfaces use
        # for the channel passes through it unchanged and tells whose frame it is.
        self._mark = uuid.uuid4().hex if settings.interface == "udp_multicast" else None
        self.state = BusState.CLOSED
        self.received = self.dropped = self.echoes = self.ignored = self.reopened = 0

    def open(self) -> Self:
        """Open the bus and start to receive; `BusError` if that fails."""
        if self._thread:
            raise BusError(f"CAN bus {self._settings} is open already")
        self._connect()
        self._stop.clear()
        self._thread = threading.Thread(target=self._run, name=f"CAN {self._settings}", daemon=True)
        self._thread.start()
        return self

    def close(self) -> None:
        self._stop.set()
        if self._thread:
            self._thread.join()
            self._thread = None
        self._disconnect(BusState.CLOSED)

    def take(self, most: int | None = None) -> list[Frame]:
        """Frames since the last call, oldest first, at most `most`: the others wake the reader."""
        with self._lock:
            count = len(self._frames) if most is None else min(most, len(self._frames))
            frames = [self._frames.popleft() for _ in range(count)]
            more = bool(self._frames)
            self._overflowing = self._overflowing and more
        if more:
            self._wake()
        return frames

    def take_faults(self) -> list[Fault]:
        with self._lock:
            faults = list(self._faults)
            self._faults.clear()
        return faults

    def heard(self, now: float) -> float:
        """Until when [s, steady] all frames that came have been taken: `now`, unless some wait here
        or, where the interface tells it, to be received.
        """
        unreceived = self._unreceived()
        with self._lock:
            if self._frames:
                return self._frames[0].steady
        return min(now, self._fetched) if unreceived else now

    def send(self, frame: Frame) -> None:
        """Hand a frame to the bus without waiting; `BusError` if it cannot be sent."""
        if self._listen_only:
            raise BusError(f"CAN bus {self._settings} is only listened to; the frame was not sent")
        bus = self._bus
        if bus is None:
            raise BusError(f"CAN bus {self._settings} is {self.state}; the frame was not sent")
        try:
            bus.send(
                can.Message(
                    arbitration_id=frame.id,
                    data=frame.data,
                    is_extended_id=frame.extended,
                    channel=self._mark,
                    check=True,
                )
            )
        except Exception as error:  # as in open_bus; a socket closed meanwhile, too
            raise BusError(f"CAN bus {self._settings}: frame was not sent: {error}") from error

    def _run(self) -> None:
        pause = constants.FIRST_REOPEN_PAUSE_S
        while not self._stop.is_set():
            try:
                if self._bus is None:
                    self._connect()
                    self.reopened += 1
                self._receive()
            except Exception as error:  # whatever it is, it must neither end nor hide in the thread
                off = isinstance(error, BusOffError)
                if self._bus is not None and self.state is not BusState.SILENT:
                    pause = constants.FIRST_REOPEN_PAUSE_S  # it worked in between
                self._disconnect(BusState.BUS_OFF if off else BusState.LOST)
                self._report(FaultKind.BUS, f"{_shown(error)}; reopened in {pause:g} s")
                self._stop.wait(pause)
                pause = min(2 * pause, constants.LONGEST_REOPEN_PAUSE_S)

    def _connect(self) -> None:
        bus = open_bus(self._settings)
        try:
            check_state(bus, self._settings)
        except BusError:
            bus.shutdown()
            raise
        self.state = BusState.SILENT
        self._bus = bus

    def _disconnect(self, state: BusState) -> None:
        bus, self._bus, self.state = self._bus, None, state
        if bus:
            try:
                bus.shutdown()
            except Exception as error:
                self._report(FaultKind.BUS, f"closing: {_shown(error)}")

    def _receive(self) -> None:
        """Queue what comes, and wake who takes it once per cycle of the machine, or per train of
        frames where it is not whole: to be woken costs more than to take them.
        """
        assert self._bus is not None
        train = math.inf  # s, steady, since when frames wait for which nobody has been woken
        lacking = set(self._cycle)  # identifiers that have not come in this train
        while not self._stop.is_set():
            waiting = train < math.inf
            message = self._bus.recv(constants.TRAIN_END_S if waiting else constants.POLL_PERIOD_S)
            if waiting and (
                message is None or time.monotonic() - train > constants.LONGEST_TRAIN_S
            ):
                train, lacking = math.inf, set(self._cycle)
                self._wake()
            if message is None:
                if not waiting:
                    check_state(self._bus, self._settings)
                continue
            stamp, steady = _stamps(message.timestamp)
            self._fetched = steady
            if message.is_error_frame:
                self._error_frame(message)
            elif self._mark and message.channel == self._mark:
                self.echoes += 1
            elif message.is_remote_frame:
                self.ignored += 1
            else:
                self._queue(message, stamp, steady)
                if self._cycle and message.arbitration_id not in self._cycle:
                    continue  # no cycle waits for it: it is taken with the next one
                train = min(train, time.monotonic())
                lacking.discard(message.arbitration_id)
                if self._cycle and not lacking:
                    train, lacking = math.inf, set(self._cycle)
                    self._wake()

    def _queue(self, message: can.Message, stamp: int, steady: float) -> None:
        frame = Frame(
            message.arbitration_id, bytes(message.data), message.is_extended_id, stamp, steady
        )
        self.received += 1
        if self.state is BusState.SILENT:
            self.state = BusState.ACTIVE
        with self._lock:
            full = len(self._frames) == self._frames.maxlen
            begins, self._overflowing = full and not self._overflowing, full
            self._frames.append(frame)
            self.dropped += full
        if begins:
            waiting = f"{self._frames.maxlen} frames wait; the oldest are dropped"
            self._report(FaultKind.OVERFLOW, waiting)

    def _unreceived(self) -> bool:
        bus = self._bus
        if bus is None:
            return False
        with suppress(NotImplementedError, OSError, ValueError):  # no descriptor, or closed by now
            return bool(select.select([bus], [], [], 0.0)[0])
        return False

    def _error_frame(self, message: can.Message) -> None:
        state = state_of_error_frame(message.arbitration_id, message.data)
        if state is BusState.BUS_OFF:
            raise BusOffError(self._settings)
        if state and state is not self.state:
            self.state = state
            if state in (BusState.WARNING, BusState.PASSIVE):
                self._report(FaultKind.BUS, f"CAN bus {self._settings} is {state}: check wiring")

    def _report(self, kind: FaultKind, detail: str) -> None:
        with self._lock:
            self._faults.append(Fault(kind, detail))
        self._wake()

    def _wake(self) -> None:
        try:
            self._notify()
        except Exception as error:  # must not end the thread, nor look like a loss of the bus
            with self._lock:
                self._faults.append(Fault(FaultKind.BUS, f"nobody to wake up: {_shown(error)}"))

    def __enter__(self) -> Self:
        return self.open()

    def __exit__(self, *_: object) -> None:
        self.close()


def _stamps(received: float) -> tuple[int, float]:
    """Wall clock [ns] and steady clock [s] at reception, from the stamp of the back end [s].

    Both clocks are read at one instant: a thread that is held up between the two would shift them.
    """
    for _ in range(constants.CLOCK_READ_ATTEMPTS):
        before, now, after = time.monotonic(), time.time_ns(), time.monotonic()
        if after - before < constants.READ_TOGETHER_S:
            break
    stamp = round(received * 1e9)
    age = now - stamp
    if not 0 <= age < constants.OLDEST_STAMP_S * 1e9:
        return now, before
    return stamp, before - age * 1e-9


def _shown(error: Exception) -> str:
    return str(error) if isinstance(error, BusError) else f"{type(error).__name__}: {error}"
