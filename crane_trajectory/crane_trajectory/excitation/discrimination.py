"""The motion that discriminates best what a diagnosis left open: `design --discriminate`.

What it promises is told of each pair of answers, before and after, with what else helps; and what
no motion discriminates.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from pathlib import Path
from typing import NamedTuple

import numpy as np

from crane_model.configuration import save
from crane_model.errors import ConfigurationError, CraneError, RangeError
from crane_model.machine_files import machine_file
from crane_model.model_file import Model, load_model
from crane_model.progress_bar import progress_bar
from crane_model.result_file import (
    Number,
    OpenMember,
    OpenQuestion,
    OpenQuestions,
    QuestionKind,
    ResultFile,
    ResultPart,
    read_open,
)
from crane_model.terms import load_terms
from crane_trajectory.excitation.criterion import ColumnSet, Criterion, CriterionKind
from crane_trajectory.excitation.limits import DesignSettings, load_design_settings
from crane_trajectory.excitation.prediction import Hypothesis, PlannedExperiment, PlannedRecording
from crane_trajectory.excitation.search import ExcitationProblem, machine_of
from crane_trajectory.excitation.sweeps import CourseDraws, FourierDraws
from crane_trajectory.motion.check import Clearance, draw, load_clearance
from crane_trajectory.motion.periodic import FourierTrajectory, SweepTrajectory

DRAWS_PER_START = 4  # of each family of motions
SURVIVORS = 4  # that are varied
VARIATIONS_PER_START = 2  # of each of these
HOPELESS = 0.3  # of what is needed: no motion separates a pair that none does by more
BACK_PRESSURE = 2e6  # Pa: what a throttle in the line to the tank may raise its pressure by
PERIODS = 3  # of a recording: what repeats tells its noise
HARMONICS_AND_PACE = ((3, 1.0), (6, 0.4))  # of Fourier series, their periods over that of a course

NONE_WITHIN = (
    "none of the motions that were drawn is within the limits; lengthen --duration, or try "
    "another --seed"
)

Family = FourierDraws | CourseDraws
Trajectory = FourierTrajectory | SweepTrajectory


@dataclass(frozen=True)
class OpenPair:
    """Two answers to a question, or one and that nothing is there; `places` are those among its
    members. `needed` [σ], and as a share of how clearly the first one shows.
    """

    question: int
    places: tuple[int, int | None]
    first: Hypothesis
    second: Hypothesis | None
    needed: float
    needed_share: float

    def separation(self, experiment: PlannedExperiment) -> float:
        """Separation by an experiment [σ]."""
        if self.second is None:
            return experiment.shown(self.first)
        return experiment.separation(self.first, self.second)

    def clearness(self, experiment: PlannedExperiment) -> float:
        """Separation over what is needed: discriminated from 1 on."""
        return self.separation(experiment) / self.asked(experiment)

    def asked(self, experiment: PlannedExperiment) -> float:
        """Separation at which one of the two is ruled out [σ]."""
        return max(self.needed, self.needed_share * experiment.shown(self.first))

    def members(self, open_: OpenQuestions) -> tuple[OpenMember, OpenMember | None]:
        """Members in the diagnosis; None for the hypothesis of no effect."""
        members, (first, second) = open_.questions[self.question].members, self.places
        return members[first], None if second is None else members[second]


@dataclass(frozen=True)
class Machinery:
    """Basis of a prediction: a model with values for each question, noise a row, and rows."""

    models: tuple[Model, ...]
    noise: np.ndarray
    row_rate: float

    def experiment(
        self, question: int, recordings: Sequence[PlannedRecording]
    ) -> PlannedExperiment:
        return PlannedExperiment(self.models[question], recordings, self.noise, self.row_rate)


class DrawnMotion(NamedTuple):
    """A candidate, and how clear it makes each pair (p,)."""

    family: Family
    trajectory: Trajectory
    clear: np.ndarray


@dataclass(frozen=True)
class ExperimentSearch:
    """Questions, and the search from many `starts` for a motion that answers them."""

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
        """Separation of every pair (p,)."""
        experiments = {
            number: self.machinery.experiment(number, recordings)
            for number in {pair.question for pair in self.pairs}
        }
        return np.array([pair.clearness(experiments[pair.question]) for pair in self.pairs])

    def predictable(self, seed: int) -> "ExperimentSearch":
        """With those pairs alone of which a recording can be predicted."""
        rng = np.random.default_rng(seed)
        drawn = (
            family.draw(rng)
            for family in self.families
            for _ in range(DRAWS_PER_START * self.starts)
        )
        recording = next(
            (self.recording(trajectory) for trajectory in drawn if trajectory is not None), None
        )
        if recording is None:
            raise RangeError(NONE_WITHIN)
        kept = tuple(pair for pair in self.pairs if self._can_predict(pair, recording))
        return replace(self, pairs=kept)

    def _can_predict(self, pair: OpenPair, recording: PlannedRecording) -> bool:
        """Return whether the pair needs neither a load nor a signal that nothing predicts."""
        answers = [answer for answer in (pair.first, pair.second) if answer is not None]
        if any(answer.term.carried for answer in answers):
            return False
        try:
            return bool(
                np.isfinite(pair.clearness(self.machinery.experiment(pair.question, [recording])))
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
            for _ in range(DRAWS_PER_START * self.starts):
                if (drawn := family.draw(rng)) is not None:
                    clear = self.clearness([self.recording(drawn)])
                    tried.append(DrawnMotion(family, drawn, clear))
                progress()
        if not tried:
            raise RangeError(NONE_WITHIN)
        hope = np.max([candidate.clear for candidate in tried], axis=0) > HOPELESS
        counts = hope if hope.any() else ~hope

        def worth(clear: np.ndarray) -> float:
            return float(clear[counts].min())

        tried.sort(key=lambda candidate: -worth(candidate.clear))
        best = []
        for family, trajectory, clear in tried[:SURVIVORS]:
            for _ in range(VARIATIONS_PER_START * self.starts):
                variation = family.varied(trajectory, rng)  # type: ignore[arg-type]
                if variation is not None:
                    found = self.clearness([self.recording(variation)])
                    if worth(found) > worth(clear):
                        trajectory, clear = variation, found
                progress()
            best.append((worth(clear), trajectory))
        return max(best, key=lambda candidate: candidate[0])[1]

    @property
    def steps(self) -> int:
        """How often a search calls `progress`, at most."""
        return self.starts * (
            len(self.families) * DRAWS_PER_START + SURVIVORS * VARIATIONS_PER_START
        )


def pairs_of(open_: OpenQuestions) -> Iterator[OpenPair]:
    """Every pair of each question's members; a single member is paired with nothing.

    Two model forms of one effect are paired only if there is no other pair.
    """
    for number, question in enumerate(open_.questions):
        answers = [Hypothesis.of(member) for member in question.members]
        needed = question.needed or 0.0, question.needed_share or 0.0
        if len(answers) == 1:
            yield OpenPair(number, (0, None), answers[0], None, *needed)
        pairs = list(combinations(range(len(answers)), 2))
        apart = [(i, j) for i, j in pairs if not answers[i].same_effect(answers[j])]
        for i, j in apart or pairs:
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


class HelpfulAction(ResultPart):
    """Something to do in a second recording of the motion."""

    action: str
    """In words."""
    separation: Number
    """By both recordings [σ]."""


class PredictedSeparation(ResultPart):
    """Separation of two answers to a question by the designed motion."""

    kind: QuestionKind
    """Kind of the question."""
    first: str
    """Effect and joint."""
    second: str
    """Effect and joint; empty for no effect."""
    so_far: Number
    """Separation by the recordings of the diagnosis; null if not compared [σ]."""
    predicted: Number
    """Separation by the motion [σ]."""
    needed: Number
    """Separation that rules out one answer [σ]."""
    actions: list[HelpfulAction]
    """Actions that suffice with the motion if it does not alone, best first."""
    discriminated_by: str
    """Experiment that discriminates if neither does."""


class DiscriminationPlan(ResultFile):
    """Prediction of `design --discriminate` for its trajectory."""

    trajectory: str
    """Its file."""
    periods: int
    """To record [-]."""
    duration: Number
    """Duration of these periods [s]."""
    separations: list[PredictedSeparation]
    """Separations of every pair of answers."""


def _predicted(
    search: ExperimentSearch,
    open_: OpenQuestions,
    pair: OpenPair,
    best: PlannedRecording,
    load: float,
) -> PredictedSeparation:
    first, second = pair.members(open_)
    experiment = search.machinery.experiment(pair.question, [best])
    discriminated = pair.clearness(experiment) >= 1.0
    return PredictedSeparation(
        kind=open_.questions[pair.question].kind,
        first=_told(first),
        second=_told(second),
        so_far=second.separation if second is not None and pair.places[0] == 0 else None,
        predicted=pair.separation(experiment),
        needed=pair.asked(experiment),
        actions=[] if discriminated else _actions(search, pair, best, load),
        discriminated_by="" if discriminated else first.discriminated_by,
    )


def _actions(
    search: ExperimentSearch, pair: OpenPair, best: PlannedRecording, load: float
) -> list[HelpfulAction]:
    """Those by which a second recording discriminates what this motion alone does not."""
    out = []
    for words, second in (
        (f"hang a known weight of {load:g} kg", replace(best, load=load)),
        (
            f"raise the back-pressure by {BACK_PRESSURE / 1e5:g} bar",
            replace(best, back_pressure=BACK_PRESSURE),
        ),
    ):
        try:
            experiment = search.machinery.experiment(pair.question, [best, second])
            if pair.clearness(experiment) >= 1.0:
                out.append(HelpfulAction(action=words, separation=pair.separation(experiment)))
        except CraneError:
            continue  # no planar crane, or no cylinders
    return sorted(out, key=lambda action: -(action.separation or 0.0))


def _told(member: OpenMember | None) -> str:
    return "" if member is None else f"{member.name} ({member.joint})"


def lines(plan: DiscriminationPlan) -> list[str]:
    """The plan as a table, and what to do if the motion does not suffice."""
    rows, remedies = [("answers", "so far", "predicted", "needed")], []
    for pair in plan.separations:
        names = f"{pair.first} | {pair.second or 'nothing'}"
        rows.append((names, _sigma(pair.so_far), _sigma(pair.predicted), _sigma(pair.needed)))
        if pair.discriminated_by:
            helpful = [
                f"{act.action} in a second recording: {_sigma(act.separation)}"
                for act in pair.actions
            ] or [pair.discriminated_by]
            remedies.append(f"motion alone does not discriminate {names}: {'; or '.join(helpful)}")
    first, *widths = (max(map(len, column)) for column in zip(*rows, strict=True))
    table = [
        "  ".join([name.ljust(first), *map(str.rjust, numbers, widths)]).rstrip()
        for name, *numbers in rows
    ]
    return table + remedies


def beyond(asked: ExperimentSearch, predicted: ExperimentSearch, open_: OpenQuestions) -> list[str]:
    """Pairs that no recording can be predicted for, and the experiment that discriminates them."""
    out = []
    for pair in asked.pairs:
        if any(pair is kept for kept in predicted.pairs):
            continue
        first, second = pair.members(open_)
        names = f"{_told(first)} | {_told(second) or 'nothing'}"
        out.append(f"no motion is sought for {names}: {first.discriminated_by}")
    return out


def _sigma(value: float | None) -> str:
    return "-" if value is None else f"{value:.3g} σ"


def open_lines(open_: OpenQuestions) -> Sequence[str]:
    """Lines of the open questions."""
    words = {
        QuestionKind.AMBIGUOUS: "ambiguous",
        QuestionKind.NEAREST: "nearest of the catalogue",
        QuestionKind.UNDETERMINED: "undetermined",
    }
    return [
        f"{words[question.kind]}: {', '.join(_told(member) for member in question.members)}"
        for question in open_.questions
    ]


class DiscriminationRequest(NamedTuple):
    """Request of `design --discriminate`."""

    folder: Path  # of the diagnosis
    terms: Path | None
    machine: str
    settings: Path | None
    clearance: Path | None
    duration: float  # s
    load: float  # kg
    seed: int
    starts: int
    out: Path
    provenance: str


def discriminate(request: DiscriminationRequest) -> None:
    """Print and write the motion; raises `CraneError` with what is wrong."""
    folder, name, file = request.folder, request.machine, request.out
    if request.terms:
        load_terms(request.terms)
    open_ = read_open(folder / "findings.json")
    if not open_.questions:
        print("nothing is open that a motion could discriminate")
        return
    model = load_model(folder / "model.yaml").of_machine()
    settings = load_design_settings(machine_file("design.yaml", name, request.settings))
    clearance = load_clearance(machine_file("clearance.yaml", name, request.clearance))
    print("\n".join(open_lines(open_)))
    asked = _experiment_search(model, open_, settings, clearance, request.duration, request.starts)
    search = asked.predictable(request.seed)
    print("\n".join(beyond(asked, search, open_)))
    if not search.pairs:
        return
    with progress_bar("design", search.steps) as bar:
        best = search.recording(search.search(request.seed, bar.update))
    file.parent.mkdir(parents=True, exist_ok=True)
    plan, picture = file.with_suffix(".json"), file.with_suffix(".png")
    told = DiscriminationPlan(
        trajectory=file.name,
        periods=best.periods,
        duration=best.duration,
        separations=[_predicted(search, open_, pair, best, request.load) for pair in search.pairs],
    )
    update = {"name": file.stem, "provenance": request.provenance}
    save(file, best.trajectory.model_copy(update=update))
    told.write(plan)
    draw(picture, machine_of(model), best.trajectory, clearance)
    print("\n".join(lines(told)))
    print(f"{best.periods} periods, {best.duration:.0f} s:")
    print(
        f"  ros2 run crane_trajectory run_excitation --periods {best.periods} --enable "
        f"--trajectory {file}"
    )
    print(f"written: {file}, {plan}, {picture}")


def _experiment_search(
    model: Model,
    open_: OpenQuestions,
    settings: DesignSettings,
    clearance: Clearance,
    duration: float,
    starts: int,
) -> ExperimentSearch:
    noise = np.array([open_.noise.get(joint) or np.inf for joint in model.joints])
    if not np.isfinite(noise).any() or not open_.row_rate:
        raise ConfigurationError(
            "findings.json: key 'open.noise': of no joint; diagnose with recordings that move it"
        )
    models = tuple(model_of(model, question) for question in open_.questions)
    asked = {member.joint for question in open_.questions for member in question.members}
    joints = tuple(joint for joint in model.joints if joint in asked or "all" in asked)
    courses = CourseDraws(
        machine_of(model), model.joints, joints, clearance, settings.margins, duration / PERIODS
    )
    unasked = Criterion.of(
        model, CriterionKind.RAW, ColumnSet.BASE, settings.experiment, settings.plausible
    )
    families: list[Family] = [courses]
    for harmonics, pace in HARMONICS_AND_PACE:
        families.append(
            FourierDraws(
                ExcitationProblem(
                    model,
                    unasked,
                    round(pace * duration / PERIODS, 2),
                    harmonics,
                    settings.search,
                    settings.margins,
                    clearance,
                )
            )
        )
    machinery = Machinery(models, noise, open_.row_rate)
    return ExperimentSearch(machinery, tuple(pairs_of(open_)), tuple(families), duration, starts)
