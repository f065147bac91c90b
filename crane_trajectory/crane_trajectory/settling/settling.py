"""The motion that settles best what a diagnosis left open, and what no motion settles."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from crane_model.errors import CraneError, RangeError
from crane_model.model_file import Model
from crane_model.open_question import OpenQuestion, OpenQuestions
from crane_trajectory.motion.fourier import FourierTrajectory
from crane_trajectory.motion.sweep import SweepTrajectory
from crane_trajectory.settling.courses import CourseDraws
from crane_trajectory.settling.prediction import Hypothesis, PlannedRecording
from crane_trajectory.settling.separation import PlannedExperiment
from crane_trajectory.settling.series import FourierDraws

DRAWS = 4  # of each family of motions, for each start
SURVIVORS = 4  # that are varied
VARIATIONS = 2  # of each of these, for each start
HOPELESS = 0.3  # of what is needed: no motion separates a pair that none does by more

NONE_WITHIN = (
    "none of the motions that were drawn is within the limits; lengthen --duration, or try "
    "another --seed"
)

Family = FourierDraws | CourseDraws
Trajectory = FourierTrajectory | SweepTrajectory


@dataclass(frozen=True)
class OpenPair:
    """Two answers to a question, or one and that nothing is there; `names` are their numbers among
    its members. `needed` [σ], and as a share of how clearly the first one shows.
    """

    question: int
    names: tuple[int, int | None]
    one: Hypothesis
    other: Hypothesis | None
    needed: float
    needed_share: float

    def separation(self, experiment: PlannedExperiment) -> float:
        """What an experiment separates them by [σ]."""
        if self.other is None:
            return experiment.shown(self.one)
        return experiment.separation(self.one, self.other)

    def clearness(self, experiment: PlannedExperiment) -> float:
        """Separation over what is needed: settled from 1 on."""
        return self.separation(experiment) / self.asked(experiment)

    def asked(self, experiment: PlannedExperiment) -> float:
        """Separation at which one of the two is ruled out [σ]."""
        return max(self.needed, self.needed_share * experiment.shown(self.one))


@dataclass(frozen=True)
class Machinery:
    """What a prediction rests on: a model with values for each question, noise a row, and rows."""

    models: tuple[Model, ...]
    noise: np.ndarray
    row_rate: float

    def experiment(
        self, question: int, recordings: Sequence[PlannedRecording]
    ) -> PlannedExperiment:
        """As the rows of the diagnosis will show it."""
        return PlannedExperiment(self.models[question], recordings, self.noise, self.row_rate)


@dataclass(frozen=True)
class Settling:
    """Questions, and the search from many `starts` for a motion that answers them in a `duration`
    [s].
    """

    machinery: Machinery
    pairs: tuple[OpenPair, ...]
    families: tuple[Family, ...]
    duration: float
    starts: int

    def recording(self, trajectory: Trajectory) -> PlannedRecording:
        """As many whole periods as fit, two at least: what repeats tells its noise."""
        periods = max(2, round(self.duration / trajectory.period))
        return PlannedRecording(trajectory, periods)

    def clearness(self, recordings: Sequence[PlannedRecording]) -> np.ndarray:
        """Of every pair (p,)."""
        experiments = {
            number: self.machinery.experiment(number, recordings)
            for number in {pair.question for pair in self.pairs}
        }
        return np.array([pair.clearness(experiments[pair.question]) for pair in self.pairs])

    def foretellable(self, seed: int) -> "Settling":
        """With those pairs alone of which a recording can be foretold."""
        rng = np.random.default_rng(seed)
        drawn = (family.draw(rng) for family in self.families for _ in range(DRAWS * self.starts))
        some = next((self.recording(one) for one in drawn if one is not None), None)
        if some is None:
            raise RangeError(NONE_WITHIN)
        kept = tuple(pair for pair in self.pairs if self._can_foretell(pair, some))
        return replace(self, pairs=kept)

    def _can_foretell(self, pair: OpenPair, some: PlannedRecording) -> bool:
        """What carries a load, or needs a signal that nothing foretells, is not."""
        answers = [one for one in (pair.one, pair.other) if one is not None]
        if any(one.term.carried for one in answers):
            return False
        try:
            return bool(
                np.isfinite(pair.clearness(self.machinery.experiment(pair.question, [some])))
            )
        except CraneError:
            return False

    def search(self, seed: int, progress: Callable[[], object] = lambda: None) -> Trajectory:
        """The motion whose least clear pair is clearest, of those that any motion separates.

        `RangeError` if no motion that was drawn is within the limits.
        """
        rng = np.random.default_rng(seed)
        tried = []
        for family in self.families:
            for _ in range(DRAWS * self.starts):
                if (drawn := family.draw(rng)) is not None:
                    tried.append((family, drawn, self.clearness([self.recording(drawn)])))
                progress()
        if not tried:
            raise RangeError(NONE_WITHIN)
        hope = np.max([clear for _, _, clear in tried], axis=0) > HOPELESS
        counts = hope if hope.any() else ~hope

        def worth(clear: np.ndarray) -> float:
            return float(clear[counts].min())

        tried.sort(key=lambda one: -worth(one[2]))
        best = []
        for family, trajectory, clear in tried[:SURVIVORS]:
            for _ in range(VARIATIONS * self.starts):
                other = family.varied(trajectory, rng)  # type: ignore[arg-type]
                if other is not None:
                    found = self.clearness([self.recording(other)])
                    if worth(found) > worth(clear):
                        trajectory, clear = other, found
                progress()
            best.append((worth(clear), trajectory))
        return max(best, key=lambda one: one[0])[1]

    @property
    def steps(self) -> int:
        """How often a search calls `progress`, at most."""
        return self.starts * (len(self.families) * DRAWS + SURVIVORS * VARIATIONS)


def pairs_of(open_: OpenQuestions) -> Iterator[OpenPair]:
    """Of each question, every pair of its members; of a single member, it and nothing.

    Two laws of one effect need not be told apart, unless there is nothing else to tell.
    """
    for number, question in enumerate(open_.questions):
        answers = [Hypothesis.of(member) for member in question.members]
        needed = question.needed or 0.0, question.needed_share or 0.0
        if len(answers) == 1:
            yield OpenPair(number, (0, None), answers[0], None, *needed)
        every = list(combinations(range(len(answers)), 2))
        apart = [(i, j) for i, j in every if not answers[i].same_effect(answers[j])]
        for i, j in apart or every:
            yield OpenPair(number, (i, j), answers[i], answers[j], *needed)


def model_of(model: Model, question: OpenQuestion) -> Model:
    """The model that a question is asked beside: without the members that it has itself."""
    asked = {(member.effect, member.joint) for member in question.members}
    kept = [
        term for term in model.terms if (term.type, term.only_joint or "all") not in asked
    ]  # fmt: skip
    places = np.concatenate(
        [np.arange(len(model.parameters))[model.part(term)] for term in kept]
    ).astype(int)
    return replace(
        model,
        terms=tuple(kept),
        values=model.theta[places],
        std_devs=None if model.std_devs is None else model.std_devs[places],
    )
