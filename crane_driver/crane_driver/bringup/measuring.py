"""The steps that only listen: zeros and signs of the encoders, offsets of the transducers."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from crane_driver.bringup import pictures
from crane_driver.bringup.bench import Bench
from crane_driver.bringup.encoder import EncoderResult, find_encoder
from crane_driver.bringup.motion import OTHERS
from crane_driver.bringup.pressure import find_offset
from crane_driver.bringup.samples import ROTARY, Rest
from crane_driver.bringup.series import significant
from crane_model.errors import DataError
from crane_model.machine import JOINT_UNITS

BAR = 1e5  # Pa


def encoders(bench: Bench) -> None:
    """Zero and sign of the encoders, by a known pose and a movement of each joint."""
    terminal, crane = bench.terminal, bench.crane
    terminal.say(
        "Encoder zero and sign. You move each joint by the levers of the crane itself; the driver\n"
        "stays disabled. Nobody within reach of the crane but who moves it. Have an inclinometer\n"
        "at hand, and a tape measure for the telescope. The angle of the outer boom is that to\n"
        "the inner boom: the difference of their inclinations.\n"
        "Positive: slew to the left seen from above, booms up, telescope out."
    )
    traces: dict[str, tuple[np.ndarray, np.ndarray]] = {}
    results: dict[str, EncoderResult] = {}
    for joint in bench.joints:
        unit, size, word = _asked_unit(joint)
        index = crane.joints.index(joint)
        entry = bench.positions[joint]
        known = terminal.number(
            f"{joint}: let it stand still. Where is it, {word} [{unit}]?", -360.0, 360.0
        )
        before = bench.rests()
        crane.samples.clear()
        answer = terminal.number_or_none(
            f"{joint}: now move it in its positive direction, at least {5 if size < 1 else 0.1:g} "
            f"{unit}, let it stand, and enter where it is now [{unit}]; Enter alone: not measured",
            -360.0,
            360.0,
        )
        samples = list(crane.samples)
        after = bench.rests()
        _only_moved(joint, crane.joints, before, after)
        position = np.array([one.position[index] for one in samples])
        position = np.append(position, after[index].position)
        if JOINT_UNITS[joint] == "rad":
            position = np.unwrap(position, period=ROTARY)
        # the driver shows sign * (reading - zero) by its mapping; the readings are what counts
        first = before[index]
        rest = Rest(entry.sign * first.position + entry.zero, first.noise, first.resolution)
        readings = entry.sign * position + entry.zero
        moved_to = None if answer is None else answer * size
        results[joint] = one = find_encoder(joint, rest, known * size, readings, moved_to)
        time = np.array([one.time for one in samples] + [samples[-1].time + bench.protocol.seconds])
        traces[joint] = time, readings
        scale = "" if one.scale is None else f", scale {one.scale:.4f}"
        terminal.say(
            f"  sign {one.sign:+d}, zero {one.zero:.5f} {JOINT_UNITS[joint]}, noise "
            f"{one.noise:.2g}, resolution {one.resolution:.2g}, moved {one.moved:.4g}{scale}"
        )
    run = bench.finish(
        "encoders", results, pictures.encoders(traces, results), seconds=bench.protocol.seconds
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


def _asked_unit(joint: str) -> tuple[str, float, str]:
    """Unit in which the operator answers, its size in SI units, and what is asked for."""
    if JOINT_UNITS[joint] == "m":
        return "m", 1.0, "by the tape measure"
    return "deg", np.pi / 180.0, "by the inclinometer" if joint != "slew" else "by its scale"


def _only_moved(
    joint: str, joints: Sequence[str], before: Sequence[Rest], after: Sequence[Rest]
) -> None:
    for other, first, last in zip(joints, before, after, strict=True):
        moved, allowed = last.position - first.position, OTHERS * first.movement
        if other != joint and abs(moved) > allowed:
            raise DataError(
                f"{other} has moved by {moved:+.3g} while {joint} was measured, allowed "
                f"±{allowed:.3g}; move one joint alone. If you did, two encoders are exchanged"
            )
