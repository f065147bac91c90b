"""Random events into the supervisor, ten million; frames of bad buses, two million."""

import random
import time
from collections import Counter
from collections.abc import Callable

import numpy as np
from unit.crane_driver.can.traffic import any_bus
from unit.crane_driver.driven import Driven
from unit.crane_driver.safety.any_order import Happening

from crane_driver.safety.supervisor import SafetyState

EVENTS = 10_000_000
EVENTS_A_LIFE = 100_000
FRAMES = 2_000_000
CYCLES = 600  # of a bus, before another one
SLOWEST = 50.0  # us a frame, the mean

Measured = Callable[..., None]


def test_events_in_any_order(measured: Measured) -> None:
    rng, begin = random.Random(0), time.process_time()
    events, moving, cycles = 0, 0, Counter[SafetyState]()
    while events < EVENTS:
        happening = Happening()
        while happening.events < EVENTS_A_LIFE:
            happening.anything(rng)
        events += happening.events
        moving += happening.moving
        cycles += happening.cycles
    shares = ", ".join(f"{state} {100 * n / cycles.total():.0f} %" for state, n in cycles.items())
    print(f"\n{events} events: {shares} of {cycles.total()} cycles, {moving} with an open valve")
    measured(
        "random events into the supervisor",
        "no rule broken",
        "{events:,.0f} events, no rule broken; {seconds:.0f} s",
        events=events,
        seconds=time.process_time() - begin,
    )
    assert moving > events // 1000


def test_frames_of_bad_buses(measured: Measured) -> None:
    frames, seconds = 0, 0.0
    seed, found = 0, Counter[str]()
    while frames < FRAMES:
        rng = np.random.default_rng(seed)
        driven = Driven()
        driven.drive(any_bus(rng), rng, CYCLES)
        frames, seconds, seed = frames + driven.frames, seconds + driven.seconds, seed + 1
        found += driven.found
        assert not driven.wrong, (seed - 1, driven.wrong)
    each = seconds / frames * 1e6
    print(f"\n{frames} frames of {seed} buses, {each:.1f} us each: {dict(found)}")
    measured(
        "frames of buses that lose, delay, exchange and damage them, into the driver",
        f"no set of two cycles; under {SLOWEST:.0f} µs",
        "{frames:,.0f} frames of {buses:.0f} buses, {sets:,.0f} sets, none of two cycles; "
        "{each:.0f} µs a frame",
        frames=frames,
        buses=seed,
        sets=found["positions"] + found["pressures"],
        each=each,
    )
    assert each < SLOWEST
