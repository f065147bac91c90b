"""The crane on simulated time: each cycle waits for its answer, and for no dead driver."""

import threading
import time
from collections.abc import Callable, Iterator
from uuid import uuid4

import pytest

from crane_driver import BusSettings, Link
from crane_driver.can.frame import START_NS, STEP, TIME, Frame, step_frame, time_frame, told_time
from crane_sim import simulated_crane
from crane_sim.simulated_crane import LockStep

PERIOD = 0.005  # s
CYCLE = 5_000_000  # ns
PATIENCE = 60.0  # s, bounds a failing test
COMMAND = Frame(0x110, bytes(8))


class Bench:
    """The crane's end of a bus, and a driver that is played."""

    def __init__(self) -> None:
        bus = BusSettings(interface="virtual", channel=uuid4().hex)
        self.stop, woken = threading.Event(), threading.Event()
        self.crane = Link(bus, woken.set, cycle=frozenset({STEP})).open()
        self.driver = Link(bus).open()
        self.pace = LockStep(self.crane, woken, PERIOD)
        self.heard: list[Frame] = []

    def cycle(self, answer: Callable[[], None]) -> None:
        """One cycle, which `answer` ends in the place of the driver."""
        thread = threading.Thread(target=answer)
        thread.start()
        self.pace.wait(self.stop, [time_frame(self.pace.time)])
        thread.join()

    def answers(self, *frames: Frame) -> None:
        for frame in frames:
            self.driver.send(frame)

    def until_heard(self, count: int) -> None:
        """Wait until the crane has sent so many frames."""
        deadline = time.monotonic() + PATIENCE
        while len(self.heard) < count:
            assert time.monotonic() < deadline, "waited in vain"
            self.heard += self.driver.take()
            time.sleep(1e-3)


@pytest.fixture
def bench() -> Iterator[Bench]:
    one = Bench()
    yield one
    one.driver.close()
    one.crane.close()


def test_a_cycle_ends_with_its_answer_whose_frames_bear_its_time(bench: Bench) -> None:
    bench.cycle(lambda: bench.answers(COMMAND, step_frame(START_NS)))
    assert bench.pace.time == START_NS + CYCLE
    first = bench.pace.answer[0]
    assert (first.id, first.stamp) == (COMMAND.id, START_NS)
    assert first.steady == pytest.approx(1.0)
    assert bench.pace.after == pytest.approx(1.0 + 2 * PERIOD)


def test_the_frames_of_a_cycle_are_repeated_until_it_is_answered(bench: Bench) -> None:
    def late() -> None:
        bench.until_heard(3)
        bench.answers(step_frame(START_NS - CYCLE), step_frame(START_NS))  # an old one is none

    bench.cycle(late)
    assert {told_time(one, TIME) for one in bench.heard} == {START_NS}


def test_a_driver_that_was_never_there_is_waited_for(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(simulated_crane, "PATIENCE_S", 0.0)

    def late() -> None:
        bench.until_heard(5)
        bench.answers(step_frame(START_NS))

    bench.cycle(late)
    assert len(bench.heard) >= 5


def test_time_goes_on_without_a_driver_that_died_and_waits_for_one_that_comes(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(simulated_crane, "PATIENCE_S", 0.3)
    bench.cycle(lambda: bench.answers(step_frame(START_NS)))
    begun = time.monotonic()
    for _ in range(4):  # nobody answers
        bench.cycle(lambda: None)
    assert time.monotonic() - begun >= 0.3, "at first it might only be slow"
    assert bench.pace.time == START_NS + 5 * CYCLE
    bench.cycle(lambda: bench.answers(step_frame(START_NS + 5 * CYCLE)))
    begun = time.monotonic()
    bench.cycle(lambda: None)
    assert time.monotonic() - begun >= 0.3, "it is waited for again"


def test_a_crane_that_is_stopped_waits_for_nobody(bench: Bench) -> None:
    bench.stop.set()
    bench.cycle(lambda: None)
    assert "s of simulated time in" in bench.pace.summary
