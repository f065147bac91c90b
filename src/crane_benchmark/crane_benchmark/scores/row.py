"""row.json: the score of a case."""

from crane_benchmark.answers.answer_file import AnswerStatistics
from crane_benchmark.cases.case import CaseKind, EffectToHide, Site, Story, World
from crane_benchmark.cases.motions import Richness
from crane_benchmark.scores.judgement import BlindAnswer, Judgement
from crane_model.result_file import Number, NumberByJoint, ResultFile, ResultPart


class ScoredEffect(ResultPart):
    """What was hidden."""

    wanted: EffectToHide
    """As the case asks for it."""
    reached: Number = None
    """Largest strength that it had in a recording to train on [-]."""
    visibility: Number
    """Share of it that recordings of this kind show [-]; null where nothing says what is usual."""


class CaseRow(ResultFile):
    """The score of a case."""

    case: str
    """Its name."""
    kind: CaseKind
    """What sort of case it is."""
    site: Site
    """Whose machine it is."""
    world: World
    """Where it comes from."""
    off: bool
    """Whether its machine has not the lengths of its file."""
    story: Story | None
    """What goes on in it, of the strangers."""
    excitation: Richness
    """How well it is excited."""
    hidden: list[ScoredEffect]
    """All that was hidden."""
    gap: NumberByJoint
    """Error of the model on clean recordings, over the force: what could be explained [-]."""
    above_noise: bool
    """Whether that error is significantly above noise."""
    outcomes: dict[str, Judgement]
    """By method."""
    answers: dict[str, BlindAnswer]
    """By method."""
    reason: str
    """Of the diagnosis."""
    statistics: AnswerStatistics | None
    """Of the diagnosis."""
    seconds: Number
    """CPU time of the diagnosis [s]."""
    parameter_errors: list[float]
    """Relative, of those that mean the same in the hidden law [-]."""
    closed: Number
    """Share of the explainable gap that the effects close [-]; null where none is named."""
    closed_by_learner: Number
    """Share that the flexible learner closes [-]."""
