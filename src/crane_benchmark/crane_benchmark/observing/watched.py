"""What the sensor monitor says of machines at work, with and without faults."""

from collections.abc import Sequence
from typing import NamedTuple

from crane_benchmark.observing.failing import FailingCase, Question
from crane_benchmark.observing.kept import HeardWork
from crane_benchmark.observing.machines import Observed
from crane_benchmark.observing.positions import heard
from crane_model.model_file import Model
from crane_observer.monitor.finding import SensorFinding
from crane_observer.monitor.replay import compare
from crane_observer.monitor.tolerance import Tolerance

BATCH = 600.0  # s of a recording without fault
HOUR = 3600.0  # s
LEARNT_FROM = 1200.0  # s of work without fault, beside the bag of the identification


class WatchedMachine(NamedTuple):
    """A machine, and the monitor that watches it."""

    observed: Observed
    model: Model
    tolerance: Tolerance

    def findings(self, work: HeardWork) -> list[SensorFinding]:
        """All of them; times as in the recording."""
        found = compare(work.heard, self.model, self.tolerance).findings
        later = work.begin
        return [one._replace(found=one.found + later, onset=one.onset + later) for one in found]


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
        """Whether it names the sensor."""
        if self.first is None:
            return False
        fault = self.case.fault
        return self.first.part is self.case.part and self.first.joint == fault.target


def without_fault(observed: Observed, model: Model, seed: int) -> HeardWork:
    """BATCH of work."""
    made, _ = observed.at_work(BATCH, seed)
    return HeardWork(float(made.time[0]), heard(made, model, observed))


def with_fault(observed: Observed, model: Model, case: FailingCase) -> HeardWork:
    """A case; who watches it is told nothing of the fault."""
    made, _ = observed.at_work(case.duration, case.seed, failing=[str(case.fault)])
    return HeardWork(float(made.time[0]), heard(made, model, observed))


def answered(watched: WatchedMachine, case: FailingCase, work: HeardWork) -> MonitorAnswer:
    """What the monitor says of a case."""
    findings, onset = watched.findings(work), case.fault.onset
    assert onset is not None
    behind = [one for one in findings if one.found >= onset]
    first = min(behind, key=lambda one: one.found, default=None)
    return MonitorAnswer(case, onset - work.begin, len(findings) - len(behind), first)


def smallest(answers: Sequence[MonitorAnswer], question: Question) -> float:
    """The size from which on every fault of this kind was found in time; inf where none was."""
    asked = sorted(
        (one for one in answers if one.case.question == question),
        key=lambda one: abs(one.case.fault.size),
        reverse=True,
    )
    size = float("inf")
    for one in asked:
        if one.delay > question.within:
            break
        size = abs(one.case.fault.size)
    return size
