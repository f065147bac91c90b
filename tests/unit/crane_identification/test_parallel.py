"""Work in several processes gives what one process gives, errors included."""

import os
from multiprocessing import parent_process

import pytest

from crane_identification.parallel import in_parallel
from crane_model.errors import DataError


@pytest.fixture(autouse=True)
def _three_cores(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: {0, 1, 2})


@pytest.mark.parametrize("count", [0, 1, 2, 3, 8])
def test_results_are_in_the_order_of_the_items(count: int) -> None:
    base = 10
    assert in_parallel(lambda k: base + k, range(count)) == [base + k for k in range(count)]


def test_every_core_has_its_share() -> None:
    assert len(set(in_parallel(lambda _: os.getpid(), range(6)))) == 3


def test_a_process_computes_its_items_itself() -> None:
    outer = in_parallel(lambda _: in_parallel(lambda _: os.getpid(), range(3)), range(3))
    assert [len(set(inner)) for inner in outer] == [1, 1, 3]


def test_the_first_error_is_raised() -> None:
    def fails(k: int) -> int:
        if k:
            raise DataError(f"item {k}")
        return k

    with pytest.raises(DataError, match="item 1"):
        in_parallel(fails, range(6))


@pytest.mark.parametrize("leave", [lambda: os._exit(9), lambda: (_ for _ in ())])
def test_what_another_process_cannot_answer_is_computed_here(leave) -> None:
    """It was killed, or its result cannot be sent."""

    def result(k: int) -> object:
        return leave() if parent_process() else k

    assert in_parallel(result, range(4)) == [0, 1, 2, 3]
