"""Why recordings do not determine a parameter: what the joint that it acts on did not do."""

from collections.abc import Sequence

import numpy as np

from crane_identification.estimation.rows import Rows
from crane_identification.preparation.run import Preparation
from crane_model.model_file import Model

ONE_WAY = 0.02
"""Share of the moving time below which a direction counts as not tried."""
ONE_SPEED = 0.1
"""Standard deviation over mean of the speed below which it counts as one speed."""
NARROW = 0.1
"""Share of a joint's range (Table 2) below which it counts as hardly moved."""
ACTS = 0.1
"""A parameter acts on the joints whose force it changes by this share of its largest effect."""


def too_little(
    model: Model, rows: Rows, preparations: Sequence[Preparation], undetermined: Sequence[str]
) -> list[str]:
    """A sentence for each joint that the `undetermined` parameters act on: what was not excited."""
    joints = [joint for joint in model.joints if _acts(rows, joint, undetermined)]
    return [f"{joint} {_reason(model, preparations, joint)}" for joint in joints or model.joints]


def _acts(rows: Rows, joint: str, names: Sequence[str]) -> bool:
    """Whether one of the parameters acts on the joint (by name, if it has no effect at all)."""
    j = rows.joints.index(joint)
    for name in names:
        column = rows.norms(rows.matrix[:, :, rows.names.index(name)])
        own = column[j] > ACTS * column.max() if column.any() else name.endswith(f".{joint}")
        if own:
            return True
    return False


def _reason(model: Model, preparations: Sequence[Preparation], joint: str) -> str:
    j = model.joints.index(joint)
    unit = model.setting.units[joint]
    position = np.concatenate([p.record.position[:, j] for p in preparations])
    velocity = np.concatenate([p.record.velocity[p.moving[:, j], j] for p in preparations])
    if not len(velocity):
        return "moves at no time, or no faster than its velocity can be told from standstill"
    up = float((velocity > 0.0).mean())
    if min(up, 1.0 - up) < ONE_WAY:
        way = "up" if up > 0.5 else "down"
        return f"moves {way} in {max(up, 1.0 - up):.0%} of its motion; move it both ways"
    speed = np.abs(velocity)
    if speed.std() < ONE_SPEED * speed.mean():
        return f"moves at one speed, {speed.mean():.3g} {unit}/s; move it at several"
    width = float(np.ptp(position))
    if model.machine is not None:
        limits = model.machine.limits[joint]
        whole = limits.position_max - limits.position_min
        if width < NARROW * whole:
            return f"moves within {width:.3g} {unit} of its {whole:.3g} {unit}; use more of it"
    return f"moves within {width:.3g} {unit} and up to {speed.max():.3g} {unit}/s, too much alike"
