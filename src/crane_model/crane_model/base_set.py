"""Base parameters of a serial chain: the combinations of ten a body that its motion determines."""

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from crane_model.array import Array
from crane_model.chain import PER_BODY, regressor
from crane_model.machine import Machine
from crane_model.machine.joint import MachineJoint

SAMPLES = 200  # random states that show which columns depend on each other
NEGLIGIBLE = 1e-9  # of a column's norm

_FIRST = ("mx", "my", "Ixy", "Ixz", "Iyz", "Izz", "Ixx", "mz", "Iyy", "m")
"""Which of a body's parameters stand for a combination, if they can: those that Gautier and Khalil
(1990) keep for a body that turns about z; the rest goes to the bodies before, except that the mass
on a slide stands for all masses that it carries."""
ALONG = 0.99  # of a unit vector that lies along a coordinate axis


class BaseSet(NamedTuple):
    """r combinations p_base = `combination` p of the 10 m parameters p, each led by one of them."""

    leading: NDArray[np.int64]  # (r,) in rising order
    combination: Array  # (r, 10 m)
    names: tuple[str, ...]  # (10 m,) of p, as Izz.boom

    def told(self, k: int) -> str:
        """Combination k in the names of its parts."""
        parts = [(f, name) for f, name in zip(self.combination[k], self.names, strict=True) if f]
        parts.sort(key=lambda part: part[1] != self.names[self.leading[k]])
        first, *others = (f"{'-' if f < 0 else '+'} {_factor(f)}{name}" for f, name in parts)
        return " ".join([first.removeprefix("+ "), *others])


@lru_cache(maxsize=64)
def base_set(machine: Machine, joints: tuple[str, ...], zero: tuple[str, ...] = ()) -> BaseSet:
    """What forces on `joints` tell if they alone move, and the parameters named `zero` are zero.

    By a rank-revealing QR of the regressor's columns at random states.
    """
    names = tuple(f"{each}.{joint.name}" for joint in machine.joints for each in PER_BODY)
    moving = [machine.index(joint) for joint in joints]
    low = np.array([machine.limits[joint].position_min for joint in joints])
    high = np.array([machine.limits[joint].position_max for joint in joints])
    rng = np.random.default_rng(0)
    states = np.zeros((3, SAMPLES, len(machine.joint_names)))
    states[0][:, moving] = rng.uniform(low, high, (SAMPLES, len(joints)))
    states[1:, :, moving] = rng.standard_normal((2, SAMPLES, len(joints)))
    columns = regressor(machine.chain, *states)[:, moving].reshape(-1, len(names))
    left = [i for i, name in enumerate(names) if name not in zero]
    order = sorted(left, key=lambda i: _rank(machine.joints[i // 10], PER_BODY[i % 10]) + (-i,))
    leading = _independent(columns, order)
    dependent = [i for i in left if i not in set(leading)]
    combination = np.zeros((len(leading), len(names)))
    combination[range(len(leading)), leading] = 1.0
    found = np.linalg.lstsq(columns[:, leading], columns[:, dependent], rcond=None)[0]
    combination[:, dependent] = np.where(np.abs(found) > NEGLIGIBLE, found, 0.0)
    return BaseSet(np.array(leading), combination, names)


def _rank(joint: MachineJoint, quantity: str) -> tuple[int, bool]:
    """Place of a body's parameter among those that may stand for a combination, lowest first."""
    return _FIRST.index(_as_about_z(joint, quantity)), joint.kind == "revolute"


def _as_about_z(joint: MachineJoint, quantity: str) -> str:
    """The quantity (m, mx, ..., Izz) in axes that are exchanged so that the joint's axis is z."""
    axis = int(np.argmax(np.abs(joint.direction)))
    if abs(joint.direction[axis]) < ALONG:
        return quantity
    letters = {"xyz"[(axis + 1) % 3]: "x", "xyz"[(axis + 2) % 3]: "y", "xyz"[axis]: "z"}
    return quantity[0] + "".join(sorted(letters[one] for one in quantity[1:]))


def _independent(columns: Array, order: list[int]) -> list[int]:
    """The columns that do not depend on those before them in `order`, rising."""
    norms = np.linalg.norm(columns, axis=0)
    smallest, basis, kept = NEGLIGIBLE * norms.max(), np.empty((0, len(columns))), []
    for i in order:
        if norms[i] <= smallest:
            continue
        rest = columns[:, i] / norms[i]
        for _ in range(2):  # the second time takes away what rounding left
            rest = rest - basis.T @ (basis @ rest)
        if (size := np.linalg.norm(rest)) > NEGLIGIBLE:
            basis = np.vstack([basis, rest / size])
            kept.append(i)
    return sorted(kept)


def _factor(factor: float) -> str:
    return "" if abs(abs(factor) - 1.0) < NEGLIGIBLE else f"{abs(factor):.6g} "
