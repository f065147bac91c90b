"""The fit that a diagnosis starts from: the model to recordings, as far as they determine it."""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from math import ceil

import numpy as np

from crane_identification.data.log import Log
from crane_identification.diagnosis.constants import FEWEST_ROWS, ROWS_PER_PARAMETER, VISIBLE_SHARE
from crane_identification.diagnosis.evidence import (
    Evidence,
    Zone,
    beside,
    gather,
    leading,
    least_squares,
    says_nothing,
)
from crane_identification.estimation.consistent import consistent, physics
from crane_identification.estimation.least_squares import UNSEEN_FORCE_SHARE
from crane_identification.estimation.prior import Prior
from crane_identification.estimation.regression import (
    Rows,
    balancing,
    common_factor,
    solve_weighted,
)
from crane_identification.options import Options
from crane_identification.preparation.periodicity import periodic_part
from crane_identification.preparation.prepare import Session, chronological, prepare, prepare_all
from crane_identification.preparation.run import Preparation
from crane_identification.signals.decimate import KEPT_SHARE
from crane_model.errors import ConfigurationError, DataError
from crane_model.model_file import Model
from crane_model.progress_bar import Progress, silent
from crane_model.terms import Term

# Joint estimate of a model on evidence, and of shape parameters the uncertainty beside it.
#
# A parameter counts as not determined where its column is, or nearly is, a combination of others,
# or where what is left of the force hides it. The latter holds only of a column that others follow:
# what is left may be what the model lacks, beside which a parameter of its own seems uncertain.


class UndeterminedError(DataError):
    """The recordings show only combinations of the parameters `names` of a model."""

    def __init__(self, model: Model, names: tuple[str, ...]) -> None:
        self.names = names
        super().__init__(
            f"model '{model.name}': {', '.join(names)}: these recordings show only "
            "combinations of these parameters; excite the joints more or take terms out"
        )


def refit(evidence: Evidence, sources: str, held: tuple[str, ...] = ()) -> Model:
    """The model of the evidence with values and standard deviations, all estimated together.
    Parameters that are `held` are 0 as far as the recordings do not tell them from the others.
    `UndeterminedError` if others are not determined.
    """
    model, rows = evidence.model, _rows(evidence)
    prior = _no_more_than_measured(rows, held) if held else None
    # Bodies in space would be fitted to what an incomplete model lacks, up to where they can exist.
    estimate = consistent(rows, physics(model, bodies_in_space=False), prior=prior)
    if estimate.undetermined:
        if lost := _alike(rows, estimate.undetermined):
            raise UndeterminedError(model, (*held, *lost))
        return refit(evidence, sources, (*held, *estimate.undetermined))
    provenance = f"diagnose: {estimate.method}, {estimate.samples} rows of {sources}"
    return model.with_estimate(estimate.values, estimate.std_devs, provenance)


def refit_anyway(evidence: Evidence, sources: str) -> tuple[Model, tuple[str, ...]]:
    """The refitted model, and the names of parameters that are held as not determined."""
    held: tuple[str, ...] = ()
    while True:
        try:
            return refit(evidence, sources, held), held
        except UndeterminedError as error:
            held = error.names


def _no_more_than_measured(rows: Rows, names: tuple[str, ...]) -> Prior:
    """Prior by which none of these parameters makes more force alone than was measured."""
    force, unit, widths = rows.rms(rows.force), np.eye(len(rows.names)), []
    chosen = [rows.names.index(name) for name in names]
    for k in chosen:
        column = rows.rms(rows.matrix[:, :, k])
        seen = (column > 0.0) & (force > 0.0)
        widths.append(UNSEEN_FORCE_SHARE * float((force[seen] / column[seen]).min(initial=np.inf)))
    known = np.where(np.isfinite(widths), widths, 1.0)  # what makes no force may be anything
    return Prior(unit[chosen] / known[:, np.newaxis], np.zeros(len(chosen)))


def _alike(rows: Rows, names: tuple[str, ...]) -> tuple[str, ...]:
    """The parameters whose columns are nearly combinations of others."""
    weights = np.broadcast_to(balancing(rows), rows.force.shape)
    found = solve_weighted(rows, weights)
    norms = np.linalg.norm(rows.stacked * weights[rows.used][:, None], axis=0)
    spread = np.sqrt(np.diag(found.bread)) * norms
    share = np.divide(1.0, spread, out=np.zeros_like(spread), where=found.determined)
    return tuple(name for name in names if share[rows.names.index(name)] < VISIBLE_SHARE)


def _rows(evidence: Evidence) -> Rows:
    """The rows that count, without what the nuisance columns explain."""
    parameters = evidence.model.parameters
    p, counted = len(parameters), evidence.used.copy()
    matrix, force = evidence.base[:, :, :p].copy(), evidence.force.copy()
    for c, used in enumerate(evidence.used.T):
        counted[:, c] &= not says_nothing(used, leading(evidence.base[used, c], len(used)))
        nuisance = evidence.base[used, c, p:]
        if nuisance.any():
            known = leading(nuisance, nuisance.shape[1])
            matrix[used, c] = beside(known, matrix[used, c])
            force[used, c] = beside(known, force[used, c])
    return Rows(
        joints=tuple(f"{joint}, {zone.value}" for zone in Zone for joint in evidence.joints),
        names=tuple(one.name for one in parameters),
        units=tuple(one.unit for one in parameters),
        time=evidence.time,
        run=evidence.run,
        matrix=matrix,
        force=force,
        used=counted,
    )


@dataclass(frozen=True)
class Training:
    """Recordings that models are fitted to, the `factor` of their rows, and their names."""

    recordings: Sequence[Preparation]
    factor: int
    sources: str


@dataclass(frozen=True)
class Fitted:
    """The model `before` anything is added, and the evidence of the recordings about it. Terms all
    of whose parameters are `undetermined` are `left_out` of it. `periods`: held-out recordings
    averaged, whose scatter is the noise; `uncalibrated` quantities are in counts.
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
    """The model fitted to the training recordings; with `fixed`, its values are kept. `DataError`
    if recordings cannot be used or do not determine the parameters; `ConfigurationError` if values
    to keep are missing.
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
    uncalibrated = tuple(dict.fromkeys(name for log in logs for name in log.uncalibrated))
    absent = (p.name for term in left_out for p in term.parameters(model.setting))
    periods, not_periodic = _averaged(model, validation, options) if options.average else ((), [])
    return Fitted(
        before=before,
        left_out=left_out,
        undetermined=(*absent, *held),
        training=given,
        evidence=replace(evidence, counts=bool(uncalibrated)),
        held_out=gather(before, hold, given.factor, first_run=len(train)),
        fixed=fixed,
        periods=periods,
        session=session,
        uncalibrated=uncalibrated,
        warnings=(*(one for log in logs for one in log.warnings), *not_periodic),
    )


def _averaged(
    model: Model, logs: Sequence[Log], options: Options
) -> tuple[tuple[Preparation, ...], list[str]]:
    """Periodic validation recordings averaged, and those that lack the given period."""
    found: list[Preparation] = []
    told = []
    for log in logs:
        try:
            part = periodic_part(log, options.period)
        except DataError as error:  # not periodic: no scatter
            if options.period is not None:
                told.append(f"{error}. Its noise floor is not known.")
            continue
        with suppress(DataError):  # no whole period without a gap
            found += prepare(model, log, replace(options, average=True), part=part)
    return tuple(run for run in found if run.periodic), told


def decimation(model: Model, training: Sequence[Preparation], given: int | None) -> int:
    """The `given` factor of the rows, or that of the motion; short recordings keep more rows."""
    factor = common_factor(training, given)
    if given is not None:
        return factor
    samples = int(sum(one.moving.sum(axis=0) for one in training).max())
    enough = max(FEWEST_ROWS, ROWS_PER_PARAMETER * len(model.parameters))
    return max(min(factor, samples // enough), ceil(KEPT_SHARE * factor))


def determined(
    model: Model, training: Sequence[Preparation], factor: int, sources: str
) -> tuple[Evidence, Model, tuple[Term, ...], tuple[str, ...]]:
    """The evidence, the model with values, the terms that had to be left out for them, and further
    parameters that are not determined.

    Friction at a single speed is Coulomb or viscous: one of them carries the sum.
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
    """The term that is not determined and whose absence leaves least unexplained."""
    model, costs = evidence.model, dict[Term, float]()
    weight = np.where(evidence.force_rms > 0.0, evidence.force_rms, 1.0)
    scaling = np.broadcast_to(1.0 / weight, evidence.force.shape)[evidence.used]
    force = evidence.force[evidence.used] * scaling  # each joint in its unit
    for term in model.terms:
        names = {p.name for p in term.parameters(model.setting)}
        if names <= set(error.names) and len(model.terms) > 1:
            columns = np.delete(evidence.base, model.part(term), axis=2)[evidence.used]
            matrix = columns * scaling[:, None]
            costs[term] = float(((force - matrix @ least_squares(matrix, force)) ** 2).sum())
    return min(costs, key=lambda term: costs[term]) if costs else None


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
