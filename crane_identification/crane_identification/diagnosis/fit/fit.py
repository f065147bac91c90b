"""The fit that a diagnosis starts from: the model to recordings, as far as they determine it."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import ceil

import numpy as np

from crane_identification.data.log import Log
from crane_identification.diagnosis.fit.evidence import Evidence, gather, normed
from crane_identification.diagnosis.fit.refit import UndeterminedError, refit, refit_anyway
from crane_identification.estimation.regression import common_factor
from crane_identification.options import Options
from crane_identification.preparation.periodicity import periodic_part
from crane_identification.preparation.prepare import Session, chronological, prepare, prepare_all
from crane_identification.preparation.run import Preparation
from crane_identification.signals.decimate import KEPT_SHARE
from crane_model.errors import ConfigurationError, DataError
from crane_model.model_file import Model
from crane_model.progress_bar import Progress, silent
from crane_model.terms import Term

ENOUGH_ROWS = 60
"""Rows of the joint that moves most. No score exceeds the number of rows, whatever is missing."""
ROWS_PER_PARAMETER = 3  # of the model, which leaves nothing to look into of fewer


@dataclass(frozen=True)
class Training:
    """What models are fitted to: recordings, the `factor` of their rows, and their names."""

    recordings: Sequence[Preparation]
    factor: int
    sources: str


@dataclass(frozen=True)
class Fitted:
    """The model `before` anything is added, and the evidence of the recordings about it.

    Terms all of whose parameters are `undetermined` are `left_out` of it. With `fixed`, its values
    were kept. `periods`: held-out recordings averaged, whose scatter is the noise. `session` says
    whether time runs through all recordings; `uncalibrated` quantities are in counts; `warnings`
    are about the recordings.
    """

    before: Model
    left_out: tuple[Term, ...]
    undetermined: tuple[str, ...]
    training: Training
    evidence: Evidence
    held_out: Evidence
    fixed: bool
    periods: tuple[Preparation, ...]
    session: Session
    uncalibrated: tuple[str, ...]
    warnings: tuple[str, ...]


def fitted(
    model: Model,
    training: Sequence[Log],
    validation: Sequence[Log],
    options: Options,
    fixed: bool = False,
    progress: Progress = silent,
) -> Fitted:
    """The model fitted to the training recordings; with `fixed`, its values are kept.

    `DataError` if recordings cannot be used or do not determine the parameters of the model;
    `ConfigurationError` if values to keep are missing.
    """
    if fixed:
        check_values(model)
    model = model.of_machine()  # what these recordings carry is asked anew
    logs = chronological((*training, *validation))
    session = Session.of(logs)
    prepared = prepare_all(model, logs, replace(options, average=False), progress, session)
    sources = {log.source for log in training}
    train = [p for p in prepared if p.source in sources]
    hold = [p for p in prepared if p.source not in sources]
    given = Training(
        train, decimation(model, train, options.decimation), ", ".join(sorted(sources))
    )
    evidence, before, left_out, held = (
        (kept(model, train, given.factor), model, (), ())
        if fixed
        else determined(model, train, given.factor, given.sources)
    )
    absent = (p.name for term in left_out for p in term.parameters(model.setting))
    periods, not_periodic = _averaged(model, validation, options) if options.average else ((), [])
    return Fitted(
        before=before,
        left_out=left_out,
        undetermined=(*absent, *held),
        training=given,
        evidence=evidence,
        held_out=gather(before, hold, given.factor, first_run=len(train)),
        fixed=fixed,
        periods=periods,
        session=session,
        uncalibrated=tuple(dict.fromkeys(name for log in logs for name in log.uncalibrated)),
        warnings=(*(one for log in logs for one in log.warnings), *not_periodic),
    )


def _averaged(
    model: Model, logs: Sequence[Log], options: Options
) -> tuple[tuple[Preparation, ...], list[str]]:
    """The validation recordings averaged, those that are periodic; their scatter is the noise.

    Beside them, which of them do not have the period that was given.
    """
    out: list[Preparation] = []
    wrong = []
    for log in logs:
        try:
            part = periodic_part(log, options.period)
        except DataError as error:
            if options.period is not None:
                wrong.append(f"{error}. Its noise floor is not known.")
            continue  # not periodic: no scatter
        try:
            out += prepare(model, log, replace(options, average=True), part=part)
        except DataError:
            continue  # no whole period without a gap
    return tuple(out), wrong


def decimation(model: Model, training: Sequence[Preparation], given: int | None) -> int:
    """The factor of the rows: the `given` one, or that of the motion.

    Of short recordings more rows are kept, up to the whole bandwidth of the motion. Their noise is
    no longer independent, which whitening takes care of.
    """
    factor = common_factor(training, given)
    if given is not None:
        return factor
    samples = int(sum(one.moving.sum(axis=0) for one in training).max())
    enough = max(ENOUGH_ROWS, ROWS_PER_PARAMETER * len(model.parameters))
    return max(min(factor, samples // enough), ceil(KEPT_SHARE * factor))


def determined(
    model: Model, training: Sequence[Preparation], factor: int, sources: str
) -> tuple[Evidence, Model, tuple[Term, ...], tuple[str, ...]]:
    """The evidence, the model with values, the terms that had to be left out for them, and further
    parameters that are not determined.

    Friction at a single speed is Coulomb or viscous: the recordings show their sum, which one of
    them carries as well. Where no term is the cause, as of the bodies of an arm that moved along
    few ways, what is determined of their combinations is kept.
    """
    left_out: tuple[Term, ...] = ()
    while True:
        evidence = gather(model, training, factor)
        try:
            return evidence, refit(evidence, sources), left_out, ()
        except UndeterminedError as error:
            term = _dispensable(evidence, error)
            if term is None:
                before, held = refit_anyway(evidence, sources)
                return evidence, before, left_out, held
            model, left_out = model.without_term(term), (*left_out, term)


def _dispensable(evidence: Evidence, error: UndeterminedError) -> Term | None:
    """Of the terms that are not determined, the one without which least is left unexplained."""
    model, costs = evidence.model, dict[Term, float]()
    for term in model.terms:
        names = {p.name for p in term.parameters(model.setting)}
        if names <= set(error.names) and len(model.terms) > 1:
            costs[term] = _left(evidence, model.part(term))
    return min(costs, key=lambda term: costs[term]) if costs else None


def _left(evidence: Evidence, without: slice) -> float:
    """Energy of the force beside the model without some of its columns, each joint in its unit."""
    weight = np.where(evidence.force_rms > 0.0, evidence.force_rms, 1.0)
    columns = np.delete(evidence.base, without, axis=2)[evidence.used]
    scaling = np.broadcast_to(1.0 / weight, evidence.force.shape)[evidence.used]
    matrix, force = columns * scaling[:, None], evidence.force[evidence.used] * scaling
    matrix, _ = normed(matrix)
    return float(((force - matrix @ np.linalg.lstsq(matrix, force, rcond=1e-9)[0]) ** 2).sum())


def check_values(model: Model) -> None:
    """`ConfigurationError` if the model has no values to keep."""
    if model.values is None or model.std_devs is None:
        raise ConfigurationError(
            f"model '{model.name}' has no values that could have changed; fit it with identify to "
            "recordings from before, or leave out --fixed"
        )


def kept(model: Model, training: Sequence[Preparation], factor: int) -> Evidence:
    """The evidence about a model whose values are kept."""
    return replace(gather(model, training, factor), std_devs=model.std_devs)
