"""The steps that only listen: zeros and signs of the encoders, offsets of the transducers."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from crane_driver.operator.bringup import pictures
from crane_driver.operator.bringup.bench import Bench
from crane_driver.operator.bringup.motion import OTHERS
from crane_driver.operator.bringup.samples import ROTARY, Rest, moved
from crane_driver.operator.bringup.sensors import EncoderResult, find_encoder, find_offset
from crane_driver.operator.bringup.series import significant
from crane_model.errors import DataError

BAR = 1e5  # Pa
Trace = tuple[np.ndarray, np.ndarray]  # time [s] and readings [rad, m], (n,)


def encoders(bench: Bench) -> None:
    """Zero and sign of the encoders, by a known pose and a movement of each joint."""
    terminal = bench.terminal
    terminal.say(
        "Encoder zero and sign. You move each joint by the levers of the crane itself; the driver\n"
        "stays disabled. Nobody within reach of the crane but who moves it. Have at hand by what\n"
        "the position of each joint is measured:"
    )
    for joint in bench.joints:
        note = bench.notes[joint]
        terminal.say(f"  {joint}: by {note.ruler}; positive: {note.positive}")
    measured: dict[str, tuple[Trace, EncoderResult]] = {}
    for joint in bench.joints:
        while joint not in measured:
            try:
                measured[joint] = _encoder(bench, joint)
            except DataError as error:
                terminal.say(f"  {error}")
                kept = f"; {', '.join(measured)} is kept" if measured else ""
                terminal.confirm(f"{joint} is not measured{kept}. Measure it again?")
    results = {joint: one for joint, (_, one) in measured.items()}
    traces = {joint: trace for joint, (trace, _) in measured.items()}
    run = bench.finish(
        "encoders",
        results,
        pictures.encoders(traces, results, bench.units),
        seconds=bench.protocol.seconds,
    )

    def change(content: Any) -> None:
        for joint, one in results.items():
            content["positions"][joint]["sign"] = one.sign
            content["positions"][joint]["zero"] = significant(one.zero)

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
    for name, one in results.items():
        remark = "  all readings are the same: is it alive?" if one.stuck else ""
        terminal.say(
            f"  {name:13} {one.offset / BAR:+7.3f} bar, spread {one.spread / BAR:.3f}{remark}"
        )
    run = bench.finish(
        "pressures", results, pictures.pressures(readings, results), seconds=bench.protocol.seconds
    )

    def change(content: Any) -> None:
        for name, one in results.items():
            entry = content["pressures"][name]
            entry["zero"] = significant(float(entry.get("zero", 0.0)) + one.offset)

    bench.new_mapping(run, change)


def _encoder(bench: Bench, joint: str) -> tuple[Trace, EncoderResult]:
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
    time = np.array([one.time for one in samples])
    trail = _unwrapped(
        [bench.units[one] for one in crane.joints],
        np.array([one.position for one in samples]),
        after,
    )
    moves = [moved(time, trail[:-1, i], rest) for i, rest in enumerate(before)]
    ways = trail[-1] - [rest.position for rest in before]
    _only_moved(joint, crane.joints, moves, before)
    # the driver shows sign * (reading - zero) by its mapping; the readings are what counts
    entry, first = bench.positions[joint], before[index]
    rest = replace(
        first,
        position=entry.sign * first.position + entry.zero,
        sinking=entry.sign * first.sinking,
    )
    one = find_encoder(
        joint,
        rest,
        known * size,
        entry.sign * moves[index],
        entry.sign * ways[index],
        None if answer is None else answer * size,
    )
    scale = "" if one.scale is None else f", scale {one.scale:.4f}"
    terminal.say(
        f"  sign {one.sign:+d}, zero {one.zero:.5f} {bench.units[joint]}, noise "
        f"{one.noise:.2g}, resolution {one.resolution:.2g}, moved {one.moved:.4g}{scale}"
    )
    for other, way, move, was in zip(crane.joints, ways, moves, before, strict=True):
        if abs(sunk := way - move) > was.movement:
            terminal.say(
                f"  {other} has sunk by {sunk:+.2g} {bench.units[other]} meanwhile, at first "
                f"{was.sinking * 60.0:+.2g} {bench.units[other]}/min; this is allowed for, if you "
                "enter each value as soon as it is read"
            )
    trace = time - time[0], entry.sign * trail[:-1, index] + entry.zero
    return trace, one


def _unwrapped(units: Sequence[str], positions: np.ndarray, after: Sequence[Rest]) -> np.ndarray:
    """Positions (n, j) and behind them the rest after them, without the wraps of encoders."""
    trail = np.vstack([positions, [rest.position for rest in after]])
    for i, unit in enumerate(units):
        if unit == "rad":
            trail[:, i] = np.unwrap(trail[:, i], period=ROTARY)
    return trail


def _only_moved(
    joint: str, joints: Sequence[str], moves: Sequence[float], before: Sequence[Rest]
) -> None:
    for other, move, rest in zip(joints, moves, before, strict=True):
        allowed = OTHERS * rest.movement
        if other != joint and abs(move) > allowed:
            raise DataError(
                f"{other} was moved by {move:+.3g} while {joint} was measured, allowed "
                f"±{allowed:.3g}, what it sinks not counted; move one joint alone. If you did, two "
                "encoders are exchanged"
            )
