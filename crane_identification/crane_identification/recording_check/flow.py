"""Valve commands against the speed of the cylinders: chambers, signs and names."""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from crane_identification.notation import spoken
from crane_identification.recording_check.constants import BETTER, UNMOVED
from crane_identification.recording_check.forces import NEGLIGIBLE
from crane_identification.recording_check.grid import Grid
from crane_identification.recording_check.suspicion import Suspicion
from crane_model.flow import piston_flow


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
