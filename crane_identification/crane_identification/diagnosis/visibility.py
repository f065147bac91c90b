"""Candidates that these recordings can show: visible beside the model, and in used rows.

Friction that shows around reversals alone, where the sign of a velocity is unknown and no row is
used, is not asked for. Breakaway is over once a joint has slid some tenths of a millimetre. If it
has not been moving by then for as long as the estimate of its velocity needs, no row has seen it.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from crane_identification.diagnosis.candidates import Candidate, ShapedCandidate
from crane_identification.diagnosis.constants import (
    FORCE_CORRELATION,
    LITTLE_SHARE,
    MOST_SHARE,
    SHORT_LEAD,
    SLIGHT_SHARE,
    VISIBLE_SHARE,
)
from crane_identification.diagnosis.evidence import (
    TINY,
    Evidence,
    Run,
    beside,
    leading,
)
from crane_identification.diagnosis.projection import (
    SINGULAR_SHARE,
    Base,
    Projection,
    Whitener,
)
from crane_model.terms import Term

# What follows the measured force, which holds whatever is sought.
#
# Where it pulls one way, a shape over it that differs between the directions of motion can be the
# force less a constant: it explains all of it, noise included, of any machine.


def _with_force(evidence: Evidence, force: Callable[[Run], np.ndarray]) -> Evidence:
    """The evidence with another force (samples, j) in the records of its runs."""
    runs = (replace(run, record=replace(run.record, force=force(run))) for run in evidence.runs)
    return replace(evidence, runs=tuple(runs))


def with_predicted_force(evidence: Evidence) -> Evidence:
    """The evidence with the force that the model predicts in place of the measured one."""
    return _with_force(evidence, lambda run: _predicted(evidence, run))


def _predicted(evidence: Evidence, run: Run) -> np.ndarray:
    return evidence.model.regressor(run.record) @ evidence.values


def is_the_force_itself(evidence: Evidence, term: Term, joint: str) -> bool:
    """Return whether a term explains a residual turned round in time: no load makes it."""
    j = evidence.joints.index(joint)

    def turned(run: Run) -> np.ndarray:
        measured, force = run.record.needed("force", "a diagnosis"), _predicted(evidence, run)
        force[:, j] += (measured - force)[::-1, j]
        return force

    made = _with_force(evidence, turned)
    rows = [
        run.filtered(run.record.needed("force", "a diagnosis")[..., np.newaxis])[:, j, 0]
        for run in made.runs
    ]
    used, known = evidence.used[:, j], evidence.base[:, j]
    known = leading(known[used], known.shape[1])
    rest = beside(known, np.concatenate(rows)[used])
    columns = beside(known, made.columns(term)[used, j])
    alone = leading(columns, columns.shape[1])
    return bool(((alone.T @ rest) ** 2).sum() > MOST_SHARE * (rest @ rest))


# Shapes by which the measured force explains its own noise: the force at other instants.
#
# A column F(t + lead) - F(t) holds the noise of F(t), which is in what the model leaves as well.
# The force that the model predicts has none: a reading that is late shows in that, too.

LEAD = "lead"  # shape parameter [s]


def holds_noise(one: ShapedCandidate) -> bool:
    """Return whether a column holds the noise of the force itself."""
    return float(one.shape.get(LEAD, 0.0)) > SHORT_LEAD


def of_own_noise(
    evidence: Evidence, whitener: Whitener, base: Base, found: list[ShapedCandidate]
) -> tuple[np.ndarray, set[Candidate]]:
    """Candidates (candidates,) that may explain only noise by itself, and their effects."""
    numbers = [number for number, one in enumerate(found) if LEAD in one.shape]
    predicted = with_predicted_force(evidence) if numbers else evidence
    own, late = np.zeros((2, len(found)))
    for number in numbers:
        one = found[number]
        own[number] = _gain(whitener, base, one.columns)
        shown = _late(predicted, one.shape[LEAD])
        late[number] = _gain(whitener, base, shown.columns(one.term))
    noisy = set()
    for candidate in {found[number].candidate for number in numbers}:
        same = [number for number in numbers if found[number].candidate == candidate]
        if late[same].max() < MOST_SHARE * own[same].max():
            noisy.add(candidate)
    out = [holds_noise(one) for one in found] | (late < MOST_SHARE * own)
    return out & [one.candidate in noisy for one in found], noisy


def _late(evidence: Evidence, delay: float) -> Evidence:
    """The evidence, with its force as it is shown `delay` [s] later."""

    def shown(run: Run) -> np.ndarray:
        true = run.record.needed("force", "a diagnosis")
        return np.stack([run.record.shifted(one, -delay) for one in true.T], axis=1)

    return _with_force(evidence, shown)


def _gain(whitener: Whitener, base: Base, columns: np.ndarray) -> float:
    """2 dlogL of a single column (n, c, 1) beside the base."""
    rest = beside(base.basis, whitener(columns))
    power = float((rest**2).sum())
    return float(((rest.T @ base.residual) ** 2).sum()) / power if power > 0.0 else 0.0


def visible(
    projection: Projection, evidence: Evidence, whitener: Whitener
) -> tuple[np.ndarray, dict[Candidate, str]]:
    """Return whether each candidate can be tested, and the reasons against others."""
    itself = _force_itself(projection, evidence, whitener)
    itself |= _made_of_the_residual(projection, evidence, whitener, itself)
    candidates = [shaped.candidate for shaped in projection.candidates]
    reasons = {f: "its column is the measured force itself" for f in candidates if f in itself}
    reasons |= _usual(projection)
    shows = projection.visibility >= [_least(candidate) for candidate in candidates]
    wanted = shows & np.array([one not in reasons for one in candidates], dtype=bool)
    best: dict[Candidate, float] = {}
    for candidate, share in zip(candidates, projection.visibility, strict=True):
        best[candidate] = max(best.get(candidate, 0.0), float(share))
    for candidate, share in best.items():
        if share < _least(candidate):
            reasons[candidate] = (
                "these recordings do not show all of its parameters"
                if candidate.changes
                else f"{share:.1%} of its column is visible, {VISIBLE_SHARE:.0%} needed"
            )
    return wanted, reasons


def _usual(projection: Projection) -> dict[Candidate, str]:
    """Candidates whose parameters are those of any sound machine, unless one is larger."""
    found = {}
    for shaped, own in zip(projection.candidates, projection.columns_of, strict=True):
        effect = shaped.candidate.effect
        limit = effect.usual if effect.formless else 0.0
        if not limit or shaped.candidate.shapes or shaped.candidate.changes:
            continue
        values = np.abs(projection.score[own]) / np.maximum(projection.scale[own], TINY)
        if (values > limit).any():
            return {}
        found[shaped.candidate] = (
            f"{values.max():.2%}, as these recordings have it, does not exceed the usual "
            f"{limit:.1%}"
        )
    return found


def _least(candidate: Candidate) -> float:
    """The least visibility needed; of a change, which has the form of the model's own term, any."""
    return SINGULAR_SHARE if candidate.changes else VISIBLE_SHARE


def _force_itself(projection: Projection, evidence: Evidence, whitener: Whitener) -> set[Candidate]:
    """Candidates with a column that is the residual of their joint beside the model."""
    joints = evidence.model.joints
    force, base = whitener(evidence.force), whitener(evidence.base)
    first = {shaped.candidate: shaped for shaped in reversed(projection.candidates)}
    found = set()
    for j, joint in enumerate(joints):
        rows = whitener.channel % len(joints) == j
        known = leading(base[rows], base.shape[1])
        rest = beside(known, force[rows])
        for candidate, shaped in first.items():
            if candidate.joint != joint:
                continue
            columns = beside(known, whitener(shaped.columns)[rows])
            size, score = np.linalg.norm(columns, axis=0), rest @ columns
            alike = np.abs(score) / np.maximum(size * np.linalg.norm(rest), TINY)
            once = np.abs(score / np.maximum(size**2, TINY) - 1.0) < SLIGHT_SHARE
            if ((alike > FORCE_CORRELATION) | (once & (alike > 1.0 - SLIGHT_SHARE))).any():
                found.add(candidate)
    return found


def _made_of_the_residual(
    projection: Projection, evidence: Evidence, whitener: Whitener, found: set[Candidate]
) -> set[Candidate]:
    """Candidates that follow the force and, beside the model, its unpredicted part."""
    wanted = {
        shaped.candidate: shaped
        for shaped in projection.candidates
        if "force" in shaped.candidate.effect.follows
        and not (shaped.candidate.shapes or shaped.candidate.changes)
        and shaped.candidate not in found
    }
    if not wanted:
        return set()
    predicted = with_predicted_force(evidence)
    known = whitener(evidence.base)
    known = leading(known, known.shape[1])
    more = set()
    for candidate, shaped in wanted.items():
        own, other = (
            beside(known, whitener(columns))
            for columns in (shaped.columns, predicted.columns(shaped.term))
        )
        alike = np.einsum("nk,nk->k", own, other) / np.maximum(
            np.linalg.norm(own, axis=0) * np.linalg.norm(other, axis=0), TINY
        )
        if (1.0 - alike**2 > LITTLE_SHARE).any():
            more.add(candidate)
    return more


class LeftOut(NamedTuple):
    """Friction in rows that are left out: `hidden` (tried,) shapes, why a `whole` candidate is
    hidden, and the least share of its energy that is `seen`.
    """

    hidden: np.ndarray
    whole: dict[Candidate, str]
    seen: dict[Candidate, float]


def left_out(tried: Sequence[ShapedCandidate]) -> LeftOut:
    """Compare what used rows show of each candidate, at each shape, with what is needed."""
    hidden, shares = [], dict[Candidate, list[float]]()
    for one in tried:
        rubs = one.term.is_friction()
        hidden.append(rubs and one.seen < LITTLE_SHARE)
        if rubs:
            shares.setdefault(one.candidate, []).append(one.seen)
    whole = {
        candidate: "its peak lies in the rows that are left out around reversals; those that are "
        f"used see {max(own):.1%} of it, {LITTLE_SHARE:.0%} needed"
        for candidate, own in shares.items()
        if max(own) < LITTLE_SHARE
    }
    seen = {candidate: min(own) ** 2 for candidate, own in shares.items()}
    return LeftOut(np.array(hidden), whole, seen)
