"""What the sensor monitor says of machines at work, with and without faults."""

from collections.abc import Iterable, Sequence
from typing import NamedTuple

from crane_benchmark.observing.failing import FailingCase, Question
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


class Watched(NamedTuple):
    """A machine, and the monitor that watches it."""

    observed: Observed
    model: Model
    tolerance: Tolerance

    def findings(self, made: SimulatedRecording) -> Sequence[SensorFinding]:
        """All of them; times as in the recording."""
        recording = heard(made, self.model, self.observed)
        begin = float(made.time[0])
        found = compare(recording, self.model, self.tolerance).findings
        return [one._replace(found=one.found + begin, onset=one.onset + begin) for one in found]


class Answer(NamedTuple):
    """To a case."""

    case: FailingCase
    before: int  # findings before the fault: false alarms
    first: SensorFinding | None  # behind it

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


def false_alarms(watched: Watched, hours: float, seed: int) -> tuple[float, list[SensorFinding]]:
    """Hours without fault, and what was found in them."""
    seconds = 0.0
    found: list[SensorFinding] = []
    while seconds < hours * HOUR:
        seed += 1
        made, _ = watched.observed.at_work(BATCH, seed)
        seconds += float(made.time[-1] - made.time[0])
        found += watched.findings(made)
    return seconds / HOUR, found


def answered(watched: Watched, case: FailingCase) -> Answer:
    """What the monitor says of a case; it is told nothing of it."""
    made, _ = watched.observed.at_work(case.duration, case.seed, failing=[str(case.fault)])
    findings = watched.findings(made)
    onset = case.fault.onset
    assert onset is not None
    behind = [one for one in findings if one.found >= onset]
    first = min(behind, key=lambda one: one.found, default=None)
    return Answer(case, len(findings) - len(behind), first)


def smallest(answers: Sequence[Answer], question: Question) -> float:
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
