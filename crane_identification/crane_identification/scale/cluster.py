"""Least squares over more recordings than one machine holds, on a Dask cluster.

Every recording is read and turned into rows by a worker; only its information matrix travels, and
in the second round of `summed` what it tells of the covariance.
"""

import re
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from distributed import Client, as_completed

from crane_identification.data.column_map import ColumnMap
from crane_identification.options import Options
from crane_identification.scale.summed import SummedFit, fit_by_sums
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
    """As `fit_streamed`, from recordings that the workers of a Dask cluster can read.

    `address` is that of the scheduler. Raises `ConfigurationError` as `connected` does, too.
    """
    with connected(address) as client:

        def each(phase: str, of: Callable[[Path], Any], paths: Sequence[Path]) -> list[Any]:
            futures = client.map(of, paths, pure=False)
            for done, _ in enumerate(as_completed(futures, loop=client.loop), start=1):
                progress(phase, done / len(futures))
            return list(client.gather(futures))

        paths = [path.resolve() for path in recordings]
        return fit_by_sums(model, paths, each, options, columns, trusted)
