"""What the forces say of wiring, names, signs and clocks."""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from crane_identification.notation import spoken
from crane_identification.recording_check.absolute import absolute
from crane_identification.recording_check.forces import (
    NEGLIGIBLE,
    Delay,
    Repair,
    crane,
    equations,
    find_delay,
    masses,
    repairs,
    unexplained,
)
from crane_identification.recording_check.grid import Grid
from crane_identification.recording_check.suspicion import (
    BETTER,
    NEEDED,
    POOR,
    UNEXPLAINED,
    UNMOVED,
    Suspicion,
)
from crane_model.flow import piston_flow

# Valve commands against the speed of the cylinders: chambers, signs and names.


class FlowFit(NamedTuple):
    """Share of the piston's flow that the valve leaves unexplained, and its mean `gain`."""

    left: float
    gain: float


def commands(whole: Grid) -> Iterator[Suspicion]:
    """What is suspicious of the valve commands; they matter for the flow balance alone."""
    for j, joint in enumerate(whole.joints):
        own = fit(whole, j, j)
        others = {k: fit(whole, j, k) for k in range(len(whole.joints)) if k != j}
        best = min(others, key=lambda k: others[k].left) if others else j
        if others and own.left > max(UNMOVED, BETTER * others[best].left):
            yield Suspicion(
                f"valve command of the {spoken(joint)}",
                f"{own.left:.0%} of the flow unexplained, {others[best].left:.0%} by the command "
                f"of the {spoken(whole.joints[best])}",
                "exchanged names",
                decisive=False,
            )
        elif own.gain < 0.0 and own.left < UNMOVED:
            yield Suspicion(
                f"valve command of the {spoken(joint)}",
                f"the joint moves against it; {own.left:.0%} of the flow unexplained",
                "its sign is turned",
                decisive=False,
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
    implausible = tuple(masses(model, values, std_devs)) if left > NEEDED * least else ()
    delay = find_delay(model, whole)
    if left > POOR:
        tried = [(unexplained(model, one), one) for one in repairs(whole)]
        without, best = min(tried, key=lambda one: one[0])
        late = delay is not None and delay.common and delay.left_without < without
        scaled = any(one.decisive for one in implausible)  # which explains as much without a mix-up
        if not late and BETTER * without < (least if scaled else left):
            yield _mixed_up(whole, best, left, without)
            return
    if delay is not None:
        yield _late(delay)
        if delay.common:
            return
    yield from implausible
    if left > UNEXPLAINED and not implausible:
        yield Suspicion(
            "forces",
            f"{left:.0%} of them are left by any plausible masses and friction",
            "the machine file (linkages, areas) is of another machine, or several things are "
            "mixed up",
            decisive=False,
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
        flow, other = fit(whole, j, j), fit(whole, j, j, exchanged=True)
        if other.left < flow.left:
            evidence += (
                f"; valve command and cylinder speed disagree by {flow.left:.1%}, without that by "
                f"{other.left:.1%}"
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
        "the two are stamped by clocks that run apart"
        if delay.drift
        else "pressures and positions are stamped by clocks that differ"
        if delay.common
        else "a slow transducer or encoder, wrong geometry, or an effect that looks like a delay"
    )
    return Suspicion(where, evidence, cause, decisive=delay.common)
