"""The verdict: from what was found, what is left of it, and what the recordings could show."""

from collections.abc import Mapping, Sequence
from enum import StrEnum
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from crane_identification.diagnosis.answer.unknown import UnknownForce
from crane_identification.diagnosis.decision.judgement import Judged
from crane_identification.diagnosis.proof.gap import Gap
from crane_identification.diagnosis.proof.proof import Nearest, Proof
from crane_identification.diagnosis.search.candidates import Candidate
from crane_identification.thresholds import Gates, Thresholds

SPOKEN = 4  # members of a class that the reason lists
OF_PERIODS = "the scatter between periods"
OF_SAMPLES = "what the scatter of samples and surveyed lengths account for"
NOT_HELD = "something is left that no effect of the catalogue explains"


class Verdict(StrEnum):
    """What a diagnosis answers."""

    NAMED = "named"
    AND_MORE = "named_and_more"
    CLASS = "class"
    NONE = "none"
    UNKNOWN = "unknown"
    INSUFFICIENT = "insufficient_data"


class OwnTerm(NamedTuple):
    """A term of the user's that is not named: why, and what it does, where it could be tried."""

    candidate: Candidate
    objection: str
    near: Nearest | None = None


class Answer(NamedTuple):
    """A verdict and its reason; `objection`: why effects that passed all tests are no names.
    `nearest`: what comes closest where nothing is named; `unknown`: what is known of it, or of what
    is left elsewhere. `named_from`: by joint, from which strength on effects are named. `own`: what
    the user's terms do that are not named.
    """

    verdict: Verdict
    reason: str
    objection: str = ""
    nearest: Nearest | None = None
    unknown: UnknownForce | None = None
    named_from: Mapping[str, float] = MappingProxyType({})
    own: tuple[OwnTerm, ...] = ()


class Reach(NamedTuple):
    """What recordings can show: the share of effects that is `testable`, the `least` strength that
    noise permits to show, by joint that from which an effect is `named`, and the parameters of the
    model that are `undetermined`.
    """

    testable: float
    least: float
    named: Mapping[str, float]
    undetermined: Sequence[str]


def judge(proof: Proof, reach: Reach, thresholds: Thresholds) -> Answer:
    """The answer of the force."""
    gap, method = proof.gap, thresholds.method
    if proof.trial.effects:
        return _of_effects(proof, thresholds)
    if proof.short:
        return Answer(Verdict.UNKNOWN, NOT_HELD, proof.short[-1].objection)
    if proof.trial.zero:
        return Answer(
            Verdict.UNKNOWN,
            NOT_HELD,
            f"its parameters are zero within {method.parameter_sigmas:.0f} standard deviations, or "
            "no more than usual",
        )
    law = proof.before.law
    if law.any():
        return Answer(
            Verdict.UNKNOWN,
            f"what is left on {_listed(gap, law)} follows a law, but none of the catalogue",
        )
    errors = gap.after, gap.training_before, thresholds.gates
    if beyond := _beyond(gap, *errors, OF_PERIODS):
        return Answer(Verdict.UNKNOWN, "; ".join(beyond))
    if reach.undetermined:
        return Answer(
            Verdict.INSUFFICIENT,
            f"they do not even determine {', '.join(reach.undetermined)} of the model; excite the "
            "joints more: both directions, several speeds, the whole range",
        )
    if reach.testable < method.testable_share:
        return Answer(
            Verdict.INSUFFICIENT,
            f"only {reach.testable:.0%} of the effects would show in these recordings; excite the "
            "joints more: both directions, several speeds, the whole range",
        )
    if reach.least > method.detectable_strength:
        return Answer(
            Verdict.INSUFFICIENT,
            f"of ten effects, one would not show at {reach.least:.1%} of the drive force; record "
            f"more{_better_known(gap)}",
        )
    if beyond := _beyond(gap, *errors, OF_SAMPLES):
        return Answer(Verdict.UNKNOWN, "; ".join(beyond))
    said = ", ".join(f"{least:.2%} on {joint}" for joint, least in reach.named.items())
    return Answer(
        Verdict.NONE,
        f"nine in ten effects would have been named from this share of the drive force on: {said}; "
        f"{_of_noise(gap)}",
    )


def _better_known(gap: Gap) -> str:
    """What else helps where values are kept."""
    worst = float(np.max(gap.uncertain))
    if not worst:
        return ""
    return (
        f", or keep values that are better known: their standard deviations make {worst:.1%} of "
        "the force uncertain"
    )


def _of_noise(gap: Gap) -> str:
    """How the held-out error of the model compares with noise, in words."""
    errors = np.maximum(gap.after, gap.training_before)
    known = np.isfinite(gap.floor)
    said = f"the force errs by {gap.over_samples(errors).max():.1f} times {OF_SAMPLES}"
    if not known.any():
        return f"{said} at most; no held-out recording repeats its motion"
    largest = float(np.nan_to_num(gap.over_floor(errors)).max())
    return f"{said}, and by {largest:.1f} times {OF_PERIODS}, at most" + (
        "" if known.all() else f"; not known of {_listed(gap, ~known)}"
    )


def _beyond(
    gap: Gap, held_out: np.ndarray, training: np.ndarray, gates: Gates, scatter: str
) -> list[str]:
    """Where relative errors (j,) are more than noise is by the `scatter`, in words."""
    errors = np.maximum(held_out, training)
    if scatter == OF_PERIODS:
        times, beyond = gap.over_floor(errors), gap.beyond_noise(errors, gates)
    else:
        times, beyond = gap.over_samples(errors), gap.beyond_samples(errors, gates)
    return [
        f"the force of {gap.joints[j]} errs by {held_out[j]:.2%} on held-out recordings and by "
        f"{training[j]:.2%} on the others, up to {times[j]:.0f} times {scatter}"
        for j in np.flatnonzero(beyond)
    ]


def _of_effects(proof: Proof, thresholds: Thresholds) -> Answer:
    """Effects that passed every test: are they all?"""
    share = proof.trial.explained(proof.before)
    said = _moved(proof)
    if np.isfinite(proof.gap.held_to.closed_on(np.flatnonzero(_acting(proof)).tolist())):
        said.insert(0, f"the effects explain {share:.0%} of what can be explained")
    classes = [_alternatives(one) for one in proof.trial.effects if one.indistinct]
    apart = [f"these recordings do not tell apart: {'; '.join(classes)}"] if classes else []
    more = _more(proof, share, thresholds)
    if more:
        return Answer(Verdict.AND_MORE, "; ".join(said + apart + more))
    if classes:
        return Answer(Verdict.CLASS, "; ".join(apart + said))
    return Answer(Verdict.NAMED, "; ".join(said))


def _moved(proof: Proof) -> list[str]:
    """What the effects do to the held-out errors where they act, in words."""
    gap, acting = proof.gap, _acting(proof)
    return [gap.moved(j) for j in np.flatnonzero(acting & (gap.after < gap.before))]


def _acting(proof: Proof) -> np.ndarray:
    """Whether any of the effects acts on a joint (j,)."""
    names = proof.gap.joints
    joints = {j for one in proof.trial.effects for j in one.shaped.joints(names)}
    return np.isin(np.arange(len(names)), list(joints))


def _more(proof: Proof, share: float, thresholds: Thresholds) -> list[str]:
    """What is missing beside the effects, in words; empty if nothing is."""
    trial, gap, method = proof.trial, proof.gap, thresholds.method
    said = []
    if share < method.explained_share:
        said.append(f"something more is missing, a law that is left on {_listed(gap, trial.law)}")
    if trial.left_share > method.left_share:
        said.append(f"they leave {trial.left_share:.0%} of the energy beyond noise where they act")
    for scatter in (OF_PERIODS, OF_SAMPLES) if trial.formless else (OF_PERIODS,):
        said += _beyond(gap, gap.after, gap.training_after, thresholds.gates, scatter)
    worse = gap.after > method.worse_factor * np.fmax(gap.before, method.clean_factor * gap.floor)
    acting = _acting(proof)
    said += [
        ("" if acting[j] else "where none of the effects acts, ") + gap.moved(j)
        for j in np.flatnonzero(worse)
    ]
    said += [
        f"{one.effect.shaped.candidate.label} would go with them, but {one.objection}"
        for one in proof.short
    ]
    return said


def _alternatives(one: Judged) -> str:
    """The class of an effect in words."""
    others = [member.label for member in one.indistinct]
    more = f", and {len(others) - SPOKEN} more" if len(others) > SPOKEN else ""
    return ", ".join([one.shaped.candidate.label, *others[:SPOKEN]]) + more


def _listed(gap: Gap, which: np.ndarray) -> str:
    return ", ".join(joint for joint, one in zip(gap.joints, which, strict=True) if one)
