"""Whether this computer can run a crane in real time beside its other work."""

import time
from statistics import quantiles

import pytest

CYCLE = 0.005  # s
CYCLES = 600
WORK = 60_000  # multiplications: of the processes of a crane, the driver works longest in a cycle
MOST = 0.05  # of the cycles may be late


def need_real_time() -> None:
    """Skip unless a loop with the work of a driver holds 200 Hz; the reason has the measurement."""
    late = []
    due = time.monotonic()
    for _ in range(CYCLES):
        due += CYCLE
        for i in range(WORK):
            i * i
        time.sleep(max(0.0, due - time.monotonic()))
        late.append(time.monotonic() - due)
        due = max(due, time.monotonic() - CYCLE)
    percentile = quantiles(late, n=100)[round(100 * (1.0 - MOST)) - 1]
    if percentile > CYCLE:
        pytest.skip(
            f"real time: {MOST:.0%} of the cycles of 5 ms are more than {percentile * 1e3:.0f} ms "
            "late on this computer, limit 5 ms; run this test on a faster or less busy one"
        )
