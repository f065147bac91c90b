"""Mix-ups of wiring and names, and the recording as it would be without each."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Any

import numpy as np

from crane_identification.notation import spoken
from crane_identification.recording_check.forces import equations
from crane_identification.recording_check.grid import Grid
from crane_model.errors import RangeError
from crane_model.model_file import Model

MOTION = ("position", "velocity", "acceleration")
PRESSURES = ("pressure_a", "pressure_b")


@dataclass(frozen=True)
class Repair:
    """`where` it changes a recording, and `what` it does; `joint` names the one whose chambers
    are exchanged.
    """

    where: str
    what: str
    repaired: Grid
    joint: str | None = None


def repairs(whole: Grid) -> Iterator[Repair]:
    """Every single mix-up undone."""
    measured = ("force",) if whole.force is not None else PRESSURES
    for j, joint in enumerate(whole.joints):
        signs = np.where(np.arange(len(whole.joints)) == j, -1.0, 1.0)
        turned = _changed(whole, MOTION, lambda values, s=signs: s * values)
        yield Repair(spoken(joint), "the sign of its position is turned", turned)
        if whole.force is None:
            yield Repair(
                spoken(joint), "chambers A and B are exchanged", _chambers(whole, j), joint
            )
        else:
            turned = _changed(whole, measured, lambda values, s=signs: s * values)
            yield Repair(spoken(joint), "the sign of its force is turned", turned)
    for i, k in combinations(range(len(whole.joints)), 2):
        order = np.arange(len(whole.joints))
        order[[i, k]] = k, i
        where = f"{spoken(whole.joints[i])} and {spoken(whole.joints[k])}"
        for names, signals in (
            ("positions", MOTION),
            ("forces" if whole.force is not None else "pressures", measured),
            ("names", (*MOTION, *measured)),
        ):
            exchanged = _changed(whole, signals, lambda values, o=order: values[:, o])
            yield Repair(where, f"their {names} are exchanged", exchanged)


def unexplained(model: Model, repair: Repair) -> float:
    """Share of the force that is left; infinite where the linkages cannot be assembled so."""
    try:
        return equations(model, repair.repaired).explained(model)
    except RangeError:
        return np.inf


def _changed(whole: Grid, names: tuple[str, ...], by: Callable[..., np.ndarray]) -> Grid:
    of_record: dict[str, Any] = {n: by(getattr(whole.record, n)) for n in names if n != "force"}
    force = by(whole.force) if "force" in names else whole.force
    return Grid(whole.machine, replace(whole.record, **of_record), force, whole.step)


def _chambers(whole: Grid, j: int) -> Grid:
    a, b = whole.record.needed("pressure_a", "check"), whole.record.needed("pressure_b", "check")
    first, second = a.copy(), b.copy()
    first[:, j], second[:, j] = b[:, j], a[:, j]
    return Grid(
        whole.machine,
        replace(whole.record, pressure_a=first, pressure_b=second),
        whole.force,
        whole.step,
    )
