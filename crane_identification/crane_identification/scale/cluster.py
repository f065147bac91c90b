"""Least squares over more recordings than one machine holds, on a Dask cluster.

Every recording is read, prepared and turned into rows by one worker and stays there; only its
information matrix travels, and for the second round of `summed` what it tells of the covariance.
"""

import re
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from distributed import Client, as_completed

from crane_identification.data.column_map import ColumnMap
from crane_identification.data.log import Log
from crane_identification.estimation.least_squares import meat
from crane_identification.estimation.regression import common_factor
from crane_identification.options import Options
from crane_identification.preparation.prepare import prepare
from crane_identification.preparation.run import Preparation
from crane_identification.recording_check.check import vetted
from crane_identification.scale.summed import FirstRound, Information, SummedFit, read, rows_of
from crane_model.errors import ConfigurationError
from crane_model.model_file import Model
from crane_model.progress_bar import Progress, silent

ANSWER = 30.0  # s for the scheduler to answer
ADDRESS = re.compile(r"(tcp|tls|ws|wss)://([^\s:/\[\]]+|\[[0-9a-fA-F:.]+\]):[0-9]{1,5}")


@contextmanager
def connected(address: str) -> Iterator[Client]:
    """A client of the cluster whose scheduler is at tcp://host:port.

    Raises `ConfigurationError` if that is no address, no scheduler answers or it has no workers.
    """
    if not ADDRESS.fullmatch(address):
        raise ConfigurationError(
            f"no address of a Dask scheduler: {address}; write tcp://HOST:PORT, or tls://, ws:// "
            "or wss:// where the scheduler listens so"
        )
    try:
        client = Client(address, timeout=ANSWER, set_as_default=False)
    except OSError as error:
        raise ConfigurationError(
            f"no Dask scheduler answers at {address} within {ANSWER:g} s ({error}); start one with "
            "`dask scheduler`, and workers with `dask worker ADDRESS` where the bags can be read"
        ) from None
    with client:
        if not client.scheduler_info()["workers"]:
            raise ConfigurationError(
                f"the Dask scheduler at {address} has no workers; start some with `dask worker "
                f"{address}`"
            )
        yield client


def fit_on_cluster(
    model: Model,
    recordings: Sequence[Path],
    address: str,
    options: Options | None = None,
    progress: Progress = silent,
    columns: ColumnMap | None = None,
    trusted: bool = False,
) -> SummedFit:
    """Θ of `model` by least squares (31) from recordings that the workers of a Dask cluster can
    read, by `columns` or as bags of the suite.

    `address` is that of the scheduler. Raises `ConfigurationError` as `connected` does, `DataError`
    as `fitting.fit` does, and where a recording that is not `trusted` looks wrong.
    """
    options = options or Options()
    with connected(address) as client:
        workers = len(client.scheduler_info()["workers"])
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
) -> SummedFit:
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
    logs = on_workers(read, paths, models, [columns] * len(paths), choices)
    checks = on_workers(_vetted, logs, models, [trusted] * len(paths))
    suspicions = results(checks, "checking on the cluster")
    prepared = on_workers(_prepared, logs, models, choices)
    del logs, checks  # the workers need them no longer
    factors = results(on_workers(_factor, prepared), "reading on the cluster")
    factor = min(factors) if options.decimation is None else options.decimation
    rows = on_workers(rows_of, prepared, models, [factor] * len(paths))
    total = FirstRound.of(model, results(on_workers(Information.of, rows), "information"))
    noise = (
        [total.weights] * len(paths),
        [total.solution.values] * len(paths),
        [options.covariance] * len(paths),
    )
    spread = sum(results(on_workers(meat, rows, *noise), "uncertainty"))
    told = tuple(part for of in suspicions for part in of)
    return SummedFit(total.fitted(model, spread), total.information, told, workers)


def _vetted(log: Log, model: Model, trusted: bool) -> tuple[str, ...]:
    return vetted(model.machine, [log], trusted, model)


def _prepared(log: Log, model: Model, options: Options) -> list[Preparation]:
    return prepare(model, log, options)


def _factor(preparations: list[Preparation]) -> int:
    return common_factor(preparations)
