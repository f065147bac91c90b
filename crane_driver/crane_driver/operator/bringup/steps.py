"""The steps of a bring-up: dialogue and measurement of each."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np

from crane_driver import constants
from crane_driver.operator.bringup import motion
from crane_driver.operator.bringup.bench import Bench
from crane_driver.operator.bringup.estimates import (
    ENCODER_TURN_RAD,
    DeadBandResult,
    EncoderResult,
    RampFit,
    Rest,
    StepResponse,
    average,
    find_encoder,
    find_offset,
    find_polarity,
    first_gains,
    fit_dead_band,
    fit_step,
    moved,
)
from crane_driver.operator.bringup.motion import Mover
from crane_driver.operator.bringup.pictures import (
    BAR_PA,
    EncoderTrace,
    draw_dead_bands,
    draw_encoders,
    draw_gains,
    draw_pressures,
    draw_valves,
)
from crane_driver.operator.bringup.results import (
    CONTROLLER_FILE,
    DeadBands,
    copy_changed,
    significant,
)
from crane_model.configuration import read_yaml
from crane_model.errors import ConfigurationError, DataError

DIRECTIONS = {1: "positive", -1: "negative"}
Runs: TypeAlias = dict[int, list[RampFit]]  # by direction

MOVES_BY_ITSELF = """This step moves the crane by itself: {what}
Nobody within its reach. The emergency stop of the machine in your hand. Unloaded, engine at idle,
every joint far from its limits, from ground and pillar. Ctrl-C: neutral, disabled, end."""


def unhurried(bench: Bench, mover: Mover) -> tuple[float, Runs]:
    """Ramps in both directions at the rate of the protocol; where the joint does not follow that,
    at half of it and so on, until two rates agree. The rate [1/s] and its ramps.
    """
    rate, faster = bench.protocol.rate, None
    while True:
        runs = _ramps(bench, mover, rate)
        last = {direction: done[-1].fit for direction, done in runs.items()}
        hurried = any(fit.hurried for fit in last.values())
        if not hurried and (faster is None or all(last[d].agrees(faster[d]) for d in last)):
            return rate, runs
        late = max(last.values(), key=lambda fit: fit.lag / fit.opened)
        what = (
            f"{mover.joint}: answers {late.lag * 1e3:.0f} ms late to a ramp of {rate:.3g}/s, which "
            f"opens its valve for {late.opened:.1f} s"
            if hurried
            else f"{mover.joint}: a ramp of {rate:.3g}/s gives another valve than a faster one"
        )
        if rate / 2.0 < bench.protocol.rate / constants.SLOWEST_RATE_RATIO:
            raise DataError(f"{what}: that determines no dead band; give a smaller --rate")
        rate, faster = rate / 2.0, last
        bench.terminal.say(f"  {what}; again with {rate:.3g}/s")


def _ramps(bench: Bench, mover: Mover, rate: float) -> Runs:
    protocol = bench.protocol
    runs: Runs = {1: [], -1: []}
    ramp = partial(motion.triangle, rate=rate, speed=protocol.speed, limit=protocol.limit)
    for _ in range(protocol.repeats):
        for direction, done in runs.items():
            trace = bench.driven(mover, partial(ramp, direction=direction))
            name = f"{mover.joint}, {DIRECTIONS[direction]} direction"
            done.append(RampFit(trace, fit_dead_band(name, trace, direction)))
        if any(done[-1].fit.hurried for done in runs.values()):
            break
    return runs


def encoders(bench: Bench) -> None:
    """Zero and sign of the encoders, by a known pose and a movement of each joint."""
    terminal = bench.terminal
    terminal.say(
        "Encoder zero and sign. You move each joint by the levers of the crane itself; the driver\n"
        "stays disabled. Nobody else within reach of the crane. Have the instruments ready:"
    )
    for joint in bench.joints:
        note = bench.notes[joint]
        terminal.say(f"  {joint}: by {note.ruler}; positive: {note.positive}")
    measured: dict[str, tuple[EncoderTrace, EncoderResult]] = {}
    for joint in bench.joints:
        while joint not in measured:
            try:
                measured[joint] = _encoder(bench, joint)
            except DataError as error:
                terminal.say(f"  {error}")
                kept = f"; {', '.join(measured)} is kept" if measured else ""
                terminal.confirm(f"{joint} is not measured{kept}. Measure it again?")
    results = {joint: result for joint, (_, result) in measured.items()}
    traces = {joint: trace for joint, (trace, _) in measured.items()}
    run = bench.finish(
        "encoders",
        results,
        draw_encoders(traces, results, bench.units),
        seconds=bench.protocol.seconds,
    )

    def change(content: Any) -> None:
        for joint, result in results.items():
            content["positions"][joint]["sign"] = result.sign
            content["positions"][joint]["zero"] = significant(result.zero)

    bench.new_mapping(run, change)


def pressures(bench: Bench) -> None:
    """Offsets of the pressure transducers, with the chambers vented."""
    terminal = bench.terminal
    terminal.say(
        "Pressure zero. The booms sink when their chambers are vented: lower the crane onto its\n"
        "supports first, stop the engine, then move every lever to and fro until no pressure is\n"
        "left, and open the bleed of the accumulator if there is one."
    )
    terminal.confirm("Engine stopped, crane on its supports, chambers and supply vented?")
    readings = bench.crane.record_pressures(bench.protocol.seconds)
    readings = {name: readings[name] for name in bench.layout.pressures}
    results = {name: find_offset(name, values) for name, values in readings.items()}
    for name, result in results.items():
        remark = "  all readings are the same: is it alive?" if result.stuck else ""
        terminal.say(
            f"  {name:13} {result.offset / BAR_PA:+7.3f} bar, spread "
            f"{result.spread / BAR_PA:.3f}{remark}"
        )
    run = bench.finish(
        "pressures", results, draw_pressures(readings, results), seconds=bench.protocol.seconds
    )

    def change(content: Any) -> None:
        for name, result in results.items():
            entry = content["pressures"][name]
            entry["zero"] = significant(float(entry.get("zero", 0.0)) + result.offset)

    bench.new_mapping(run, change)


def _encoder(bench: Bench, joint: str) -> tuple[EncoderTrace, EncoderResult]:
    """One joint. Each reference is what the encoder shows from the moment of its answer on, so
    that nothing depends on how long the operator takes from one to the next.
    """
    terminal, crane = bench.terminal, bench.crane
    unit, size = ("m", 1.0) if bench.units[joint] == "m" else ("deg", np.pi / 180.0)
    index = crane.joints.index(joint)
    known = terminal.number(
        f"{joint}: let it stand still. Where is it, by {bench.notes[joint].ruler} [{unit}]?",
        -360.0,
        360.0,
    )
    before = bench.rests()
    answer = terminal.number_or_none(
        f"{joint}: now move it in its positive direction, at least {5 if size < 1 else 0.1:g} "
        f"{unit}, let it stand, and enter where it is now [{unit}]; Enter alone: not measured",
        -360.0,
        360.0,
    )
    samples = list(crane.samples)  # from the first answer to the second
    after = bench.rests()
    time = np.array([sample.time for sample in samples])
    trail = _unwrapped(
        [bench.units[name] for name in crane.joints],
        np.array([sample.position for sample in samples]),
        after,
    )
    moves = [moved(time, trail[:-1, i], rest) for i, rest in enumerate(before)]
    displacements = trail[-1] - [rest.position for rest in before]
    _only_moved(joint, crane.joints, moves, before)
    # the driver shows sign * (reading - zero) by its mapping; the readings are what counts
    entry, first = bench.positions[joint], before[index]
    rest = replace(
        first, position=entry.sign * first.position + entry.zero, sinking=entry.sign * first.sinking
    )
    result = find_encoder(
        joint,
        rest,
        known * size,
        entry.sign * moves[index],
        entry.sign * displacements[index],
        None if answer is None else answer * size,
    )
    scale = "" if result.scale is None else f", scale {result.scale:.4f}"
    terminal.say(
        f"  sign {result.sign:+d}, zero {result.zero:.5f} {bench.units[joint]}, noise "
        f"{result.noise:.2g}, resolution {result.resolution:.2g}, moved {result.moved:.4g}{scale}"
    )
    for neighbour, displacement, move, was in zip(
        crane.joints, displacements, moves, before, strict=True
    ):
        if abs(sunk := displacement - move) > was.movement:
            unit = bench.units[neighbour]
            terminal.say(
                f"  {neighbour} has sunk by {sunk:+.2g} {unit} meanwhile, at first "
                f"{was.sinking * 60.0:+.2g} {unit}/min; this is allowed for, if you "
                "enter each value as soon as it is read"
            )
    trace = EncoderTrace(time - time[0], entry.sign * trail[:-1, index] + entry.zero)
    return trace, result


def _unwrapped(units: Sequence[str], positions: np.ndarray, after: Sequence[Rest]) -> np.ndarray:
    """Positions (n, j) and behind them the rest after them, without the wraps of encoders."""
    trail = np.vstack([positions, [rest.position for rest in after]])
    for i, unit in enumerate(units):
        if unit == "rad":
            trail[:, i] = np.unwrap(trail[:, i], period=ENCODER_TURN_RAD)
    return trail


def _only_moved(
    joint: str, joints: Sequence[str], moves: Sequence[float], before: Sequence[Rest]
) -> None:
    for neighbour, move, rest in zip(joints, moves, before, strict=True):
        allowed = constants.SHAKEN_MOVEMENTS * rest.movement
        if neighbour != joint and abs(move) > allowed:
            raise DataError(
                f"{neighbour} was moved by {move:+.3g} while {joint} was measured, allowed "
                f"±{allowed:.3g}, what it sinks not counted; move one joint alone. If you did, two "
                "encoders are exchanged"
            )


def valves(bench: Bench) -> None:
    """Polarity of the valves, by the smallest opening that moves each joint."""
    protocol = bench.protocol
    bench.terminal.say(
        MOVES_BY_ITSELF.format(
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
        results[joint] = result = find_polarity(joint, up, down)
        traces[joint] = mover.trace(0)
        bench.terminal.say(
            f"  {up.moved:+.2g} at {up.command:+.3f}, {down.moved:+.2g} at {down.command:+.3f}: "
            f"polarity {result.polarity:+d}, sign in the mapping "
            f"{'stays' if result.polarity > 0 else 'changes'}"
        )
    figure = draw_valves(traces, results, bench.units)
    run = bench.finish("valves", results, figure, rate=protocol.rate, limit=protocol.limit)

    def change(content: Any) -> None:
        for joint, result in results.items():
            entry = content["commands"][joint]
            entry["sign"] = result.polarity * int(entry.get("sign", 1))

    bench.new_mapping(run, change)


def dead_band(bench: Bench) -> None:
    """Dead band of each valve in both directions."""
    protocol = bench.protocol
    bench.terminal.say(
        MOVES_BY_ITSELF.format(
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
                direction: average([ramp.fit for ramp in done], rate)
                for direction, done in runs.items()
            }
            bench.driven(mover, _return(averages, protocol.speed))
        fits[joint], results[joint] = runs, averages
        for direction, result in averages.items():
            bench.terminal.say(
                f"  {DIRECTIONS[direction]}: {result.dead_band:.4f} ± {result.dead_band_std:.4f}, "
                f"then {result.gain:.3g} {bench.units[joint]}/s per command, lag "
                f"{result.lag * 1e3:.0f} ms"
            )
    named = {
        joint: DeadBands(positive=both[1], negative=both[-1]) for joint, both in results.items()
    }
    figure = draw_dead_bands(fits, results, bench.units)
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
        MOVES_BY_ITSELF.format(
            what=f"each valve is opened at once, so that\nits joint moves at {protocol.speed:g} "
            "rad/s or m/s for less than a second, once in each direction."
        )
    )
    fits: dict[str, list[StepResponse]] = {}
    results = {}
    for joint in bench.joints:
        entry = _controller_entry(base, joint, controller)
        bench.terminal.confirm(f"{joint}: measure its step response?")
        fits[joint] = []
        both = bands[joint]
        duration = min(
            constants.LONGEST_STEP_RESPONSE_S,
            constants.STEP_TRAVEL_SHARE * protocol.travel / protocol.speed,
        )
        with bench.moving(joint) as mover:
            for direction, band in ((1, both.positive), (-1, both.negative)):
                beyond = direction * protocol.speed / band.gain
                command = direction * band.dead_band + beyond
                ramp = partial(
                    motion.step, command=command, duration=duration, limit=protocol.limit
                )
                trace = bench.driven(mover, ramp)
                name = f"{joint}, {DIRECTIONS[direction]} direction"
                fits[joint].append(StepResponse(trace, fit_step(name, trace, beyond)))
            bench.driven(mover, _return({1: both.positive, -1: both.negative}, protocol.speed))
        results[joint] = result = first_gains(
            [response.fit for response in fits[joint]],
            protocol.time_constant,
            min(both.positive.dead_band, both.negative.dead_band),
            float(entry["position_tolerance"]),
        )
        bench.terminal.say(
            f"  kp {result.kp:.3g}, kd {result.kd:.3g}, for a closed loop of "
            f"{result.time_constant:.2f} s"
        )
    run = bench.finish(
        "gains",
        results,
        draw_gains(fits, results, bench.units),
        speed=protocol.speed,
        time_constant=protocol.time_constant,
    )

    def change(content: Any) -> None:
        for joint, result in results.items():
            content[joint] |= {
                "kp": significant(result.kp),
                "kd": significant(result.kd),
                "dead_band_positive": significant(bands[joint].positive.dead_band),
                "dead_band_negative": significant(bands[joint].negative.dead_band),
                "position_tolerance": significant(result.position_tolerance),
            }

    kept = ", ".join(joint for joint in base if joint not in results)
    target = run / CONTROLLER_FILE
    copy_changed(controller, target, change, f"{run.name}, measured; from {controller}")
    bench.terminal.say(
        f"gains: {target}"
        + (f"; {kept}: as in {controller}" if kept else "")
        + f"; for the trajectory node: -p controller:={target.resolve()}"
    )


def _return(bands: dict[int, DeadBandResult], speed: float) -> Callable[[Mover], None]:
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
