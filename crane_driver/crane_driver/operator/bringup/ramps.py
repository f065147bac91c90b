"""Ramps of the command as slow as the joint asks for."""

from functools import partial
from typing import TypeAlias

from crane_driver.operator.bringup import motion
from crane_driver.operator.bringup.bench import Bench
from crane_driver.operator.bringup.motion import Mover
from crane_driver.operator.bringup.samples import Trace
from crane_driver.operator.bringup.valves import DeadBandFit, fit_dead_band
from crane_model.errors import DataError

DIRECTIONS = {1: "positive", -1: "negative"}
Runs: TypeAlias = dict[int, list[tuple[Trace, DeadBandFit]]]  # by direction
SLOWEST = 16.0  # by which a rate is divided at most


def unhurried(bench: Bench, mover: Mover) -> tuple[float, Runs]:
    """Ramps in both directions at the rate of the protocol; where the joint does not follow that,
    at half of it and so on, until two rates agree. The rate [1/s] and its ramps.
    """
    rate, faster = bench.protocol.rate, None
    while True:
        runs = _ramps(bench, mover, rate)
        last = {direction: done[-1][1] for direction, done in runs.items()}
        hurried = any(fit.hurried for fit in last.values())
        if not hurried and (faster is None or all(last[d].agrees(faster[d]) for d in last)):
            return rate, runs
        late = max(last.values(), key=lambda fit: fit.lag / fit.opened)
        what = (
            f"{mover.joint}: answers {late.lag * 1e3:.0f} ms late to a ramp of {rate:.3g}/s, which "
            f"opens its valve for {late.opened:.1f} s"
            if hurried
            else f"{mover.joint}: a ramp of {rate:.3g}/s tells another valve than a faster one"
        )
        if rate / 2.0 < bench.protocol.rate / SLOWEST:
            raise DataError(f"{what}: that tells no dead band; give a smaller --rate")
        rate, faster = rate / 2.0, last
        bench.terminal.say(f"  {what}; again with {rate:.3g}/s")


def _ramps(bench: Bench, mover: Mover, rate: float) -> Runs:
    """As many as the protocol has; fewer where the joint does not follow one."""
    protocol = bench.protocol
    runs: Runs = {1: [], -1: []}
    ramp = partial(motion.triangle, rate=rate, speed=protocol.speed, limit=protocol.limit)
    for _ in range(protocol.repeats):
        for direction, done in runs.items():
            trace = bench.driven(mover, partial(ramp, direction=direction))
            name = f"{mover.joint}, {DIRECTIONS[direction]} direction"
            done.append((trace, fit_dead_band(name, trace, direction)))
        if any(done[-1][1].hurried for done in runs.values()):
            break
    return runs
