"""Cases over processes, with a progress bar."""

import os
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from multiprocessing import get_context
from typing import TypeVar

from tqdm import tqdm

Item = TypeVar("Item")


def in_processes(
    function: Callable[[Item], object],
    items: Sequence[Item],
    workers: int,
    description: str,
    prepare: Callable[[], None] | None = None,
) -> None:
    """Call `function` on every item; each process first calls `prepare`.

    Whatever a call raises is raised here; what is finished by then stays.
    """
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS"):
        os.environ[name] = "1"  # one process a core
    with (
        ProcessPoolExecutor(workers, get_context("spawn"), prepare) as pool,
        tqdm(total=len(items), desc=description, unit="case") as bar,
    ):
        futures = [pool.submit(function, item) for item in items]
        try:
            for future in as_completed(futures):
                future.result()
                bar.update()
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            raise
