"""Least squares over more recordings than one machine holds, on a Dask cluster.

Every recording is read, prepared and turned into rows by one worker and stays there; only its
information matrix travels, and their sum gives the same Θ as all rows in one place. A second round
over the rows gives the covariance: there the noise of each recording is judged by itself, so that
the standard deviations are close to, and not the same as, those of all rows in one place.
"""

import re
from collections.abc import Callable, Sequence
from functools import reduce
from operator import add
from pathlib import Path
from typing import Any

import numpy as np
from distributed import Client, as_completed

from crane_identification.data.bad_samples import usable
from crane_identification.data.column_map import ColumnMap
from crane_identification.data.log import Log
from crane_identification.data.recording_log import read_recording
from crane_identification.estimation.covariance import correlated, white
from crane_identification.estimation.lack_of_fit import lack_of_fit
from crane_identification.estimation.regression import build_rows, common_factor
from crane_identification.estimation.rows import Rows
from crane_identification.options import Covariance, Options
from crane_identification.preparation.prepare import prepare
from crane_identification.preparation.run import Preparation
from crane_identification.recording_check.check import vetted
from crane_identification.scale.information import ClusterFit, Information
from crane_model.errors import ConfigurationError, DataError
from crane_model.model_file import Model
from crane_model.progress import Progress, silent

ANSWER = 30.0  # s for the scheduler to answer
ADDRESS = re.compile(r"(tcp|tls|ws|wss)://([^\s:/\[\]]+|\[[0-9a-fA-F:.]+\]):[0-9]{1,5}")


def fit_on_cluster(
    model: Model,
    recordings: Sequence[Path],
    address: str,
    options: Options | None = None,
    progress: Progress = silent,
    columns: ColumnMap | None = None,
    trusted: bool = False,
) -> ClusterFit:
    """Θ of `model` by least squares (31) from recordings that the workers of a Dask cluster can
    read, by `columns` or as bags of the suite.

    `address` is that of the scheduler, tcp://host:port. Raises `ConfigurationError` if it is none,
    no scheduler answers or it has no workers, `DataError` as `fitting.fit` does, and where a
    recording that is not `trusted` looks wrong.
    """
    if not ADDRESS.fullmatch(address):
        raise ConfigurationError(
            f"no address of a Dask scheduler: {address}; write tcp://HOST:PORT, or tls://, ws:// "
            "or wss:// where the scheduler listens so"
        )
    options = options or Options()
    try:
        client = Client(address, timeout=ANSWER, set_as_default=False)
    except OSError as error:
        raise ConfigurationError(
            f"no Dask scheduler answers at {address} within {ANSWER:g} s ({error}); start one with "
            "`dask scheduler`, and workers with `dask worker ADDRESS` where the bags can be read"
        ) from None
    with client:
        workers = len(client.scheduler_info()["workers"])
        if not workers:
            raise ConfigurationError(
                f"the Dask scheduler at {address} has no workers; start some with `dask worker "
                f"{address}`"
            )
        return _fit(client, workers, model, recordings, columns, options, progress, trusted)


def _fit(
    client: Client,
    workers: int,
    model: Model,
    recordings: Sequence[Path],
    columns: ColumnMap | None,
    options: Options,
    progress: Progress,
    trusted: bool,
) -> ClusterFit:
    def on_workers(function: Callable[..., Any], *arguments: Sequence[Any]) -> list[Any]:
        return client.map(function, *arguments, pure=False)

    def results(futures: list[Any], phase: str) -> list[Any]:
        for done, _ in enumerate(as_completed(futures, loop=client.loop), start=1):
            progress(phase, done / len(futures))
        return client.gather(futures)

    (everywhere,) = client.scatter([model], broadcast=True)
    paths = [path.resolve() for path in recordings]
    models = [everywhere] * len(paths)
    choices = [options] * len(paths)
    logs = on_workers(_read, paths, models, [columns] * len(paths), choices)
    checks = on_workers(_vetted, logs, models, [trusted] * len(paths))
    suspicions = results(checks, "checking on the cluster")
    prepared = on_workers(_prepared, logs, models, choices)
    del logs, checks  # the workers need them no longer
    factors = results(on_workers(_factor, prepared), "reading on the cluster")
    factor = min(factors) if options.decimation is None else options.decimation
    rows = on_workers(_rows, prepared, models, [factor] * len(paths))
    information = reduce(add, results(on_workers(Information.of, rows), "information"))
    if information.rows.sum() <= len(information.names):
        raise DataError(
            f"least squares: {information.rows.sum()} rows for {len(information.names)} "
            "parameters; record longer"
        )
    weights = information.balancing()
    solution = information.solve(weights)
    if not solution.determined.all():
        unknown = np.array(information.names)[~solution.determined]
        raise DataError(
            f"model '{model.name}': {', '.join(unknown)}: these recordings show only combinations "
            "of these parameters; excite the joints more or take terms out of the model"
        )
    noise = (
        [weights] * len(paths),
        [solution.values] * len(paths),
        [options.covariance] * len(paths),
    )
    meat = sum(results(on_workers(_meat, rows, *noise), "uncertainty"))
    covariance = solution.bread @ meat @ solution.bread
    fitted = model.with_estimate(
        solution.values,
        np.sqrt(np.diag(covariance)),
        f"least squares (31) from the information of {len(paths)} recordings, "
        f"{information.rows.sum()} rows",
    )
    return ClusterFit(fitted, information, workers, tuple(one for of in suspicions for one in of))


def _read(path: Path, model: Model, columns: ColumnMap | None, options: Options) -> Log:
    log = read_recording(path, model.joints, columns, namespace=options.namespace)
    return usable(log, options.begin, options.end)


def _vetted(log: Log, model: Model, trusted: bool) -> tuple[str, ...]:
    return vetted(model.machine, [log], trusted)


def _prepared(log: Log, model: Model, options: Options) -> list[Preparation]:
    return prepare(model, log, options)


def _factor(preparations: list[Preparation]) -> int:
    return common_factor(preparations)


def _rows(preparations: list[Preparation], model: Model, factor: int) -> Rows:
    return Rows.stack([build_rows(model, one, factor) for one in preparations])


def _meat(
    rows: Rows, weights: np.ndarray, values: np.ndarray, assumption: Covariance
) -> np.ndarray:
    """Σ ΦᵀW Γ WΦ (p, p) of one recording."""
    unit = np.eye(len(values))
    spread = np.broadcast_to(weights, rows.force.shape)
    residual = spread * rows.residual(values)
    if assumption is Covariance.CORRELATED:
        return correlated(rows, spread, residual, unit, lack_of_fit(rows, values))
    columns = rows.stacked * spread[rows.used][:, None]
    return columns.T @ columns * white(residual[rows.used], unit, assumption)[0, 0]
