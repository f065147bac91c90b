"""Cases of sensors and valves that fail at work, and what the monitor says of them."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from crane_benchmark.observing.machines import HeardWork, Observed, WorkCycles
from crane_benchmark.observing.observer import heard
from crane_model.model_file import Model
from crane_observer.monitor.finding import Part, SensorFinding
from crane_observer.monitor.replay import compare
from crane_observer.monitor.tolerance import Tolerance
from crane_sim.plant.closed_loop import REST_S
from crane_sim.sensor_faults import KINDS, TimedFault

SOONEST_FAULT_S = 5.0  # s of work before a fault begins
PARTS = {
    "encoder": Part.ENCODER,
    "pressure_a": Part.PRESSURE_A,
    "pressure_b": Part.PRESSURE_B,
    "pressures": Part.PRESSURES,
    "pressure": Part.SUPPLY,
    "valve": Part.VALVE,
}
EITHER = "pressure_a", "pressure_b"
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
FAULTLESS_SECONDS = 600.0  # s of a recording without fault
HOUR = 3600.0  # s
LEARNT_FROM = 1200.0  # s of work without fault, beside the bag of the identification


class Question(NamedTuple):
    """Requirement on the monitor: found within some seconds, in at least a share of the cases."""

    what: str
    parts: tuple[str, ...]  # one of them
    kind: str
    sizes: tuple[float, float]  # between; 0: it has none
    within: float  # s
    aim: float  # share
    weight: int  # how many cases, of WEIGHTS


FAULT_AIMS = (
    Question("encoder stuck while moving", ("encoder",), "stuck", (0.0, 0.0), 0.3, 0.99, 4),
    Question("encoder jumps while moving", ("encoder",), "jump", (5e-3, 5e-2), 0.3, 0.99, 4),
    Question("encoder drifts, 1 mrad/s", ("encoder",), "drift", (1e-3, 1e-3), 10.0, 0.95, 2),
    Question("pressure off by 1 bar", EITHER, "offset", (1e5, 1e5), 60.0, 0.95, 2),
    Question("pressure off by 3 bar", EITHER, "offset", (3e5, 3e5), 5.0, 0.95, 2),
)
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
WEIGHTS = sum(question.weight for question in (*FAULT_AIMS, *OTHERS))


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
        return PARTS[self.fault.part]


def drawn(observed: Observed, count: int, seed: int) -> list[FailingCase]:
    """About `count` cases, each with motion and noise of its own; sizes spread over ranges."""
    cases: list[FailingCase] = []
    for question in (*FAULT_AIMS, *OTHERS):
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
    joints = [joint for joint in machine.joint_names if machine.cylinders[joint].pressure_sensors]
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
    cycles = WorkCycles.drawn(observed.machine, observed.simulated.start, 120.0, seed)
    way = np.abs(np.diff(cycles.poses[:, observed.machine.index(joint)], axis=0))
    moves = np.flatnonzero((way > 0.3 * way.max()) & (cycles.begins > SOONEST_FAULT_S))
    k = moves[0]
    return float(
        REST_S + cycles.begins[k] + rng.uniform(0.3, 0.6) * (cycles.ends - cycles.begins)[k]
    )


# Answers of the sensor monitor on machines at work, with and without faults.


class WatchedMachine(NamedTuple):
    """A machine, and the monitor that watches it."""

    observed: Observed
    model: Model
    tolerance: Tolerance

    def findings(self, work: HeardWork) -> list[SensorFinding]:
        """All of them; times as in the recording."""
        found = compare(work.heard, self.model, self.tolerance).findings
        later = work.begin
        return [
            finding._replace(found=finding.found + later, onset=finding.onset + later)
            for finding in found
        ]


class MonitorAnswer(NamedTuple):
    """To a case."""

    case: FailingCase
    before: float  # s without fault
    alarms: int  # findings in them
    first: SensorFinding | None  # behind the onset

    @property
    def delay(self) -> float:
        """s from onset to finding; inf where there is none."""
        assert self.case.fault.onset is not None
        return self.first.found - self.case.fault.onset if self.first else float("inf")

    @property
    def right(self) -> bool:
        if self.first is None:
            return False
        fault = self.case.fault
        return self.first.part is self.case.part and self.first.joint == fault.target


def without_fault(observed: Observed, model: Model, seed: int) -> HeardWork:
    """FAULTLESS_SECONDS of work."""
    made, _ = observed.at_work(FAULTLESS_SECONDS, seed)
    return HeardWork(float(made.time[0]), heard(made, model, observed))


def with_fault(observed: Observed, model: Model, case: FailingCase) -> HeardWork:
    """A case; who watches it is told nothing of the fault."""
    made, _ = observed.at_work(case.duration, case.seed, failing=[str(case.fault)])
    return HeardWork(float(made.time[0]), heard(made, model, observed))


def answered(watched: WatchedMachine, case: FailingCase, work: HeardWork) -> MonitorAnswer:
    """Answer of the monitor to a case."""
    findings, onset = watched.findings(work), case.fault.onset
    assert onset is not None
    behind = [finding for finding in findings if finding.found >= onset]
    first = min(behind, key=lambda finding: finding.found, default=None)
    return MonitorAnswer(case, onset - work.begin, len(findings) - len(behind), first)


def smallest(answers: Sequence[MonitorAnswer], question: Question) -> float:
    """The size from which on every fault of this kind was found in time; inf where none was."""
    asked = sorted(
        (answer for answer in answers if answer.case.question == question),
        key=lambda answer: abs(answer.case.fault.size),
        reverse=True,
    )
    size = float("inf")
    for answer in asked:
        if answer.delay > question.within:
            break
        size = abs(answer.case.fault.size)
    return size
