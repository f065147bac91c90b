import os
import time

import pytest

from crane_identification.online.replay import BackgroundTask
from crane_model import CraneError, DataError
from crane_model.progress_bar import Progress


def squared(number: float, progress: Progress) -> float:
    progress("any", 0.5)
    if number < 0.0:
        raise DataError("no negative ones")
    if number == 0.0:
        os._exit(7)
    return number**2


def endless(progress: Progress) -> None:
    while True:
        time.sleep(1.0)


def test_results_and_errors_come_back_from_the_other_process() -> None:
    told: list[tuple[str, float]] = []
    with (
        BackgroundTask(squared, 3.0) as right,
        BackgroundTask(squared, -1.0) as wrong,
        BackgroundTask(squared, 0.0) as dead,
    ):
        assert right.result(lambda *done: told.append(done)) == 9.0
        with pytest.raises(DataError, match="no negative ones"):
            wrong.result(lambda *done: None)
        with pytest.raises(CraneError, match=r"squared: its process ended with exit code 7"):
            dead.result(lambda *done: None)
    assert told[-1] == ("squared", 1.0)


def test_leaving_ends_it() -> None:
    with pytest.raises(KeyError), BackgroundTask(endless) as beside:
        raise KeyError
    with pytest.raises(CraneError, match="exit code -15"):
        beside.result(lambda *done: None)
