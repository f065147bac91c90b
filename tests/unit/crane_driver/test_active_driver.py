"""A driver whose process is stopped anywhere within its loop says that first."""

import time
from types import SimpleNamespace
from typing import Any

import pytest
from unit.crane_driver.test_driver_loop import EPOCH, Bench

from crane_driver import active_driver, load_layout
from crane_driver.active_driver import ActiveDriver
from crane_driver.can.frame import Frame
from crane_driver.safety.supervisor import SafetyState
from crane_interfaces.msg import SensorFindings
from crane_model import load_machine
from crane_model.machine_files import machine_file
from crane_nodes.node_time import stamp_of

STOP = 0.3  # s; commands time out after 0.1 s, a stall is one after 0.05 s
PLACES = ("take", "publish pressures", "publish joints", "send", "publish valves")


class World:
    """Bus, topics and clock of a driver; the process is stopped once, at one place of its loop."""

    def __init__(self, bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
        self.bench, self.stopped_at, self.stops = bench, "", 0
        self.set_back, self.said = 0.0, list[str]()  # s, of the wall clock; warnings
        clock = SimpleNamespace(
            monotonic=lambda: bench.now, process_time=time.process_time, time_ns=time.time_ns
        )
        monkeypatch.setattr(active_driver, "time", clock)
        log = SimpleNamespace(warning=self.said.append, error=print, info=print)
        node: Any = SimpleNamespace(get_logger=lambda: log)
        link: Any = SimpleNamespace(
            take=self._taken, take_faults=list, send=self.does("send"), heard=lambda now: now
        )
        joints, pressures, valves = (
            self.topic(f"publish {name}") for name in ("joints", "pressures", "valves")
        )
        self.driver = ActiveDriver(node, bench.loop, link, joints, pressures, valves, lambda: None)

    def topic(self, name: str) -> Any:
        return SimpleNamespace(publish=self.does(name))

    def does(self, what: str) -> Any:
        def done(_: object) -> None:
            if self.stopped_at == what:
                self.stopped_at, self.stops = "", self.stops + 1
                self.bench.now += STOP

        return done

    def _taken(self, _: int) -> list[Frame]:
        frames = self.bench.frames()
        self.does("take")(None)
        back = round(self.set_back * 1e9)
        return [frame._replace(stamp=frame.stamp - back) for frame in frames]

    def command(self, opening: float) -> None:
        """It comes, and then the frames of a cycle."""
        self.bench.loop.supervisor.command(["slew"], [opening], self.bench.now)
        self.driver.receive()


@pytest.mark.parametrize("place", PLACES)
def test_a_process_that_was_stopped_says_so_before_all_that_follows_from_it(
    place: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    layout = load_layout(load_machine(), machine_file("can.yaml"), machine_file("can.dbc"))
    bench = Bench(layout).learnt()
    bench.run(30)
    assert bench.loop.supervisor.state is SafetyState.DISABLED
    world = World(bench, monkeypatch)
    world.command(0.0)
    bench.loop.supervisor.enable(bench.now)
    for _ in range(5):
        world.command(0.3)
    assert bench.loop.supervisor.state is SafetyState.ENABLED
    world.stopped_at = place
    while not bench.loop.supervisor.faults:
        world.driver.receive()
    assert world.stops == 1
    assert str(bench.loop.supervisor.faults.first).startswith("stalled")


def test_what_is_found_when_the_clock_was_set_back_is_heeded(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """By its stamp it was found before the driver began."""
    layout = load_layout(load_machine(), machine_file("can.yaml"), machine_file("can.dbc"))
    bench = Bench(layout).learnt()
    bench.run(30)
    world = World(bench, monkeypatch)
    world.driver._begun = EPOCH
    world.command(0.0)
    for back in (0.2, 3600.0):
        world.set_back += back
        world.command(0.0)
    assert [text.partition(":")[0] for text in world.said] == [
        f"the clock was set back by {back} s" for back in (0.2, 3600.0)
    ]
    found = SensorFindings(joint=["slew"], sensor=["slew encoder"], kind=["scale"])
    found.dangerous, found.header.stamp = [True], stamp_of(EPOCH - 3000 * 10**9)
    world.driver._found(found)
    assert bench.loop.supervisor.state is SafetyState.FAULT
