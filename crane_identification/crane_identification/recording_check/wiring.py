"""Checks of wiring, names, signs and clocks by the forces."""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from crane_identification.notation import spoken
from crane_identification.recording_check import limits
from crane_identification.recording_check.forces import (
    NEGLIGIBLE,
    Delay,
    Grid,
    Repair,
    crane,
    equations,
    find_delay,
    masses,
    repairs,
    unexplained,
)
from crane_identification.recording_check.suspicion import Suspicion
from crane_model.flow import ATMOSPHERE_PA, piston_flow

# Absolute for gauge pressures, from the ratio of the areas: needs no valve command.
#
# The piston presses A_B/A_A as much oil out of chamber B as flows into chamber A. Through edges of
# one size, (p_S - p_A)/(p_B - p_T) is the square of the ratio of the areas, which an offset of both
# chambers spoils.

MEGA = 1e6


def absolute(whole: Grid) -> Iterator[Suspicion]:
    """One atmosphere too much in the chambers of nearly all cylinders and directions."""
    found = np.array(list(_offsets(whole)))
    alike = np.abs(found - ATMOSPHERE_PA) < limits.NEAR_ATMOSPHERE
    if alike.sum() >= limits.FEWEST_STROKES:
        yield Suspicion(
            "pressures of all cylinders",
            f"flow in and out agree with the ratio of the areas if {found[alike].mean() / MEGA:.3f}"
            f" MPa are subtracted ({alike.sum()} of {len(found)} strokes)",
            "pressures look absolute, if the edges of the valves are of one size; gauge is needed",
        )


def _offsets(whole: Grid) -> Iterator[float]:
    """Offset [Pa] of both chambers of each cylinder, from its fast motion in each direction."""
    record = whole.record
    p_a, p_b = record.needed("pressure_a", "check"), record.needed("pressure_b", "check")
    supply = record.needed("supply_pressure", "check")
    tank = record.needed("tank_pressure", "check")
    speed = whole.arms * record.velocity
    for j, joint in enumerate(whole.joints):
        cylinder = whole.machine.cylinders[joint]
        for way, fed, drained, ratio in (
            (1.0, p_a[:, j], p_b[:, j], cylinder.area_a / cylinder.area_b),
            (-1.0, p_b[:, j], p_a[:, j], cylinder.area_b / cylinder.area_a),
        ):
            rows = whole.moving[:, j] & (
                way * speed[:, j] > limits.FAST * np.abs(speed[:, j]).max()
            )
            if rows.any():
                excess = ratio**2 * (drained - tank) - (supply - fed)
                yield float(np.median(excess[rows]) / (1.0 + ratio**2))


# Valve commands against the speed of the cylinders: chambers, signs and names.


class FlowFit(NamedTuple):
    """Share of the piston's flow that the valve leaves unexplained, and its mean `gain`."""

    left: float
    gain: float


def commands(whole: Grid) -> Iterator[Suspicion]:
    """Find faults in the valve commands; they matter for the flow balance alone."""
    for j, joint in enumerate(whole.joints):
        by_itself = fit(whole, j, j)
        by_others = {k: fit(whole, j, k) for k in range(len(whole.joints)) if k != j}
        best = min(by_others, key=lambda k: by_others[k].left) if by_others else j
        if by_others and by_itself.left > max(limits.UNMOVED, limits.BETTER * by_others[best].left):
            yield Suspicion(
                f"valve command of the {spoken(joint)}",
                f"{by_itself.left:.0%} of the flow unexplained, {by_others[best].left:.0%} "
                f"by the command of the {spoken(whole.joints[best])}",
                "exchanged names",
            )
        elif by_itself.gain < 0.0 and by_itself.left < limits.UNMOVED:
            yield Suspicion(
                f"valve command of the {spoken(joint)}",
                f"the joint moves against it; {by_itself.left:.0%} of the flow unexplained",
                "its sign is reversed",
            )


def fit(whole: Grid, j: int, command: int, exchanged: bool = False) -> FlowFit:
    """The flow of joint j by the command of column `command`, its chambers `exchanged` or not.

    Each of the four edges of the valve has a gain and a dead band of its own, and lags.
    """
    record, joint = whole.record, whole.joints[j]
    p_a, p_b = record.needed("pressure_a", "check"), record.needed("pressure_b", "check")
    if exchanged:
        p_a, p_b = p_b, p_a
    supply = record.needed("supply_pressure", "check")
    tank = record.needed("tank_pressure", "check")
    flow, rows = piston_flow(record, whole.machine, joint), whole.moving[:, j]
    way = np.sign(flow[:, 0])
    opening = np.sign(whole.arms[:, j]) * record.needed("command", "check")[:, command]
    parts = np.stack([opening, way, np.gradient(opening, whole.step)], axis=1)
    left, gains = [], []
    for chamber, (pressure, feeds) in enumerate(((p_a[:, j], 1.0), (p_b[:, j], -1.0))):
        fed = feeds * way > 0.0
        drop = np.where(fed, supply - pressure, pressure - tank)
        edge = feeds * (np.sign(drop) * np.sqrt(np.abs(drop)))[:, np.newaxis] * parts
        columns = np.concatenate([fed[:, np.newaxis] * edge, ~fed[:, np.newaxis] * edge], axis=1)
        norms = np.maximum(np.linalg.norm(columns[rows], axis=0), np.finfo(float).tiny)
        scaled, wanted = columns[rows] / norms, flow[rows, chamber]
        found = np.linalg.lstsq(scaled, wanted, rcond=NEGLIGIBLE)[0]
        left.append(np.mean((wanted - scaled @ found) ** 2) / np.mean(wanted**2))
        gains += list((found / norms)[[0, 3]])
    return FlowFit(float(np.sqrt(np.mean(left))), float(np.mean(gains)))


def wiring(whole: Grid) -> Iterator[Suspicion]:
    """Mix-ups that explain what plausible masses and friction cannot; then finer ones.

    `RangeError` where the linkages cannot be assembled at the positions.
    """
    model = crane(whole.machine)
    found = equations(model, whole)
    left = found.explained(model)
    values, std_devs, least = found.free()
    implausible = (
        tuple(masses(model, values, std_devs)) if left > limits.IMPLAUSIBLE_GAIN * least else ()
    )
    delay = find_delay(model, whole)
    if left > limits.POOR:
        tried = [(unexplained(model, repair), repair) for repair in repairs(whole)]
        without, best = min(tried, key=lambda candidate: candidate[0])
        late = delay is not None and delay.common and delay.left_without < without
        # a wrong scale explains as much without a mix-up
        scaled = any(suspicion.decisive for suspicion in implausible)
        if not late and limits.BETTER * without < (least if scaled else left):
            yield _mixed_up(whole, best, left, without)
            return
    if delay is not None:
        yield _late(delay)
        if delay.common:
            return
    yield from implausible
    if left > limits.UNEXPLAINED and not implausible:
        yield Suspicion(
            "forces",
            f"{left:.0%} of them are left by any plausible masses and friction",
            "the machine file (linkages, areas) is of another machine, or several things are "
            "mixed up",
        )
    if whole.force is None:
        yield from absolute(whole)
        if whole.record.command is not None:
            yield from commands(whole)


def _mixed_up(whole: Grid, repair: Repair, left: float, without: float) -> Suspicion:
    evidence = (
        f"plausible masses and friction leave {left:.1%} of the force, without that {without:.1%}"
    )
    if repair.joint is not None and whole.record.command is not None:
        j = whole.joints.index(repair.joint)
        flow, exchanged = fit(whole, j, j), fit(whole, j, j, exchanged=True)
        if exchanged.left < flow.left:
            evidence += (
                f"; valve command and cylinder speed disagree by {flow.left:.1%}, without that by "
                f"{exchanged.left:.1%}"
            )
    return Suspicion(repair.where, evidence, repair.what, decisive=True)


def _late(delay: Delay) -> Suspicion:
    where = ", ".join(spoken(joint) for joint in delay.joints)
    behind = f"{abs(delay.delay):.2f} s {'behind' if delay.delay > 0.0 else 'ahead of'} positions"
    evidence = (
        f"forces fit {behind}{f', drifting by {delay.drift:+.2%}' if delay.drift else ''}: "
        f"{delay.left:.1%} of them unexplained, without that {delay.left_without:.1%}"
    )
    cause = (
        "the two are stamped by clocks that drift apart"
        if delay.drift
        else "pressures and positions are stamped by clocks that differ"
        if delay.common
        else "a slow transducer or encoder, wrong geometry, or an effect that looks like a delay"
    )
    return Suspicion(where, evidence, cause, decisive=delay.common)
