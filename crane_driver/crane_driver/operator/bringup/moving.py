"""The steps that move the crane: polarity, dead bands and first gains."""

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

from crane_driver.operator.bringup import motion, pictures
from crane_driver.operator.bringup.bench import Bench
from crane_driver.operator.bringup.motion import Mover
from crane_driver.operator.bringup.ramps import DIRECTIONS, Runs, unhurried
from crane_driver.operator.bringup.samples import Trace
from crane_driver.operator.bringup.series import CONTROLLER, DeadBands, copy_changed, significant
from crane_driver.operator.bringup.valves import (
    DeadBandResult,
    StepFit,
    average,
    find_polarity,
    first_gains,
    fit_step,
)
from crane_model.configuration import read_yaml
from crane_model.errors import ConfigurationError, DataError

RISING = 0.15  # of the travel, that a step response may take; at most `LONGEST`
LONGEST = 1.0  # s
MOVES = """This step moves the crane by itself: {what}
Nobody within its reach. The emergency stop of the machine in your hand. Unloaded, engine at idle,
every joint far from its limits, from ground and pillar. Ctrl-C: neutral, disabled, end."""


def valves(bench: Bench) -> None:
    """Polarity of the valves, by the smallest opening that moves each joint."""
    protocol = bench.protocol
    bench.terminal.say(
        MOVES.format(
            what=f"each valve opens slowly, up to\n{protocol.limit:g}, until its joint just moves."
        )
    )
    nudge = partial(motion.nudge, rate=protocol.rate, limit=protocol.limit)
    traces, results = {}, {}
    for joint in bench.joints:
        bench.terminal.confirm(f"{joint}: nudge it in both directions?")
        with bench.moving(joint) as mover:
            up = bench.driven(mover, partial(nudge, direction=1))
            down = bench.driven(mover, partial(nudge, direction=-1))
        results[joint] = one = find_polarity(joint, up, down)
        traces[joint] = mover.trace(0)
        bench.terminal.say(
            f"  {up.moved:+.2g} at {up.command:+.3f}, {down.moved:+.2g} at {down.command:+.3f}: "
            f"polarity {one.polarity:+d}, sign in the mapping "
            f"{'stays' if one.polarity > 0 else 'changes'}"
        )
    figure = pictures.valves(traces, results, bench.units)
    run = bench.finish("valves", results, figure, rate=protocol.rate, limit=protocol.limit)

    def change(content: Any) -> None:
        for joint, one in results.items():
            entry = content["commands"][joint]
            entry["sign"] = one.polarity * int(entry.get("sign", 1))

    bench.new_mapping(run, change)


def dead_band(bench: Bench) -> None:
    """Dead band of each valve in both directions."""
    protocol = bench.protocol
    bench.terminal.say(
        MOVES.format(
            what=f"each valve opens slowly until its joint\nhas a speed of {protocol.speed:g} "
            f"rad/s or m/s, and closes again, {protocol.repeats} times in each direction."
        )
    )
    fits: dict[str, Runs] = {}
    results: dict[str, dict[int, DeadBandResult]] = {}
    for joint in bench.joints:
        bench.terminal.confirm(f"{joint}: measure its dead bands?")
        with bench.moving(joint) as mover:
            rate, runs = unhurried(bench, mover)
            averages = {
                direction: average([fit for _, fit in done], rate)
                for direction, done in runs.items()
            }
            bench.driven(mover, _return(averages, protocol.speed))
        fits[joint], results[joint] = runs, averages
        for direction, one in averages.items():
            bench.terminal.say(
                f"  {DIRECTIONS[direction]}: {one.dead_band:.4f} ± {one.dead_band_std:.4f}, then "
                f"{one.gain:.3g} {bench.units[joint]}/s per command, lag {one.lag * 1e3:.0f} ms"
            )
    named = {
        joint: DeadBands(positive=both[1], negative=both[-1]) for joint, both in results.items()
    }
    figure = pictures.dead_bands(fits, results, bench.units)
    bench.finish(
        "dead_band",
        named,
        figure,
        rate=protocol.rate,
        speed=protocol.speed,
        repeats=protocol.repeats,
    )


def gains(bench: Bench, controller: Path) -> None:
    """First gains of (36), into a copy of the controller file `controller`."""
    protocol, bands = bench.protocol, bench.series.dead_bands()
    if absent := [joint for joint in bench.joints if joint not in bands]:
        raise DataError(
            f"{bench.series.folder}: no dead band of {', '.join(absent)}; first: bringup dead_band"
        )
    base = read_yaml(controller)
    bench.terminal.say(
        MOVES.format(
            what=f"each valve is opened at once, so that\nits joint moves at {protocol.speed:g} "
            "rad/s or m/s for less than a second, once in each direction."
        )
    )
    fits: dict[str, list[tuple[Trace, StepFit]]] = {}
    results = {}
    for joint in bench.joints:
        entry = _controller_entry(base, joint, controller)
        bench.terminal.confirm(f"{joint}: measure its step response?")
        fits[joint] = []
        both = bands[joint]
        duration = min(LONGEST, RISING * protocol.travel / protocol.speed)
        with bench.moving(joint) as mover:
            for direction, band in ((1, both.positive), (-1, both.negative)):
                beyond = direction * protocol.speed / band.gain
                command = direction * band.dead_band + beyond
                ramp = partial(
                    motion.step, command=command, duration=duration, limit=protocol.limit
                )
                trace = bench.driven(mover, ramp)
                name = f"{joint}, {DIRECTIONS[direction]} direction"
                fits[joint].append((trace, fit_step(name, trace, beyond)))
            bench.driven(mover, _return({1: both.positive, -1: both.negative}, protocol.speed))
        results[joint] = one = first_gains(
            [fit for _, fit in fits[joint]],
            protocol.time_constant,
            min(both.positive.dead_band, both.negative.dead_band),
            float(entry["position_tolerance"]),
        )
        bench.terminal.say(
            f"  kp {one.kp:.3g}, kd {one.kd:.3g}, for a closed loop of {one.time_constant:.2f} s"
        )
    run = bench.finish(
        "gains",
        results,
        pictures.gains(fits, results, bench.units),
        speed=protocol.speed,
        time_constant=protocol.time_constant,
    )

    def change(content: Any) -> None:
        for joint, one in results.items():
            content[joint] |= {
                "kp": significant(one.kp),
                "kd": significant(one.kd),
                "dead_zone_positive": significant(bands[joint].positive.dead_band),
                "dead_zone_negative": significant(bands[joint].negative.dead_band),
                "position_tolerance": significant(one.position_tolerance),
            }

    kept = ", ".join(joint for joint in base if joint not in results)
    target = run / CONTROLLER
    copy_changed(controller, target, change, f"{run.name}, measured; from {controller}")
    bench.terminal.say(
        f"gains: {target}"
        + (f"; {kept}: as in {controller}" if kept else "")
        + f"; for the trajectory node: -p controller:={target.resolve()}"
    )


def _return(bands: dict[int, DeadBandResult], speed: float) -> Callable[[Mover], None]:
    """Back to where the joint was, at the speed of the measurement."""
    up, down = (
        direction * (bands[direction].dead_band + speed / bands[direction].gain)
        for direction in (1, -1)
    )
    return partial(motion.back, upwards=up, downwards=down)


def _controller_entry(base: Any, joint: str, path: Path) -> dict[str, float]:
    entry = base.get(joint) if isinstance(base, dict) else None
    if not isinstance(entry, dict) or "position_tolerance" not in entry:
        raise ConfigurationError(
            f"{path}: key '{joint}.position_tolerance' is missing; name a controller file of "
            "crane_trajectory, such as the machine's controller.yaml"
        )
    return entry
