"""What follows the measured force, which holds whatever is sought.

Where it pulls one way, a shape over it that differs between the directions of motion can be the
force less a constant: it explains all of it, noise included, of any machine.
"""

from dataclasses import replace

import numpy as np

from crane_identification.diagnosis.fit.evidence import Evidence, beside, leading
from crane_model.terms import Term

OWN_SHARE = 0.5
"""Share of the energy of a force which nothing explains, above which a shape that explains it is
made of it. Chosen on four machines of the benchmark; over loads of one sign nearly all of it is
explained, but over those of many telescopes more than half, so that no shape is drawn there either.
"""


def with_predicted_force(evidence: Evidence) -> Evidence:
    """The evidence with the force that the model predicts in place of the measured one."""
    runs = []
    for run in evidence.runs:
        force = evidence.model.regressor(run.record) @ evidence.values
        runs.append(replace(run, record=replace(run.record, force=force)))
    return replace(evidence, runs=tuple(runs))


def is_the_force_itself(evidence: Evidence, term: Term, joint: str) -> bool:
    """Whether a term on a joint explains a force that no load makes: what the model leaves there,
    turned round in time within each run, once it is part of the measured force.
    """
    j = evidence.joints.index(joint)
    runs, rows = [], []
    for run, predicted in zip(evidence.runs, with_predicted_force(evidence).runs, strict=True):
        measured, force = (
            one.record.needed("force", "a diagnosis").copy() for one in (run, predicted)
        )
        force[:, j] += (measured - force)[::-1, j]
        runs.append(replace(run, record=replace(run.record, force=force)))
        rows.append(run.filtered(force[..., np.newaxis])[:, j, 0])
    made = replace(evidence, runs=tuple(runs))
    used, known = evidence.used[:, j], evidence.base[:, j]
    known = leading(known[used], known.shape[1])
    rest = beside(known, np.concatenate(rows)[used])
    columns = beside(known, made.columns(term)[used, j])
    alone = leading(columns, columns.shape[1])
    return bool(((alone.T @ rest) ** 2).sum() > OWN_SHARE * (rest @ rest))
