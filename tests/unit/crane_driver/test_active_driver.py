"""A driver whose process is stopped anywhere within its loop says that first."""

import time
from types import SimpleNamespace
from typing import Any

import pytest
from unit.crane_driver.test_driver_loop import Bench

from crane_driver import active_driver, load_layout
from crane_driver.active_driver import ActiveDriver
from crane_driver.can.frame import Frame
from crane_driver.safety.supervisor import SafetyState
from crane_model import load_machine
from crane_model.machine_files import machine_file

STOP = 0.3  # s; commands time out after 0.1 s, a stall is one after 0.05 s
PLACES = ("take", "publish pressures", "publish joints", "send", "publish valves")


class World:
    """Bus, topics and clock of a driver; the process is stopped once, at one place of its loop."""

    def __init__(self, bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
        self.bench, self.stopped_at, self.stops = bench, "", 0
        clock = SimpleNamespace(
            monotonic=lambda: bench.now, process_time=time.process_time, time_ns=time.time_ns
        )
        monkeypatch.setattr(active_driver, "time", clock)
        node: Any = SimpleNamespace(get_logger=lambda: None)
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
        return frames

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
