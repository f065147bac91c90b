"""Friction that shows around reversals, where the sign of a velocity is unknown and no row used.

Breakaway is over once a joint has slid some tenths of a millimetre. If it has not been moving by
then for as long as the estimate of its velocity needs, no row of the evidence has seen it.
"""

from collections.abc import Sequence

import numpy as np

from crane_identification.diagnosis.candidates import Family, Option
from crane_identification.diagnosis.evidence import Evidence
from crane_model.terms import Term

SEEN_SHARE = 0.1
"""Share of the norm of a column within the used rows, below which it is not sought there: ten times
as much friction would have to be where none is seen."""


def left_out(
    evidence: Evidence, options: Sequence[Option]
) -> tuple[np.ndarray, dict[Family, str], dict[Family, str]]:
    """Which options (options,) lie in rows that are left out; families of which all and some do.

    Families come with the reason.
    """
    share = np.array(
        [seen(evidence, one.term) if one.term.is_friction() else 1.0 for one in options]
    )
    hidden = share < SEEN_SHARE
    whole: dict[Family, str] = {}
    part: dict[Family, str] = {}
    for family in dict.fromkeys(
        one.family for one, out in zip(options, hidden, strict=True) if out
    ):
        own = np.array([one.family == family for one in options])
        lost = own & hidden
        reason = (
            "its peak lies in the rows that are left out around reversals; those that are used see "
            f"{share[lost].max():.1%} of it, {SEEN_SHARE:.0%} needed"
        )
        if lost.sum() == own.sum():
            whole[family] = reason
        else:
            shapes = [one.shape for one, out in zip(options, lost, strict=True) if out]
            coordinate = evidence.model.setting.units.get(family.where, "rad")
            part[family] = f"{_where(family, shapes, coordinate)}, {reason}"
    return hidden, whole, part


def seen(evidence: Evidence, term: Term) -> float:
    """Share of the norm of the columns of a term, wherever it acts, that is in used samples."""
    inside = total = 0.0
    for run in evidence.runs:
        energy = (term.columns(run.record, evidence.model.setting) ** 2).sum(axis=2)
        used = (run.gate.reshape(len(energy), -1, energy.shape[1]) > 0.0).any(axis=1)
        inside, total = inside + float((energy * used).sum()), total + float(energy.sum())
    return float(np.sqrt(inside / total)) if total > 0.0 else 1.0


def _where(family: Family, hidden: Sequence[dict[str, float]], coordinate: str) -> str:
    """The shapes that are hidden, by the parameters whose other values are sought."""
    parts = []
    for name, shape in family.term.shapes.items():
        every, some = (sorted({one[name] for one in shapes}) for shapes in (family.grid(), hidden))
        unit = shape.unit_on(coordinate)
        if some[-1] < every[-1]:
            parts.append(f"{name} below {next(x for x in every if x > some[-1]):.2g} {unit}")
        elif some[0] > every[0]:
            parts.append(f"{name} above {max(x for x in every if x < some[0]):.2g} {unit}")
    return f"with {' and '.join(parts)}" if parts else "with some shapes"
