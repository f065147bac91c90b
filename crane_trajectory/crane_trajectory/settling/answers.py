"""What a designed motion promises: each pair of answers, before and after, and what else helps."""

from collections.abc import Sequence
from dataclasses import replace

from crane_model.errors import CraneError
from crane_model.open_question import OpenMember, OpenQuestions, QuestionKind
from crane_model.result_file import Number, ResultFile, ResultPart
from crane_trajectory.settling.prediction import PlannedRecording
from crane_trajectory.settling.settling import OpenPair, Settling

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
