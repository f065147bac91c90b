"""Cases over processes, with a progress bar."""

import os
import sys
from collections.abc import Callable, Sequence
from concurrent.futures import BrokenExecutor, ProcessPoolExecutor, as_completed
from multiprocessing import get_context
from typing import Protocol, TypeVar

from crane_model.progress_bar import progress_bar


class Named(Protocol):
    """What a case is called."""

    @property
    def name(self) -> str:
        """Tells nothing of it."""


Item = TypeVar("Item", bound=Named)


def in_processes(
    function: Callable[[Item], object],
    items: Sequence[Item],
    workers: int,
    description: str,
    prepare: Callable[[], None] | None = None,
) -> None:
    """Call `function` on every item; each process first calls `prepare`.

    Items on which it fails are reported in the end, and the others go on.
    """
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS"):
        os.environ[name] = "1"  # one process a core
    with (
        ProcessPoolExecutor(workers, get_context("spawn"), prepare) as pool,
        progress_bar(description, len(items)) as bar,
    ):
        futures = {pool.submit(function, item): item for item in items}
        failed: dict[str, Exception] = {}
        try:
            for future in as_completed(futures):
                try:
                    future.result()
                except BrokenExecutor:
                    raise
                except Exception as error:
                    failed[futures[future].name] = error
                bar.update()
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            raise
    for name, reason in failed.items():
        print(f"{description}: case {name} is left out: {reason!r}", file=sys.stderr)
