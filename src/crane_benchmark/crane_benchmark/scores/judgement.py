"""Judgement of an answer: by effect and joint, whichever of its model forms the catalogue names.

Position-dependent friction may be linear or cyclic in q: in the catalogue these are model forms of
one effect (`Effect.law_of`, `Effect.kin`), and naming either on the joint of the other is right.
"""

from collections.abc import Callable, Sequence
from enum import StrEnum

from crane_benchmark.answers.answer_cases import CRASH, CaseAnswer
from crane_benchmark.cases.case import CaseKind
from crane_benchmark.cases.case_sets import CONSTANT_FORCES
from crane_model.result_file import ResultPart
from crane_model.terms import REGISTRY

Place = tuple[str, str]
"""An effect and its joint, or `all`."""

SCALES = {"linkage_scale", "pressure_gain"}  # what scales the whole force of a joint
OURS = "diagnose"  # among the names of methods
AND_MORE = "named_and_more"  # right where its names are, though it does not say that this is all
NAMING = {"named", AND_MORE, "ambiguous"}  # verdicts that name effects


class Judgement(StrEnum):
    """How an answer compares with what is hidden."""

    RIGHT = "right"
    TOO_WIDE = "too wide"  # a class that holds it, and others that the data do tell from it
    PARTLY = "one of two"
    NOT_NAMED = "unknown"  # said to be outside the catalogue, and is in it
    MISSED = "missed"
    WRONG_NAME = "wrong name"
    FALSE_ALARM = "false alarm"
    REFUSED = "refused"  # insufficient data, where nothing is hidden
    CRASH = "crash"


class BlindAnswer(ResultPart):
    """A verdict and what it names."""

    verdict: str
    """As in `answer.json`."""
    findings: tuple[tuple[Place, ...], ...] = ()
    """Effect and joint of each finding, then of the other members of its ambiguity group."""

    @classmethod
    def of_diagnosis(cls, said: CaseAnswer) -> "BlindAnswer":
        """Findings of a diagnosis."""
        found = said.findings.findings if said.findings else []
        members = ((finding, *finding.ambiguity_group) for finding in found)
        places = tuple(tuple((one.effect, one.joint) for one in several) for several in members)
        return cls(verdict=said.verdict, findings=places)

    @classmethod
    def of_names(cls, names: Sequence[Place]) -> "BlindAnswer":
        """Findings of a method that only names effects."""
        return cls(verdict="named" if names else "none", findings=tuple((name,) for name in names))

    @property
    def headline(self) -> str:
        """The strongest effect, or the verdict where none is named."""
        if self.verdict in NAMING and self.findings:
            return self.findings[0][0][0]
        return self.verdict


def effect_of(law: str) -> str:
    """The type of one law that stands for all laws of the same effect."""
    cls = REGISTRY.get(law)
    if cls is None or cls.effect is None:
        return law  # in no catalogue, or of the flow, which has one law of each
    return cls.effect.law_of or min((law, *cls.effect.kin))


def laws() -> dict[str, list[str]]:
    """The effects of which the catalogue holds several laws, with these."""
    found: dict[str, list[str]] = {}
    for law in sorted(REGISTRY):
        found.setdefault(effect_of(law), []).append(law)
    return {effect: several for effect, several in found.items() if len(several) > 1}


def _same(first: Place, second: Place) -> bool:
    return first[1] == second[1] and effect_of(first[0]) == effect_of(second[0])


def judge(
    kind: CaseKind,
    hidden: Sequence[Place],
    answer: BlindAnswer,
    explains: Callable[[int, Place], bool],
    above_noise: bool = True,
    off: bool = False,
) -> Judgement:
    """Lengths that are not the file's need not show: `none` is right too where the error is not
    `above_noise`. Where a machine is `off`, what scales the force of a joint may be named, beside
    what else is hidden.

    `explains(i, other)` says whether `other` explains the i-th hidden effect as well as its own
    law; an ambiguity group is right if all its members are. Ambiguous cases lack the first effect.
    """
    verdict = answer.verdict
    if verdict == CRASH:
        return Judgement.CRASH
    if kind is CaseKind.NOTHING:
        silent = {"none": Judgement.RIGHT, "insufficient_data": Judgement.REFUSED}
        return silent.get(verdict, Judgement.FALSE_ALARM)
    if kind in {CaseKind.OUTSIDE, CaseKind.LENGTHS} and verdict == "unknown":
        return Judgement.RIGHT
    if verdict == "insufficient_data":
        return (
            Judgement.RIGHT
            if kind in {CaseKind.AMBIGUOUS, CaseKind.INSUFFICIENT}
            else Judgement.MISSED
        )
    if verdict == "unknown":
        return Judgement.NOT_NAMED
    if verdict == "none":
        shown = above_noise or kind is not CaseKind.LENGTHS
        return Judgement.MISSED if shown else Judgement.RIGHT
    rest = without_lengths(answer, hidden) if off else answer
    of_lengths = (finding for finding in answer.findings if finding not in rest.findings)
    wide = any(effect not in SCALES for members in of_lengths for effect, _ in members)
    outcome = _beside_lengths(kind, hidden, rest, explains)
    return Judgement.TOO_WIDE if wide and outcome is Judgement.RIGHT else outcome


def without_lengths(answer: BlindAnswer, hidden: Sequence[Place]) -> BlindAnswer:
    """The answer without what is said of lengths that are not the file's."""
    rest = tuple(finding for finding in answer.findings if not _of_lengths(finding, hidden))
    return answer.model_copy(update={"findings": rest})


def _of_lengths(members: Sequence[Place], hidden: Sequence[Place]) -> bool:
    """Return whether a finding is the effect of such a linkage, and not an injected one."""
    meant = any(_same(place, member) for member in members for place in hidden)
    return not meant and any(effect in SCALES for effect, _ in members)


def _beside_lengths(
    kind: CaseKind,
    hidden: Sequence[Place],
    answer: BlindAnswer,
    explains: Callable[[int, Place], bool],
) -> Judgement:
    """Judge an answer by its findings besides the lengths that it names."""
    if kind is CaseKind.LENGTHS:
        return Judgement.WRONG_NAME if answer.findings else Judgement.RIGHT
    if not answer.findings:  # lengths alone are named
        if kind is CaseKind.OUTSIDE and answer.verdict == AND_MORE:
            return Judgement.RIGHT  # the rest is unknown
        return Judgement.NOT_NAMED if answer.verdict == AND_MORE else Judgement.MISSED
    if kind is CaseKind.AMBIGUOUS:
        return _of_ambiguous(hidden, answer, explains)
    outcome = _named(hidden, answer, explains)
    if kind is CaseKind.INSUFFICIENT and outcome is Judgement.TOO_WIDE:
        return Judgement.RIGHT  # so little data does not tell the class apart
    return outcome


def _of_ambiguous(
    hidden: Sequence[Place], answer: BlindAnswer, explains: Callable[[int, Place], bool]
) -> Judgement:
    """Judge an answer to an ambiguous case; a further finding may be another model form."""
    known = {(effect, "telescope") for effect in CONSTANT_FORCES}
    classes = [set(members) for members in answer.findings if set(members) & known]
    further = [members for members in answer.findings if not set(members) & known]
    laws = [[any(_same(name, place) for place in hidden) for name in named] for named in further]
    if len(classes) != 1 or not all(map(any, laws)):
        return Judgement.WRONG_NAME
    found = classes[0]
    if len(found & known) < 2:
        return Judgement.WRONG_NAME  # picks one where nothing tells them apart
    alike = all(explains(0, place) for place in found - known)
    return Judgement.RIGHT if alike and all(map(all, laws)) else Judgement.TOO_WIDE


def _named(
    hidden: Sequence[Place], answer: BlindAnswer, explains: Callable[[int, Place], bool]
) -> Judgement:
    """Two findings may be laws of one hidden effect that neither describes alone."""
    found: set[int] = set()
    wide = False
    for members in answer.findings:
        meant = [
            i for i, place in enumerate(hidden) if any(_same(place, member) for member in members)
        ]
        if not meant:
            return Judgement.WRONG_NAME
        chosen = next((i for i in meant if i not in found), meant[0])
        found.add(chosen)
        wide |= not all(
            _same(member, hidden[chosen]) or explains(chosen, member) for member in members
        )
    if len(found) < len(hidden):
        return Judgement.PARTLY
    return Judgement.TOO_WIDE if wide else Judgement.RIGHT
