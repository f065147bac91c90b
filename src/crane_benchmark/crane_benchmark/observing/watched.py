"""What the sensor monitor says of machines at work, with and without faults."""

from collections.abc import Iterable, Sequence
from typing import NamedTuple

from crane_benchmark.observing.failing import FailingCase, Question
from crane_benchmark.observing.kept import WatchedWork
from crane_benchmark.observing.machines import Observed
from crane_benchmark.observing.positions import heard
from crane_model.model_file import Model
from crane_observer.monitor.finding import SensorFinding
from crane_observer.monitor.history import Sums
from crane_observer.monitor.replay import compare
from crane_observer.monitor.tolerance import Tolerance
from crane_sim.plant.closed_loop import SimulatedRecording

BATCH = 600.0  # s of a recording without fault
HOUR = 3600.0  # s
LEARNT_FROM = 1200.0  # s of work without fault, beside the bag of the identification


class WatchedMachine(NamedTuple):
    """A machine, and the monitor that watches it."""

    observed: Observed
    model: Model
    tolerance: Tolerance

    def watch(self, made: SimulatedRecording) -> WatchedWork:
        """All that is found in it."""
        recording = heard(made, self.model, self.observed)
        begin = float(made.time[0])
        found = compare(recording, self.model, self.tolerance).findings
        return WatchedWork(
            begin,
            float(made.time[-1] - begin),
            [one._replace(found=one.found + begin, onset=one.onset + begin) for one in found],
        )


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


def work(observed: Observed, model: Model, seeds: Iterable[int]) -> Iterable[Sums]:
    """Sums of residuals in work without faults."""
    for seed in seeds:
        made, _ = observed.at_work(BATCH, seed)
        yield compare(heard(made, model, observed), model, None).sums


def without_fault(watched: WatchedMachine, seed: int) -> WatchedWork:
    """BATCH of work."""
    made, _ = watched.observed.at_work(BATCH, seed)
    return watched.watch(made)


def with_fault(watched: WatchedMachine, case: FailingCase) -> WatchedWork:
    """A case; the monitor is told nothing of it."""
    made, _ = watched.observed.at_work(case.duration, case.seed, failing=[str(case.fault)])
    return watched.watch(made)


def answered(case: FailingCase, seen: WatchedWork) -> MonitorAnswer:
    """What that says of the case."""
    onset = case.fault.onset
    assert onset is not None
    behind = [one for one in seen.findings if one.found >= onset]
    first = min(behind, key=lambda one: one.found, default=None)
    return MonitorAnswer(case, onset - seen.begin, len(seen.findings) - len(behind), first)


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
