"""results.json: what the rows of all cases say together, with 95 % intervals."""

from collections.abc import Callable, Sequence

import numpy as np
from scipy.stats import binomtest, bootstrap

from crane_benchmark.answers.answer_cases import AnswerStatistics
from crane_benchmark.cases.case import CaseKind, EffectToHide, Simulator, World
from crane_benchmark.cases.case_sets import RELATIVE_MAGNITUDES
from crane_benchmark.cases.motions import Richness
from crane_benchmark.scores.judgement import AND_MORE, OURS, BlindAnswer, Judgement
from crane_identification.thresholds import load_thresholds
from crane_model.result_file import Number, NumberByJoint, ResultFile, ResultPart

FEWEST_VALUES_OF_MEDIAN = 3  # values, below which a median has no interval

Interval = tuple[float, float]
"""Both ends."""
VISIBLE_SHARE = 0.05  # share of an effect that recordings can show, below which they do not


class Rate(ResultPart):
    """How often something was so."""

    count: int
    """Times [-]."""
    of: int
    """Cases [-]."""
    rate: Number
    """`count` over `of` [-]; null of nothing."""
    interval: Interval | None
    """Wilson's, 95 % [-]."""


class Median(ResultPart):
    """The middle of what was measured."""

    of: int
    """Values [-]."""
    median: Number
    """Median of the values [of the values]; null without any."""
    interval: Interval | None
    """By the bootstrap, 95 % [of the values]; null of few values."""


def rate(hits: Sequence[bool]) -> Rate:
    """Share of true values."""
    count, n = int(np.sum(hits)), len(hits)
    if n == 0:
        return Rate(count=0, of=0, rate=None, interval=None)
    interval = binomtest(count, n).proportion_ci(method="wilson")
    both = float(interval.low), float(interval.high)
    return Rate(count=count, of=n, rate=count / n, interval=both)


def median(values: Sequence[float]) -> Median:
    """Median of the finite values."""
    finite = np.array([value for value in values if np.isfinite(value)])
    if len(finite) == 0:
        return Median(of=0, median=None, interval=None)
    interval = None
    if len(finite) >= FEWEST_VALUES_OF_MEDIAN:
        found = bootstrap(
            (finite,), np.median, method="percentile", rng=np.random.default_rng(1)
        ).confidence_interval
        interval = float(found.low), float(found.high)
    return Median(of=len(finite), median=float(np.median(finite)), interval=interval)


# row.json: the score of a case.


class ScoredEffect(ResultPart):
    """Ground truth of an injected effect."""

    wanted: EffectToHide
    """As the case asks for it."""
    reached: Number = None
    """Largest relative magnitude that it had in a recording to train on [-]."""
    visibility: Number
    """Share of it that recordings of this kind show [-]; null where nothing says what is usual."""


class CaseRow(ResultFile):
    """The score of a case."""

    case: str
    """Its name."""
    kind: CaseKind
    """Kind of the case."""
    simulator: Simulator
    """Whose machine it is."""
    world: World
    """Source of the case."""
    off: bool
    """The lengths of the machine differ from its file."""
    excitation: Richness
    """How well it is excited."""
    hidden: list[ScoredEffect]
    """All that was hidden."""
    gap: NumberByJoint
    """Error of the model on clean recordings, over the force: what could be explained [-]."""
    above_noise: bool
    """That error is significantly above noise."""
    outcomes: dict[str, Judgement]
    """By method."""
    answers: dict[str, BlindAnswer]
    """By method."""
    reason: str
    """Reason of the diagnosis."""
    statistics: AnswerStatistics | None
    """Statistics of the diagnosis."""
    seconds: Number
    """CPU time of the diagnosis [s]."""
    parameter_errors: list[float]
    """Relative, of those that mean the same in the hidden law [-]."""
    closed: Number
    """Share of the explainable gap that the effects close [-]; null where none is named."""
    closed_by_learner: Number
    """Share that the flexible learner closes [-]."""


Power = dict[float, Rate]
"""By the relative magnitude that was asked for."""


class MethodRates(ResultPart):
    """How often a method was right, or how wrong."""

    false_alarms: Rate
    """Share of cases without injected effects."""
    false_reassurance: Rate
    """Share of all cases: `none`, though the model errs significantly on held-out data."""
    lengths_recognised: Rate
    """Right, of machines with other lengths than their file has."""
    right_from_2_percent: Rate
    """Share of single effects that can be identified."""
    right_from_2_percent_all: Rate
    """Share of all single effects."""
    right_from_2_percent_surveyed: Rate
    """Share of the identifiable ones, on machines that have the lengths in their file."""
    right_from_2_percent_off: Rate
    """Share of the identifiable ones, on machines with other lengths than in their file."""
    hedged: Rate
    """Share of right answers to these that say there is more."""
    right_at_1_percent: Rate
    """Share of single effects that can be identified."""
    power: Power
    """Right, of single effects that can be identified."""
    pairs_at_4_percent: Rate
    """Both right, of pairs that can be identified."""
    one_of_two: Rate
    """One right, of the same."""
    unknown_recognised: Rate
    """Share of effects outside the catalogue."""
    unknown_recognised_shown: Rate
    """Share of those that can be identified."""
    ambiguous: Rate
    """Right, of effects that no data tell apart."""
    too_little_data: Rate
    """Right, of such cases."""
    wrong_names: Rate
    """Share of all cases."""
    too_wide: Rate
    """Share of all cases: an ambiguity group with members that the data discriminate."""
    crashes: Rate
    """Share of all cases."""


class LearnerRates(ResultPart):
    """How often the flexible learner is sure of a law."""

    false_alarms: Rate
    """Share of cases without injected effects."""
    outside: Rate
    """Share of effects outside the catalogue."""
    power: Power
    """Power for single effects that can be identified."""


class BenchmarkSummary(ResultPart):
    """Summary of all cases."""

    cases: int
    """How many [-]."""
    methods: dict[str, MethodRates]
    """By name."""
    gap_closed: Median
    """Share of the explainable gap, where effects are named [-]."""
    gap_closed_by_learner: Median
    """The same by the flexible learner, of all cases that hide something [-]."""
    learner: LearnerRates
    """Rates of the flexible learner."""
    parameter_error: Median
    """Relative, of those that mean the same in the hidden law [-]."""
    seconds: Median
    """CPU time of a diagnosis [s]."""
    not_identifiable: int
    """Single effects that recordings of their kind do not show [-]."""


class BenchmarkResults(ResultFile):
    """Results of a set of cases."""

    thresholds: str
    """Digest of everything that decides."""
    summary: BenchmarkSummary
    """Summary over both simulators."""
    simulators: dict[Simulator, BenchmarkSummary]
    """Summaries of the machines of each simulator."""
    cases: list[CaseRow]
    """One by one."""


def summary(rows: Sequence[CaseRow]) -> BenchmarkSummary:
    """Rates of every method, and what only a diagnosis gives."""
    methods = list(dict.fromkeys(name for row in rows for name in row.outcomes))
    ours = [row for row in rows if OURS in row.outcomes]
    return BenchmarkSummary(
        cases=len(rows),
        methods={name: _of_method(rows, name) for name in methods},
        gap_closed=median([row.closed for row in ours if row.closed is not None]),
        gap_closed_by_learner=median(
            [
                row.closed_by_learner
                for row in ours
                if row.hidden and row.closed_by_learner is not None
            ]
        ),
        learner=learnt(ours),
        parameter_error=median([error for row in ours for error in row.parameter_errors]),
        seconds=median([row.seconds for row in ours if row.seconds]),
        not_identifiable=sum(not identifiable(row) for row in of_kind(rows, CaseKind.SINGLE)),
    )


def by_simulator(rows: Sequence[CaseRow]) -> dict[Simulator, list[CaseRow]]:
    """The rows of each simulator of which there are any."""
    found: dict[Simulator, list[CaseRow]] = {}
    for simulator in Simulator:
        if rows_of_simulator := [row for row in rows if row.simulator is simulator]:
            found[simulator] = rows_of_simulator
    return found


def learnt(rows: Sequence[CaseRow]) -> LearnerRates:
    """How often the flexible learner is sure of a law."""
    least = load_thresholds().gates.smallest_strength

    def sees(some: Sequence[CaseRow]) -> Rate:
        return rate([bool(row.statistics and row.statistics.learner > least) for row in some])

    return LearnerRates(
        false_alarms=sees(of_kind(rows, CaseKind.NOTHING)),
        outside=sees(of_kind(rows, CaseKind.OUTSIDE)),
        power={size: sees(some) for size, some in by_relative_magnitude(rows).items()},
    )


def by_relative_magnitude(rows: Sequence[CaseRow]) -> dict[float, list[CaseRow]]:
    """Cases of single effects that can be identified, by the requested relative magnitude."""
    seen = [row for row in of_kind(rows, CaseKind.SINGLE) if identifiable(row)]
    return {
        s: [row for row in seen if row.hidden[0].wanted.relative_magnitude == s]
        for s in RELATIVE_MAGNITUDES
    }


def of_kind(rows: Sequence[CaseRow], kind: CaseKind) -> list[CaseRow]:
    """The rows of one kind of case."""
    return [row for row in rows if row.kind is kind]


def identifiable(row: CaseRow) -> bool:
    """Return whether the clean recordings show every effect of the case, by its visibility."""
    return all(
        effect.visibility is None or effect.visibility >= VISIBLE_SHARE for effect in row.hidden
    )


def share(
    rows: Sequence[CaseRow], method: str, wanted: Callable[[Judgement], bool] | Judgement
) -> Rate:
    """How often the outcome of a method is the wanted one."""
    outcomes = [row.outcomes[method] for row in rows if method in row.outcomes]
    return rate([wanted(o) if callable(wanted) else o is wanted for o in outcomes])


def power(rows: Sequence[CaseRow], method: str) -> Power:
    """Share of right answers to single effects that can be identified."""
    return {s: share(of, method, Judgement.RIGHT) for s, of in by_relative_magnitude(rows).items()}


def _of_method(rows: Sequence[CaseRow], method: str) -> MethodRates:
    singles = of_kind(rows, CaseKind.SINGLE)
    strong = [row for row in singles if row.hidden[0].wanted.relative_magnitude >= 0.02]
    shown = [row for row in strong if identifiable(row)]
    answered = [row for row in rows if method in row.answers]
    weak = [row for row in singles if row.hidden[0].wanted.relative_magnitude == 0.01]
    pairs = [row for row in of_kind(rows, CaseKind.PAIR) if identifiable(row)]
    outside = of_kind(rows, CaseKind.OUTSIDE)
    right = [row for row in strong if row.outcomes.get(method) is Judgement.RIGHT]
    return MethodRates(
        false_alarms=share(of_kind(rows, CaseKind.NOTHING), method, Judgement.FALSE_ALARM),
        false_reassurance=rate(
            [row.above_noise and row.answers[method].verdict == "none" for row in answered]
        ),
        lengths_recognised=share(of_kind(rows, CaseKind.LENGTHS), method, Judgement.RIGHT),
        right_from_2_percent=share(shown, method, Judgement.RIGHT),
        right_from_2_percent_all=share(strong, method, Judgement.RIGHT),
        right_from_2_percent_surveyed=share(
            [row for row in shown if not row.off], method, Judgement.RIGHT
        ),
        right_from_2_percent_off=share([row for row in shown if row.off], method, Judgement.RIGHT),
        hedged=rate([row.answers[method].verdict == AND_MORE for row in right]),
        right_at_1_percent=share(
            [row for row in weak if identifiable(row)], method, Judgement.RIGHT
        ),
        power=power(rows, method),
        pairs_at_4_percent=share(pairs, method, Judgement.RIGHT),
        one_of_two=share(pairs, method, Judgement.PARTLY),
        unknown_recognised=share(outside, method, Judgement.RIGHT),
        unknown_recognised_shown=share(
            [row for row in outside if identifiable(row)], method, Judgement.RIGHT
        ),
        ambiguous=share(of_kind(rows, CaseKind.AMBIGUOUS), method, Judgement.RIGHT),
        too_little_data=share(of_kind(rows, CaseKind.INSUFFICIENT), method, Judgement.RIGHT),
        wrong_names=share(rows, method, Judgement.WRONG_NAME),
        too_wide=share(rows, method, Judgement.TOO_WIDE),
        crashes=share(rows, method, Judgement.CRASH),
    )
