"""The live loop for a minute at 200 Hz: nothing may be lost, and the way round is short.

Simulated crane, driver, controller and recorder are processes. This one listens to their bus: it
knows what was there to be published.
"""

import os
from collections.abc import Callable
from pathlib import Path

import numpy as np
from benchmarks.live_loop import (
    ENCODERS,
    PRESSURES,
    TOPICS,
    Loop,
    cycles,
    edge,
    measured_loop,
    percentiles,
    ways,
)

MEASURED = float(os.environ.get("CRANE_LIVE_SECONDS", "60"))  # s
P50, P99 = 2.0, 5.0  # ms, encoder frame to valve frame
HOPS = (
    "the other frames of its cycle",
    "last of these frames to joint state, published",
    "joint state to valve command, published",
    "valve command to valve frame",
)


def test_no_message_is_lost_in_a_minute_at_200_hz(
    ros_domain: int, tmp_path: Path, measured: Callable[..., None]
) -> None:
    report(measured_loop(tmp_path, MEASURED, realtime=True), measured)


def latencies(
    measured: Callable[..., None], what: str, times: np.ndarray, target: str = ""
) -> None:
    """A row with percentiles of times [ms]."""
    p50, p99 = np.percentile(times, [50, 99])
    text = "{p50:.2f}, {p99:.1f}, {longest:.1f} ms"
    measured(f"{what}: p50, p99, max", target, text, p50=p50, p99=p99, longest=times.max())


def report(loop: Loop, measured: Callable[..., None]) -> None:
    bus, bag, window, least, busy, realtime, told = loop
    sent = {"/joint_states": cycles(bus, ENCODERS), "/cylinder_pressures": cycles(bus, PRESSURES)}
    encoders = sent["/joint_states"]
    kept = (encoders.received >= window[0]) & (encoders.received < window[1])
    late = (encoders.received - encoders.sampled)[kept] * 1e-6
    rate = np.count_nonzero(kept) / MEASURED
    print(f"\n{MEASURED:.0f} s, {rate:.1f} cycles/s on the bus; {told}")
    print("topic                  on the bus   published   in the bag   lost")
    lost = {}
    shift = np.empty(0)
    for topic in TOPICS:
        one = bag[topic]
        due = sent.get(topic, sent["/joint_states"]).sampled  # the controller answers these
        begin, end = (edge(instant, due, one.stamp) for instant in window)
        kept = (one.stamp >= begin) & (one.stamp < end)
        expected = due[(due >= begin) & (due < end)]
        published = int(np.ptp(one.sequence[kept])) + 1
        # What the controller was too busy to answer is not lost, it was never published.
        due_here = len(expected) if topic in sent else published
        lost[topic] = max(published, due_here) - int(kept.sum())
        print(f"{topic:22s} {len(expected):11d} {published:11d} {kept.sum():12d} {lost[topic]:6d}")
        if topic == "/joint_states" and not lost[topic]:
            shift = np.abs(one.stamp[kept] - expected) * 1e-6
    states = bag["/joint_states"]
    delay = (states.received - states.stamp) * 1e-6
    hops = ways(bus, bag, window)
    whole = (hops[:, -1] - hops[:, 0]) * 1e-6
    print(f"encoder frame: received after it was sampled             {percentiles(late)}")
    if shift.size:
        print(f"joint state: stamp after the instant of sampling         {percentiles(shift)}")
    print(f"joint state: received in the recorder after its stamp    {percentiles(delay)}")
    print(f"encoder frame -> valve frame, {len(whole):5d} loops             {percentiles(whole)}")
    for k, hop in enumerate(HOPS):
        print(f"    {hop:52s} {percentiles(np.diff(hops)[:, k] * 1e-6)}")
    print("    (commands that come within half a cycle of another go with the next valve frame)")
    print(f"encoder frame -> frame, python-can alone, {len(least):4d} loops  {percentiles(least)}")
    how = "all but the recorder in real time" if realtime else "the driver in real time"
    measured(
        f"{MEASURED:.0f} s at 200 Hz, machine, driver, controller and recorder as processes, "
        f"{how}: cycles on the bus; lost of states, pressures, commands",
        "0, 0, 0",
        "{cycles:,.0f}; {states:.0f}, {pressures:.0f}, {commands:.0f}",
        cycles=rate * MEASURED,
        states=lost[TOPICS[0]],
        pressures=lost[TOPICS[1]],
        commands=lost[TOPICS[2]],
    )
    measured(
        f"cores busy meanwhile, of {os.cpu_count()}: by the loop and its listener; by other work",
        "",
        "{loop:.2f}; {others:.2f}",
        **busy._asdict(),
    )
    latencies(measured, "encoder frame received after it was sampled", late)
    if shift.size:
        latencies(measured, "stamp of the joint state after the instant of sampling", shift)
    latencies(measured, "encoder frame to valve frame", whole, f"p50 {P50:g}, p99 {P99:g} ms")
    for k, hop in enumerate(HOPS):
        latencies(measured, f"of this: {hop}", np.diff(hops)[:, k] * 1e-6)
    latencies(
        measured, "encoder frame to frame by python-can alone, without ROS, in the same run", least
    )
    assert not any(lost.values()), lost
    assert (np.diff(states.stamp) > 0).all()
    assert len(whole) > rate * MEASURED / 2
    assert (np.percentile(whole, [50, 99]) <= [P50, P99]).all(), busy
