"""A Dask cluster that answers."""

import re
from collections.abc import Iterator
from contextlib import contextmanager

from distributed import Client

from crane_model.errors import ConfigurationError

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
