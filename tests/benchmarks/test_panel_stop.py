"""How long a stop takes from the line of the operator's page to the bus, while the crane moves."""

import threading
import time
from collections.abc import Callable, Iterator

import numpy as np
import pytest
from integration.driver_stage import Stage, commander

pytest.importorskip("websockets", reason="websockets is not installed (make view)")

from integration.panel_visits import Served, served, visit

STOPS = 20
AT_MOST = 0.2  # s


@pytest.fixture(scope="module")
def stage(ros_domain: int, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Stage]:
    one = Stage(tmp_path_factory.mktemp("driver"), [], real_time=True)
    yield one
    one.close()


@pytest.fixture(scope="module")
def panel(stage: Stage) -> Iterator[Served]:
    with served() as one:
        yield one


def test_stop_of_the_page_is_at_the_valves_within_200_ms(
    stage: Stage,
    panel: Served,
    measured: Callable[..., None],
) -> None:
    took = []
    with commander(stage) as hand, visit(panel) as page:

        def show() -> None:
            for told in page:  # until it is closed
                if "picture" in str(told):
                    page.send('{"seen": ""}')

        threading.Thread(target=show, daemon=True).start()
        for stop in range(STOPS):
            stage.moving(hand, slew=0.1 if stop % 2 else -0.1)
            count, asked = len(stage.valves), time.monotonic()
            page.send('{"request": "stop"}')
            stage.until(lambda count=count: not all(one.enabled for one in stage.valves[count:]))
            shut = next(one for one in stage.valves[count:] if not one.enabled)
            took.append(shut.steady - asked)
            stage.until(lambda: stage.safety[0] == "emergency stop")
            stage.disabled()
    measured(
        f"stop from the page's line to neutral valves on the bus, {STOPS} stops: median, longest",
        f"{AT_MOST * 1e3:.0f} ms",
        "{median:.0f} ms, {longest:.0f} ms",
        median=1e3 * float(np.median(took)),
        longest=1e3 * max(took),
    )
    assert min(took) > 0.0
    assert max(took) < AT_MOST
