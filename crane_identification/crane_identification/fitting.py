"""From logs to a fitted model, and from a fitted model and other logs to its validation."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from crane_identification.data.log import Log
from crane_identification.estimation.autoregression import LackOfFit, lack_of_fit
from crane_identification.estimation.consistent import consistent, physics
from crane_identification.estimation.excitation import (
    at_one_speed,
    too_little,
    undetermined_in_words,
)
from crane_identification.estimation.least_squares import (
    instrumental,
    least_squares,
    robust,
    weighted,
)
from crane_identification.estimation.prior import Measure, Prior
from crane_identification.estimation.prior_check import PriorConflict, check_prior
from crane_identification.estimation.regression import (
    Estimate,
    Rows,
    build_rows,
    common_factor,
    instruments,
    products_of,
)
from crane_identification.options import Estimator, Options
from crane_identification.preparation.prepare import Session, prepare_all, prepare_moving
from crane_identification.preparation.run import Preparation
from crane_identification.validation.force_validation import Validation, compare
from crane_model.errors import ConfigurationError, DataError
from crane_model.model_file import Model
from crane_model.progress_bar import Progress, silent


@dataclass(frozen=True)
class FitResult:
    """A fitted model and the data behind it.

    Parameters
    ----------
    model : Model
        The model with its values.
    estimate : Estimate
        Values, standard deviations and residuals.
    rows : Rows
        The equations that were solved.
    preparations : tuple of Preparation
        The prepared recordings.
    decimation : int
        Factor of the parallel filter.
    lack_of_fit : LackOfFit
        Test whether the residual is more than noise, per joint.
    prior : Prior, optional
        Prior that was used.
    standing : tuple of str
        Recordings that were not used: no joint of the model moves in them.
    conflict : PriorConflict, optional
        Entries of the prior that the recordings contradict.
    """

    model: Model
    estimate: Estimate
    rows: Rows
    preparations: tuple[Preparation, ...]
    decimation: int
    lack_of_fit: LackOfFit
    prior: Prior | None = None
    standing: tuple[str, ...] = ()
    conflict: PriorConflict | None = None


def fit(
    model: Model,
    logs: Sequence[Log],
    options: Options | None = None,
    progress: Progress = silent,
    session: Session | None = None,
    prior: Prior | None = None,
) -> FitResult:
    """Fit the parameters of a model to recordings.

    Parameters
    ----------
    model : Model
        Model with p parameters; its values are not used.
    logs : sequence of Log
        Recordings, which are fitted together.
    options : Options, optional
        Estimator and processing; None: the defaults.
    progress : Progress
        Receiver of the progress.
    session : Session, optional
        Session through which time counts; None: that of `logs`.
    prior : Prior, optional
        Gaussian or log-det prior, for least squares, consistent or not.

    Returns
    -------
    FitResult
        The fitted model, with estimates (p,) in SI units.

    Raises
    ------
    DataError
        If a recording does not fit the model or is too short, or parameters are not determined.
    ConfigurationError
        If the estimator does not take the prior.

    Examples
    --------
    An axis of 3 kg on a damper of 2 N s/m:

    >>> from crane_identification import Log, Signal
    >>> from crane_model.terms.friction import Viscous
    >>> from crane_model.terms.single_axis import Inertia
    >>> from crane_model.terms.term import Setting
    >>> terms = Inertia(joint="axis"), Viscous(joint="axis")
    >>> model = Model("axis", Setting({"axis": "m"}, None), terms)
    >>> time = np.linspace(0.0, 20.0, 2001)
    >>> place = Signal(time, np.sin(time)[:, np.newaxis], "made")
    >>> push = 2.0 * np.cos(time) - 3.0 * np.sin(time)
    >>> force = Signal(time, push[:, np.newaxis], "made")
    >>> log = Log("made", ("axis",), 0, place, force=force)
    >>> found = fit(model, [log])
    >>> found.estimate.values.round(2)
    array([3., 2.])
    >>> (held_out,) = validate(found.model, [log])
    >>> bool(held_out.relative_error < 0.01)
    True
    """
    options = options or Options()
    preparations, standing = prepare_moving(model, logs, options, progress, session)
    factor = common_factor(preparations, options.decimation)
    rows = Rows.stack([build_rows(model, p, factor) for p in preparations])
    estimate = _estimate(model, rows, preparations, factor, options, prior)
    progress("fit", 1.0)
    if unknown := _undetermined(model, rows, estimate, prior):
        raise DataError(
            undetermined_in_words(
                model, unknown, lambda names: too_little(model, rows, preparations, names)
            )
        )
    sources = ", ".join(dict.fromkeys(p.source for p in preparations))
    provenance = f"{estimate.method}, {estimate.samples} rows of {sources}"
    fitted = model.with_estimate(estimate.values, estimate.std_devs, provenance)
    left = lack_of_fit(rows, estimate.values)
    conflict = check_prior(rows, prior, options.covariance) if prior else None
    return FitResult(
        fitted, estimate, rows, tuple(preparations), factor, left, prior, standing, conflict
    )


def _undetermined(
    model: Model, rows: Rows, estimate: Estimate, prior: Prior | None
) -> tuple[str, ...]:
    """Names of the parameters that neither recordings nor prior determine, in their order."""
    names = set(estimate.undetermined)
    for pair in at_one_speed(model, products_of(rows)).values():
        known = [prior is not None and prior.matrix[:, rows.names.index(n)].any() for n in pair]
        if not any(known):
            names.update(pair)
    return tuple(name for name in rows.names if name in names)


def _estimate(
    model: Model,
    rows: Rows,
    preparations: Sequence[Preparation],
    factor: int,
    options: Options,
    prior: Prior | None,
) -> Estimate:
    if prior and options.estimator not in (Estimator.LEAST_SQUARES, Estimator.CONSISTENT):
        raise ConfigurationError(
            f"estimator {options.estimator}: takes no prior; choose {Estimator.CONSISTENT} or "
            f"{Estimator.LEAST_SQUARES}"
        )
    if prior and prior.bodies is not None and options.estimator is not Estimator.CONSISTENT:
        raise ConfigurationError(
            f"estimator {options.estimator}: takes no prior by the log-det divergence; choose "
            f"{Estimator.CONSISTENT}, or measure: {Measure.GAUSSIAN} in the prior's file"
        )
    match options.estimator:
        case Estimator.LEAST_SQUARES:
            return least_squares(rows, options.covariance, prior=prior)
        case Estimator.WEIGHTED:
            return weighted(rows, options.covariance)
        case Estimator.ROBUST:
            return robust(rows, options.covariance)
        case Estimator.INSTRUMENTAL:
            along = np.concatenate([instruments(model, p, factor) for p in preparations])
            return instrumental(rows, along, options.covariance)
        case Estimator.CONSISTENT:
            return consistent(rows, physics(model), options.covariance, prior)


def validate(
    model: Model,
    logs: Sequence[Log],
    options: Options | None = None,
    progress: Progress = silent,
    session: Session | None = None,
) -> tuple[Validation, ...]:
    """Compare the forces that a fitted model predicts with those of recordings.

    Parameters
    ----------
    model : Model
        Model with values.
    logs : sequence of Log
        Recordings that the fit has not seen.
    options, progress, session
        As in `fit`.

    Returns
    -------
    tuple of Validation
        One for each gapless run of the recordings.

    Raises
    ------
    DataError
        If a recording does not fit the model or is too short.
    ConfigurationError
        If the model has no values.
    """
    options = options or Options()
    preparations = prepare_all(model, logs, options, progress, session)
    factor = common_factor(preparations, options.decimation)
    return tuple(compare(model, preparation, factor) for preparation in preparations)
