"""Cases of sensors and valves that fail while the crane works: drawn, hidden, kept for scoring."""

from typing import NamedTuple

import numpy as np

from crane_benchmark.observing.cycles import WorkCycles
from crane_benchmark.observing.machines import Observed
from crane_observer.monitor.signatures import Part
from crane_sim.faulty.kinds import KINDS, TimedFault
from crane_sim.plant.closed_loop import REST

SOONEST = 5.0  # s of work before a fault begins
PARTS = {
    "encoder": Part.ENCODER,
    "pressure_a": Part.PRESSURE_A,
    "pressure_b": Part.PRESSURE_B,
    "pressures": Part.PRESSURES,
    "pressure": Part.SUPPLY,
    "valve": Part.VALVE,
}
EITHER = "pressure_a", "pressure_b"


class Question(NamedTuple):
    """What is asked of the monitor: found within some seconds, in a share of the cases at least."""

    what: str
    parts: tuple[str, ...]  # one of them
    kind: str
    sizes: tuple[float, float]  # between; 0: it has none
    within: float  # s
    aim: float  # share
    weight: int  # how many cases, of WEIGHTS


AIMS = (
    Question("encoder stuck while moving", ("encoder",), "stuck", (0.0, 0.0), 0.3, 0.99, 4),
    Question("encoder jumps while moving", ("encoder",), "jump", (5e-3, 5e-2), 0.3, 0.99, 4),
    Question("encoder drifts, 1 mrad/s", ("encoder",), "drift", (1e-3, 1e-3), 10.0, 0.95, 2),
    Question("pressure off by 1 bar", EITHER, "offset", (1e5, 1e5), 60.0, 0.95, 2),
    Question("pressure off by 3 bar", EITHER, "offset", (3e5, 3e5), 5.0, 0.95, 2),
)
RANGES: dict[tuple[tuple[str, ...], str], tuple[float, float]] = {
    (("encoder",), "jump"): (3e-4, 3e-2),
    (("encoder",), "drift"): (5e-5, 5e-3),
    (("encoder",), "lost_counts"): (3e-3, 0.1),
    (("encoder",), "scale"): (3e-3, 0.1),
    (("encoder",), "noise"): (5e-5, 3e-3),
    (("encoder",), "backlash"): (3e-4, 1e-2),
    (EITHER, "offset"): (2e4, 2e6),
    (EITHER, "drift"): (1e3, 1e5),
    (EITHER, "gain"): (5e-3, 0.3),
    (EITHER, "noise"): (2e4, 1e6),
    (("pressure",), "offset"): (5e4, 3e6),
    (("valve",), "slow"): (0.02, 0.5),
    (("valve",), "leaking"): (1e-13, 1e-11),
    (EITHER, "stuck"): (0.0, 0.0),
    (("pressures",), "swapped"): (0.0, 0.0),
    (("valve",), "stuck"): (0.0, 0.0),
}
"""Sizes of every kind, from hardly to be seen to plain."""
NAMES = {"pressure_a": "chamber pressure", "pressure": "supply pressure"}
OTHERS = tuple(
    Question(
        f"{NAMES.get(parts[0], parts[0])} {kind}",
        parts,
        kind,
        sizes,
        20.0,
        0.0,
        2 if sizes[0] else 1,
    )
    for (parts, kind), sizes in RANGES.items()
)
WEIGHTS = sum(one.weight for one in (*AIMS, *OTHERS))


class FailingCase(NamedTuple):
    """One fault in one recording."""

    question: Question
    seed: int  # of motion, loads and noise
    fault: TimedFault

    @property
    def duration(self) -> float:
        """s of work."""
        assert self.fault.onset is not None
        return self.fault.onset + max(self.question.within, 2.0) + 3.0

    @property
    def part(self) -> Part:
        """What the monitor is to name."""
        return PARTS[self.fault.part]


def drawn(observed: Observed, count: int, seed: int) -> list[FailingCase]:
    """About `count` cases, each with motion and noise of its own; sizes spread over ranges."""
    cases: list[FailingCase] = []
    for question in (*AIMS, *OTHERS):
        asked = max(round(count * question.weight / WEIGHTS), 1)
        # each joint and part has large and small ones
        shares = np.random.default_rng([seed, len(cases), asked]).permutation(asked)
        for k, share in enumerate(shares.tolist()):
            rng = np.random.default_rng([seed, len(cases)])
            place = (share + rng.uniform()) / asked
            cases.append(_case(observed, question, k, place, seed + 7919 * (len(cases) + 1), rng))
    return cases


def _case(
    observed: Observed,
    question: Question,
    k: int,
    place: float,
    seed: int,
    rng: np.random.Generator,
) -> FailingCase:
    """The size is at `place`, 0 to 1, of its range."""
    machine = observed.machine
    joints = [one for one in machine.joint_names if machine.cylinders[one].pressure_sensors]
    joint, part = joints[k % len(joints)], question.parts[k // len(joints) % len(question.parts)]
    low, high = question.sizes
    size = low * (high / low) ** place if low else 0.0
    if KINDS[part][question.kind].lowest < 0.0 and question.kind != "gain":
        size *= float(rng.choice([-1.0, 1.0]))
    target = "supply" if part == "pressure" else joint
    onset = _moving(observed, joint, seed, rng)
    return FailingCase(question, seed, TimedFault(target, part, question.kind, size, onset))


def _moving(observed: Observed, joint: str, seed: int, rng: np.random.Generator) -> float:
    """A moment [s of the recording] at which the joint moves fast."""
    cycles = WorkCycles.drawn(observed.machine, observed.stand_in.start, 120.0, seed)
    way = np.abs(np.diff(cycles.poses[:, observed.machine.index(joint)], axis=0))
    moves = np.flatnonzero((way > 0.3 * way.max()) & (cycles.begins > SOONEST))
    k = moves[0]
    return float(REST + cycles.begins[k] + rng.uniform(0.3, 0.6) * (cycles.ends - cycles.begins)[k])
