"""The verdict: from what was found, what is left of it, and what the recordings could show."""

from collections.abc import Sequence
from enum import StrEnum

import numpy as np

from crane_identification.discrepancy.decision import Accepted
from crane_identification.discrepancy.gap import Gap
from crane_identification.discrepancy.hydraulics import Flow
from crane_identification.discrepancy.learner import Learnt
from crane_identification.discrepancy.pulsation import Pulsation
from crane_identification.discrepancy.search import Search
from crane_identification.discrepancy.thresholds import Thresholds
from crane_identification.discrepancy.weighing import Weighed

SPOKEN = 4  # members of a class that the reason lists
WORSE = 1.05  # times the error before, on held-out recordings, that is more than chance


class Verdict(StrEnum):
    """What a diagnosis answers."""

    NAMED = "named"
    CLASS = "class"
    NONE = "none"
    UNKNOWN = "unknown"
    INSUFFICIENT = "insufficient_data"


def judge(
    found: Search,
    accepted: Sequence[Accepted],
    energies: tuple[np.ndarray, np.ndarray],
    learnt: tuple[Learnt, Learnt],
    left_share: float,
    least: float,
    undetermined: Sequence[str],
    thresholds: Thresholds,
) -> tuple[Verdict, str]:
    """The verdict and its reason.

    `energies` (c,) of the residual and what is `learnt` from it, before and after the `accepted`
    effects are added; `left_share` of the energy beyond noise that these leave where they act;
    `least` strength that would show; `undetermined` parameters of the model.
    """
    if accepted:
        return _of_effects(accepted, energies, learnt[1], left_share, thresholds)
    law = follows_law(learnt[0], thresholds)
    if law.any():
        return (
            Verdict.UNKNOWN,
            f"what is left on {_listed(found, law)} follows a law, but none of the catalogue",
        )
    if undetermined:
        return (
            Verdict.INSUFFICIENT,
            f"they do not even determine {', '.join(undetermined)} of the model; excite the "
            "joints more: both directions, several speeds, the whole range",
        )
    tested = {option.family for option in found.projection.options}
    share = len(tested) / max(len(tested) + len(found.untestable), 1)
    if share < thresholds.testable_share:
        return (
            Verdict.INSUFFICIENT,
            f"only {share:.0%} of the effects would show in these recordings; excite the joints "
            "more: both directions, several speeds, the whole range",
        )
    if least > thresholds.detectable_strength:
        return (
            Verdict.INSUFFICIENT,
            f"of ten effects, one would not show at {least:.1%} of the drive force; record more",
        )
    return (
        Verdict.NONE,
        f"nine in ten effects above {least:.2%} of the drive force would have shown",
    )


def with_flow(verdict: Verdict, reason: str, flows: Sequence[Flow]) -> tuple[Verdict, str]:
    """The verdict where the flow of oil, which the torque cannot show, tells something more."""
    strange = [flow for flow in flows if flow.unknown]
    if verdict is Verdict.NONE and strange:
        return Verdict.UNKNOWN, "; ".join(
            f"{flow.unexplained:.1%} of the flow of {flow.joint} follow a law, but none of the "
            "catalogue"
            for flow in strange
        )
    if not any(flow.missing for flow in flows):
        return verdict, reason
    said = "; ".join(
        f"{one.effect.name} of {flow.joint} is beyond what is usual"
        for flow in flows
        for one in flow.missing
    )
    settled = verdict in (Verdict.NONE, Verdict.INSUFFICIENT)
    return (Verdict.NAMED, said) if settled else (verdict, f"{reason}; {said}")


def with_pulsation(
    verdict: Verdict, reason: str, pulsations: Sequence[Pulsation]
) -> tuple[Verdict, str]:
    """The verdict where a line is in the force that no motion makes."""
    if not pulsations:
        return verdict, reason
    said = "; ".join(
        f"the force of {one.joint} pulsates at {one.frequency:.2f} Hz in all recordings "
        f"({one.strength:.1%} of it), which no effect of the catalogue does"
        for one in pulsations
    )
    if verdict is Verdict.NONE:
        return Verdict.UNKNOWN, said
    return verdict, f"{reason}; {said}"


def with_loads(verdict: Verdict, reason: str, loads: Sequence[Weighed]) -> tuple[Verdict, str]:
    """The verdict where a held-out recording carries another load than all those trained on."""
    said = "; ".join(
        f"{one.recording} carries {abs(one.mass):.3g} kg {'more' if one.mass > 0.0 else 'less'} "
        "than the recordings trained on"
        for one in loads
        if one.found
    )
    if not said:
        return verdict, reason
    settled = verdict in (Verdict.NONE, Verdict.INSUFFICIENT)
    return (Verdict.NAMED, said) if settled else (verdict, f"{reason}; {said}")


def proved(reason: str, gap: Gap) -> str:
    """The reason, and where what was added does not carry over to the held-out recordings."""
    worse = [
        joint
        for joint, before, after in zip(gap.joints, gap.before, gap.after, strict=True)
        if after > WORSE * before
    ]
    if not worse:
        return reason
    return (
        f"{reason}; it does not carry over to the held-out recordings, whose force on "
        f"{', '.join(worse)} is predicted worse: they differ in something else"
    )


def follows_law(learnt: Learnt, thresholds: Thresholds) -> np.ndarray:
    """(j,): whether a law is in the residual, beyond chance and beyond errors of the processing."""
    limit = thresholds.false_alarm_rate / 2.0 / len(learnt.share)
    return (learnt.p_value < limit) & (learnt.strength > thresholds.smallest_strength)


def normalized_energy(found: Search, left: np.ndarray) -> np.ndarray:
    """Energy (c,) of a residual (n, c) in units of the noise."""
    variance = [1.0 if noise is None else noise.variance for noise in found.whitener.noise]
    return (np.where(found.evidence.used, left, 0.0) ** 2).sum(axis=0) / np.array(variance)


def _of_effects(
    accepted: Sequence[Accepted],
    energies: tuple[np.ndarray, np.ndarray],
    left: Learnt,
    left_share: float,
    thresholds: Thresholds,
) -> tuple[Verdict, str]:
    before, after = energies
    learnable = np.where(follows_law(left, thresholds), left.share, 0.0)
    remaining = float((after[: len(learnable)] * learnable).sum())
    named = max(float((before - after).sum()), 0.0)
    share = named / max(named + remaining, np.finfo(float).tiny)
    if share < thresholds.explained_share:
        return (
            Verdict.UNKNOWN,
            f"the best of the catalogue explain {share:.0%} of what can be explained; "
            f"{thresholds.explained_share:.0%} are asked for",
        )
    if left_share > thresholds.left_share:
        return (
            Verdict.UNKNOWN,
            f"the best of the catalogue leave {left_share:.0%} of the energy beyond noise where "
            f"they act; at most {thresholds.left_share:.0%} are allowed",
        )
    classes = [_alternatives(one) for one in accepted if one.members]
    if classes:
        return Verdict.CLASS, f"these recordings do not tell apart: {'; '.join(classes)}"
    return Verdict.NAMED, f"the effects explain {share:.0%} of what can be explained"


def _alternatives(one: Accepted) -> str:
    """The class of an effect in words."""
    others = [member.label for member in one.members]
    more = f", and {len(others) - SPOKEN} more" if len(others) > SPOKEN else ""
    return ", ".join([one.option.family.label, *others[:SPOKEN]]) + more


def _listed(found: Search, which: np.ndarray) -> str:
    return ", ".join(joint for joint, one in zip(found.evidence.joints, which, strict=True) if one)
