"""The motion that discriminates best what a diagnosis left open: `design --settle`."""

import argparse
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from crane_model.configuration import save
from crane_model.errors import ConfigurationError, CraneError, RangeError
from crane_model.machine_files import machine_file
from crane_model.model_file import Model, load_model
from crane_model.open_question import (
    OpenMember,
    OpenQuestion,
    OpenQuestions,
    QuestionKind,
    read_open,
)
from crane_model.progress_bar import progress_bar
from crane_model.result_file import Number, ResultFile, ResultPart
from crane_model.terms import load_terms
from crane_trajectory.excitation.criterion import ColumnSet, Criterion, CriterionKind
from crane_trajectory.excitation.limits import DesignSettings, load_design_settings
from crane_trajectory.excitation.picture import draw
from crane_trajectory.excitation.search import ExcitationProblem, machine_of
from crane_trajectory.motion.check import Clearance, load_clearance
from crane_trajectory.motion.periodic import FourierTrajectory, SweepTrajectory
from crane_trajectory.settling.courses import CourseDraws, FourierDraws
from crane_trajectory.settling.prediction import Hypothesis, PlannedExperiment, PlannedRecording

# The motion that settles best what a diagnosis left open, and what no motion settles.

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


# What a designed motion promises: each pair of answers, before and after, and what else helps.

BACK_PRESSURE = 2e6  # Pa: what a throttle in the line to the tank may raise its pressure by


class HelpfulAction(ResultPart):
    """Something to do in a second recording of the motion."""

    action: str
    """In words."""
    separation: Number
    """By both recordings [σ]."""


class PredictedSeparation(ResultPart):
    """Two answers to a question, as the designed motion will tell them apart."""

    kind: QuestionKind
    """Of the question."""
    one: str
    """Effect and joint."""
    other: str
    """The same; empty where it is that nothing is there."""
    told: Number
    """By the recordings of the diagnosis; null where they were not compared [σ]."""
    predicted: Number
    """By the motion [σ]."""
    needed: Number
    """To rule one of them out [σ]."""
    actions: list[HelpfulAction]
    """Where the motion does not suffice, what does with it, best first."""
    settled_by: str
    """Where neither does, the experiment that would."""


class SettlingPlan(ResultFile):
    """What `design --settle` foretells of its trajectory."""

    trajectory: str
    """Its file."""
    periods: int
    """To record [-]."""
    duration: Number
    """Of these periods [s]."""
    separations: list[PredictedSeparation]
    """Of every pair of answers."""


def plan_of(
    settling: Settling, open_: OpenQuestions, best: PlannedRecording, file: str, load: float
) -> SettlingPlan:
    """What a recording promises; `load` [kg] is a known mass that there is to hang at the tip."""
    return SettlingPlan(
        trajectory=file,
        periods=best.periods,
        duration=best.duration,
        separations=[_predicted(settling, open_, pair, best, load) for pair in settling.pairs],
    )


def _predicted(
    settling: Settling, open_: OpenQuestions, pair: OpenPair, best: PlannedRecording, load: float
) -> PredictedSeparation:
    question = open_.questions[pair.question]
    one, other = pair.names
    first, second = question.members[one], None if other is None else question.members[other]
    experiment = settling.machinery.experiment(pair.question, [best])
    settled = pair.clearness(experiment) >= 1.0
    return PredictedSeparation(
        kind=question.kind,
        one=_told(first),
        other="" if second is None else _told(second),
        told=second.separation if second is not None and one == 0 else None,
        predicted=pair.separation(experiment),
        needed=pair.asked(experiment),
        actions=[] if settled else _actions(settling, pair, best, load),
        settled_by="" if settled else first.settled_by,
    )


def _actions(
    settling: Settling, pair: OpenPair, best: PlannedRecording, load: float
) -> list[HelpfulAction]:
    """Those by which a second recording settles what it does not settle without."""
    out = []
    for words, second in (
        (f"hang a known weight of {load:g} kg", replace(best, load=load)),
        (
            f"raise the back-pressure by {BACK_PRESSURE / 1e5:g} bar",
            replace(best, back_pressure=BACK_PRESSURE),
        ),
    ):
        try:
            experiment = settling.machinery.experiment(pair.question, [best, second])
            if pair.clearness(experiment) >= 1.0:
                out.append(HelpfulAction(action=words, separation=pair.separation(experiment)))
        except CraneError:
            continue  # no planar crane, or no cylinders
    return sorted(out, key=lambda one: -(one.separation or 0.0))


def _told(member: OpenMember) -> str:
    return f"{member.name} ({member.joint})"


def lines(plan: SettlingPlan) -> list[str]:
    """The plan as a table, and what to do where the motion does not suffice."""
    rows = [("answers", "told so far", "predicted", "needed")]
    for one in plan.separations:
        names = f"{one.one} | {one.other}" if one.other else f"{one.one} | nothing"
        rows.append((names, _sigma(one.told), _sigma(one.predicted), _sigma(one.needed)))
    first, *others = (max(map(len, column)) for column in zip(*rows, strict=True))
    out = [
        "  ".join([name.ljust(first), *map(str.rjust, numbers, others)]).rstrip()
        for name, *numbers in rows
    ]
    for one in plan.separations:
        if not one.settled_by:
            continue
        pair = f"{one.one} | {one.other or 'nothing'}"
        said = [
            f"{act.action} in a second recording: {_sigma(act.separation)}" for act in one.actions
        ]
        if not said:
            said = [one.settled_by]
        out.append(f"motion alone does not settle {pair}: {'; or '.join(said)}")
    return out


def beyond(asked: Settling, foretold: Settling, open_: OpenQuestions) -> list[str]:
    """What no recording can be foretold of, and the experiment that settles it."""
    out = []
    for pair in asked.pairs:
        if any(pair is one for one in foretold.pairs):
            continue
        members = open_.questions[pair.question].members
        one, other = pair.names
        names = f"{_told(members[one])} | {'nothing' if other is None else _told(members[other])}"
        out.append(f"no motion is sought for {names}: {members[one].settled_by}")
    return out


def _sigma(value: float | None) -> str:
    return "-" if value is None else f"{value:.3g} σ"


def open_lines(open_: OpenQuestions) -> Sequence[str]:
    """What is asked."""
    words = {
        QuestionKind.CLASS: "class",
        QuestionKind.NEAREST: "nearest of the catalogue",
        QuestionKind.UNDETERMINED: "undetermined",
    }
    return [
        f"{words[one.kind]}: {', '.join(_told(member) for member in one.members)}"
        for one in open_.questions
    ]


# `design --settle`: from the folder of a diagnosis to the motion that settles what it left.

PERIODS = 3  # of a recording: what repeats tells its noise
HARMONICS = (3, 6)  # of Fourier series
QUICKER = (1.0, 0.4)  # periods of these, over that of a course


def settle(arguments: argparse.Namespace, provenance: str) -> None:
    """Print and write the motion; raises `CraneError` with what is wrong."""
    folder, name = arguments.settle, arguments.machine
    if arguments.terms:
        load_terms(arguments.terms)
    open_ = read_open(folder / "findings.json")
    if not open_.questions:
        print("nothing is open that a motion could settle")
        return
    model = load_model(folder / "model.yaml").of_machine()
    settings = load_design_settings(machine_file("design.yaml", name, arguments.settings))
    clearance = load_clearance(machine_file("clearance.yaml", name, arguments.clearance))
    print("\n".join(open_lines(open_)))
    asked = _settling(model, open_, settings, clearance, arguments.duration, arguments.starts)
    settling = asked.foretellable(arguments.seed)
    print("\n".join(beyond(asked, settling, open_)))
    if not settling.pairs:
        return
    with progress_bar("design", settling.steps) as bar:
        best = settling.recording(settling.search(arguments.seed, bar.update))
    arguments.out.parent.mkdir(parents=True, exist_ok=True)
    file, picture = arguments.out, arguments.out.with_suffix(".png")
    told = plan_of(settling, open_, best, file.name, arguments.load)
    save(
        file,
        best.trajectory.model_copy(update={"name": file.stem, "provenance": provenance}),
    )
    told.write(file.with_suffix(".json"))
    draw(picture, machine_of(model), best.trajectory, clearance)
    print("\n".join(lines(told)))
    print(f"{best.periods} periods, {best.duration:.0f} s:")
    print(
        f"  ros2 run crane_trajectory run_excitation --periods {best.periods} --enable "
        f"--trajectory {file}"
    )
    print(f"written: {file}, {file.with_suffix('.json')}, {picture}")


def _settling(
    model: Model,
    open_: OpenQuestions,
    settings: DesignSettings,
    clearance: Clearance,
    duration: float,
    starts: int,
) -> Settling:
    noise = np.array([open_.noise.get(joint) or np.inf for joint in model.joints])
    if not np.isfinite(noise).any() or not open_.row_rate:
        raise ConfigurationError(
            "findings.json: key 'open.noise': of no joint; diagnose with recordings that move it"
        )
    models = tuple(model_of(model, question) for question in open_.questions)
    asked = {member.joint for one in open_.questions for member in one.members}
    joints = tuple(joint for joint in model.joints if joint in asked or "all" in asked)
    courses = CourseDraws(
        machine_of(model), model.joints, joints, clearance, settings.margins, duration / PERIODS
    )
    unasked = Criterion.of(
        model, CriterionKind.RAW, ColumnSet.BASE, settings.experiment, settings.plausible
    )
    families: list[Family] = [courses]
    for harmonics, quicker in zip(HARMONICS, QUICKER, strict=True):
        families.append(
            FourierDraws(
                ExcitationProblem(
                    model,
                    unasked,
                    round(quicker * duration / PERIODS, 2),
                    harmonics,
                    settings.search,
                    settings.margins,
                    clearance,
                )
            )
        )
    machinery = Machinery(models, noise, open_.row_rate)
    return Settling(machinery, tuple(pairs_of(open_)), tuple(families), duration, starts)
