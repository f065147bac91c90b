"""answer.json: what was said of a case, by those who had its bags alone."""

from crane_identification.diagnosis.findings_file import Findings
from crane_model.result_file import Number, ResultFile, ResultPart

CRASH = "crash"


class AnswerStatistics(ResultPart):
    """What thresholds are compared with. Scores are in units of the bootstrap quantile that is the
    threshold.
    """

    best: float
    """Score of the best effect, whether it is a finding or not [-]."""
    score: float
    """The same of those that are as strong as is asked for [-]."""
    accepted: float
    """The same of findings [-]."""
    learner: float
    """Strength of a law that the flexible learner is sure of [-]."""
    strength: float
    """Of that or the best [-]."""
    floor: float
    """Largest error over the scatter between periods [-]; 0 where none was repeated."""
    sample_noise: float
    """The same over what the scatter of samples and surveyed lengths account for [-]."""
    pulsation: float
    """Clearness of the clearest line [-]; 0 where none was asked for."""
    flow: float
    """Share of it that the strongest effect makes up [-]."""
    flow_left: float
    """Share of it that none explains [-]."""
    promised: list[float]
    """0 to 100 % quantiles of the best score by the bootstrap [-]."""


class CaseAnswer(ResultFile):
    """What was said of a case."""

    verdict: str
    """That of the findings, `insufficient_data` of recordings that are refused, or `crash`."""
    reason: str
    """Why, in a sentence; of a crash, where."""
    findings: Findings | None = None
    """Null of recordings that are refused, and of a crash."""
    statistics: AnswerStatistics | None = None
    """Null where there are no findings."""
    seconds: Number = None
    """CPU time of the diagnosis [s]."""
    others: dict[str, list[tuple[str, str]]] = {}
    """By method beside the diagnosis: the effects that it names, and their joints."""
