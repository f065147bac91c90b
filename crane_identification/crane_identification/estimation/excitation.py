"""Why recordings do not determine a parameter: no motion could, or its joint did too little."""

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from scipy.sparse.csgraph import connected_components

from crane_identification.estimation.regression import CONTAINED, Rows, products_of
from crane_identification.notation import listed, plain
from crane_identification.preparation.run import Preparation
from crane_model.base_parameters import reveal_rank
from crane_model.errors import DataError
from crane_model.model_file import Model
from crane_model.motion_columns import MotionQuantity
from crane_model.record import Record

ONE_WAY_TIME_SHARE = 0.02
"""Share of the moving time below which a direction counts as not tried."""
ONE_SPEED_SPREAD = 0.1
"""Standard deviation over mean of the speed below which it counts as one speed: ramps between
strokes that the smoother rounds off have as much, and viscous friction read off them is wrong."""
NARROW_RANGE_SHARE = 0.1
"""Share of a joint's range (Table 2) below which it counts as hardly moved."""
ACTING_FORCE_SHARE = 0.1
"""A parameter acts on the joints whose force it changes by this share of its largest effect."""
RANDOM_STATES = 200
"""Random states that show which columns depend on each other in any motion."""

_ALIKE_AT_ONE_SPEED = (
    (MotionQuantity.DIRECTION, MotionQuantity.VELOCITY),
    (MotionQuantity.ONE, MotionQuantity.SPEED),
)


class Redundancy(NamedTuple):
    """Parameters that no motion of the machine separates, and the combinations that forces show."""

    parameters: tuple[str, ...]
    combinations: tuple[str, ...]

    def __str__(self) -> str:
        if not self.combinations:
            return f"{', '.join(self.parameters)}: no motion of the machine makes a force by them"
        return (
            f"{', '.join(self.parameters)}: no motion of the machine separates these parameters, "
            f"forces show only {listed(self.combinations)}"
        )


def redundancies(model: Model) -> tuple[Redundancy, ...]:
    """Groups of parameters that are redundant in any motion, however well it excites the joints.

    From the rank of the regressor at random states within the limits of the machine. Terms with
    memory, and terms of signals other than motion, are not asked.
    """
    rng, joints = np.random.default_rng(0), len(model.joints)
    low, high = -np.ones(joints), np.ones(joints)
    if model.machine is not None:
        low, high, *_ = model.machine.ranges(model.joints)
    position = rng.uniform(low, high, (RANDOM_STATES, joints))
    record = Record(
        model.joints,
        np.arange(float(RANDOM_STATES)),
        position,
        *rng.normal(size=(2, *position.shape)),
    )
    names: list[str] = []
    parts = []
    for term in model.terms:
        if not term.of_one_instant:
            continue
        try:
            parts.append(term.columns(record, model.setting))
        except DataError:  # needs a signal beside the motion
            continue
        names += [parameter.name for parameter in term.parameters(model.setting)]
    if not names:
        return ()
    columns = np.concatenate(parts, axis=2).reshape(-1, len(names))
    basis = reveal_rank(columns)
    norms = np.linalg.norm(columns, axis=0)
    kept, dropped = list(basis.independent), list(basis.dependent)
    shares = np.abs(basis.combination) * norms[kept][:, None]
    linked = shares > CONTAINED * norms[dropped]
    count, together = connected_components(
        np.block([[np.eye(len(kept)), linked], [linked.T, np.eye(len(dropped))]]), directed=False
    )
    found = []
    for group in range(count):
        rows, members = (np.flatnonzero(part == group) for part in np.split(together, [len(kept)]))
        if not len(members):
            continue
        combinations = tuple(
            _combination(
                names[kept[i]],
                {names[dropped[d]]: basis.combination[i, d] for d in members if linked[i, d]},
            )
            for i in rows
        )
        places = sorted([kept[i] for i in rows] + [dropped[d] for d in members])
        found.append(Redundancy(tuple(names[k] for k in places), combinations))
    return tuple(found)


def _combination(first: str, weights: Mapping[str, float]) -> str:
    more = [f" {'-' if f < 0.0 else '+'} {plain(abs(f), 4)} {name}" for name, f in weights.items()]
    return "".join([first, *more])


def undetermined_in_words(
    model: Model,
    undetermined: Sequence[str],
    reasons: Callable[[Sequence[str]], Sequence[str]] = lambda _: (),
) -> str:
    """Parameters of which only combinations are seen, and what to do about them.

    `reasons` gives what the recordings did not excite of parameters that other motions separate.
    """
    structural = [
        redundancy
        for redundancy in redundancies(model)
        if set(redundancy.parameters) & set(undetermined)
    ]
    redundant = {name for redundancy in structural for name in redundancy.parameters}
    sentences = [
        f"{redundancy}. Take one of their terms out of the model, or give a prior (--prior); no "
        "other motion helps"
        for redundancy in structural
    ]
    if rest := [name for name in undetermined if name not in redundant]:
        seen = f": {'; '.join(reasons(rest))}" if reasons(rest) else ""
        sentences.append(
            f"{', '.join(rest)}: these recordings show only combinations of these parameters{seen}."
            " Excite the joints more (both directions, several speeds, the whole range) or take "
            "terms out of the model"
        )
    return f"model '{model.name}': {'. '.join(sentences)}"


def at_one_speed(model: Model, products: np.ndarray) -> dict[str, tuple[str, ...]]:
    """Parameters of joints that move at one speed, so that only their sum is seen, by joint.

    `products` (j, p, p) are ΦᵀΦ of the used rows of each joint.
    """
    names = [parameter.name for parameter in model.parameters]
    found: dict[str, tuple[str, ...]] = {}
    for j, joint in enumerate(model.joints):
        places = {
            column.quantity: model.part(term).start + column.parameter
            for term in model.terms
            if term.only_joint == joint
            for column in term.motion_columns(model.setting)
            if column.row == column.joint == joint
        }
        for constant, growing in _ALIKE_AT_ONE_SPEED:
            if constant not in places or growing not in places:
                continue
            first, second = places[constant], places[growing]
            power = products[j, first, first] * products[j, second, second]
            common = products[j, first, second] ** 2
            if power > 0.0 and power - common < ONE_SPEED_SPREAD**2 * common:
                found[joint] = (*found.get(joint, ()), names[first], names[second])
    return found


def too_little(
    model: Model, rows: Rows, preparations: Sequence[Preparation], undetermined: Sequence[str]
) -> list[str]:
    """A sentence for each joint that the `undetermined` parameters act on: what was not excited."""
    joints = [joint for joint in model.joints if _acts(rows, joint, undetermined)]
    single = at_one_speed(model, products_of(rows))
    return [
        f"{joint} {_reason(model, preparations, joint, joint in single)}"
        for joint in joints or model.joints
    ]


def _acts(rows: Rows, joint: str, names: Sequence[str]) -> bool:
    """Return whether a parameter acts on the joint (by name, if it has no effect at all)."""
    j = rows.joints.index(joint)
    for name in names:
        column = rows.norms(rows.matrix[:, :, rows.names.index(name)])
        acts = (
            column[j] > ACTING_FORCE_SHARE * column.max()
            if column.any()
            else name.endswith(f".{joint}")
        )
        if acts:
            return True
    return False


def _reason(model: Model, preparations: Sequence[Preparation], joint: str, one_speed: bool) -> str:
    j = model.joints.index(joint)
    unit = model.setting.units[joint]
    position = np.concatenate([p.record.position[:, j] for p in preparations])
    velocity = np.concatenate([p.record.velocity[p.moving[:, j], j] for p in preparations])
    if not len(velocity):
        return "does not move, or too slowly to distinguish it from standstill"
    up = float((velocity > 0.0).mean())
    if min(up, 1.0 - up) < ONE_WAY_TIME_SHARE:
        way = "up" if up > 0.5 else "down"
        return f"moves {way} in {max(up, 1.0 - up):.0%} of its motion; move it in both directions"
    speed = np.abs(velocity)
    if one_speed or speed.std() < ONE_SPEED_SPREAD * speed.mean():
        return f"moves at one speed, {speed.mean():.3g} {unit}/s; move it at several"
    width = float(np.ptp(position))
    if model.machine is not None:
        limits = model.machine.limits[joint]
        whole = limits.position_max - limits.position_min
        if width < NARROW_RANGE_SHARE * whole:
            return f"moves within {width:.3g} {unit} of its {whole:.3g} {unit}; use more of it"
    return f"moves within {width:.3g} {unit} and up to {speed.max():.3g} {unit}/s, too similar"
