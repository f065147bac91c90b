"""A check that this computer can run the demo in real time, made before anything moves."""

import re
import time
from pathlib import Path

from laws import OUT

from crane_benchmark.rehearsal.crane_run import CraneRun
from crane_benchmark.rehearsal.live_node import (
    LEADING,
    Onlooker,
    record_to,
    start,
    start_identification,
    stop,
)
from crane_benchmark.rehearsal.processes import ProcessError, Processes
from crane_interfaces.msg import DriverState

WATCHED_S = 20.0  # at rest, with the nodes of the first act
LISTENERS = (*LEADING, "identification")
RATES = (200, 100, 50)  # Hz, of the encoders; 200 as shipped
CYCLE_TIME = re.compile(r'^(BA_ "GenMsgCycleTime" BO_ \d+ )(\d+);', re.MULTILINE)


def check(suite: Processes, domain: int, law: CraneRun, rate: int) -> None:
    """Watch the crane at rest; `ProcessError` offers a slower rate if the driver finds a fault."""
    for number, rate_tried in enumerate(rate_tried for rate_tried in RATES if rate_tried <= rate):
        suite.dbc = at_rate(law, rate_tried)
        fault = _fault(suite, domain, law, number)
        if not fault and rate_tried == rate:
            return
        if not fault:
            raise ProcessError(
                f"this computer does not hold {rate} Hz in real time, but {rate_tried} Hz: "
                f"make demo REALTIME=1 RATE={rate_tried}; "
                "or `make demo`, whose simulated time needs none"
            )
        why = fault
    raise ProcessError(
        f"this computer does not hold {RATES[-1]} Hz in real time: {why}\n"
        "end other programs and see docs/how_to/real_time.md; or `make demo`, whose simulated "
        "time needs none"
    )


def at_rate(law: CraneRun, rate: int) -> Path:
    """The DBC file of the machine with longer cycles."""
    shipped = law.file("can.dbc")
    if rate == RATES[0]:
        return shipped
    slower = RATES[0] // rate
    text = shipped.read_text(encoding="utf-8")
    path = OUT / f"can_{rate}_hz.dbc"
    path.write_text(
        CYCLE_TIME.sub(lambda found: f"{found[1]}{slower * int(found[2])};", text), encoding="utf-8"
    )
    return path


def _fault(suite: Processes, domain: int, law: CraneRun, number: int) -> str:
    """Return the fault that the driver finds within `WATCHED_S`; empty if it finds none."""
    with Onlooker(suite, domain) as onlooker:
        start(suite, law, 0, listeners=LISTENERS)
        start_identification(suite, law)
        record_to(suite, OUT / "bags" / f"real_time_{number}")
        state = onlooker.settled(LISTENERS)
        end = time.monotonic() + WATCHED_S
        while state.state == DriverState.STATE_DISABLED and time.monotonic() < end:
            suite.check()
            onlooker.executor.spin_once(timeout_sec=0.1)
            state = onlooker.driver.newest
        for name in ("recorder", "identification"):
            suite.stop(name)
        stop(suite)
    return "" if state.state == DriverState.STATE_DISABLED else f"{state.cause}; {state.remedy}"
