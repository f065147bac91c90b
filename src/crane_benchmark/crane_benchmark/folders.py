"""Folders of the benchmark: bags, sealed ground truth and answers of a set lie apart.

Bags and ground truth do not depend on thresholds, answers and scores do: one set of cases may have
several rounds of these.
"""

import json
import os
import shutil
import sys
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import BrokenExecutor, ProcessPoolExecutor, as_completed
from contextlib import contextmanager
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path
from typing import Any, TypeVar

from crane_model.progress_bar import progress_bar

ANSWER, ROW = "answer.json", "row.json"  # in the folder of a case


Item = TypeVar("Item")


def in_processes(
    function: Callable[[Item], object],
    items: Mapping[str, Item],
    workers: int,
    description: str,
    prepare: Callable[[], None] | None = None,
) -> None:
    """Call `function` on the item of each case; each process first calls `prepare`.

    Items on which it fails are reported in the end, and the others go on.
    """
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS"):
        os.environ[name] = "1"  # one process a core
    with (
        ProcessPoolExecutor(workers, get_context("spawn"), prepare) as pool,
        progress_bar(description, len(items)) as bar,
    ):
        futures = {pool.submit(function, item): name for name, item in items.items()}
        failed: dict[str, Exception] = {}
        try:
            for future in as_completed(futures):
                try:
                    future.result()
                except BrokenExecutor:
                    raise
                except Exception as error:
                    failed[futures[future]] = error
                bar.update()
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            raise
    for name, reason in failed.items():
        print(f"{description}: case {name} is left out: {reason!r}", file=sys.stderr)


@dataclass(frozen=True)
class Folders:
    """The folders of one set of cases, and of one `round` of answers to them ("": the only one).

    Within bags, sealed, answers and rows: one folder a case.
    """

    top: Path
    round: str = ""

    @property
    def bags(self) -> Path:
        """All that the answering process is given: recordings and the model to diagnose."""
        return self.top / "bags"

    @property
    def sealed(self) -> Path:
        """Ground truth of each case, and its clean simulation; for the scorer."""
        return self.top / "sealed"

    @property
    def answers(self) -> Path:
        """Answers of the diagnosis and of the methods compared with it."""
        return self.scores / "answers"

    @property
    def scores(self) -> Path:
        """Scores of the round: answers, their outcomes, and figures."""
        return self.top / self.round

    @property
    def rows(self) -> Path:
        """The score of each case."""
        return self.scores / "rows"

    @property
    def results(self) -> Path:
        """Scores, for programs."""
        return self.scores / "results.json"


def done(folder: Path) -> set[str]:
    """The cases that are finished in a folder."""
    return {entry.name for entry in folder.iterdir()} if folder.exists() else set()


@contextmanager
def new(folder: Path) -> Iterator[Path]:
    """Folder to write `folder` into until it is complete, in place of an earlier one."""
    unfinished = folder.parent.parent / "unfinished" / folder.parent.name / folder.name
    for old in (unfinished, folder):  # of a run that was interrupted
        shutil.rmtree(old, ignore_errors=True)
    unfinished.mkdir(parents=True)
    yield unfinished
    folder.parent.mkdir(parents=True, exist_ok=True)
    unfinished.rename(folder)


def write_json(path: Path, content: Any) -> None:
    """Write JSON that is complete or not there."""
    unfinished = path.with_name(path.name + ".unfinished")
    unfinished.write_text(json.dumps(content, indent=1, allow_nan=False) + "\n", encoding="utf-8")
    unfinished.rename(path)


def read_json(path: Path) -> Any:
    """Its content."""
    return json.loads(path.read_text(encoding="utf-8"))
