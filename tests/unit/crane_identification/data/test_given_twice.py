"""A recording counts once: neither its path nor a copy of it stands for a second one."""

from dataclasses import replace
from pathlib import Path

import pytest
from unit.crane_identification.synthetic import crane_log

from crane_identification.data.sources import refuse_copies, refuse_overlap
from crane_model import DataError

A, B, C = Path("a"), Path("b"), Path("c")
WHY = "it took part"


def test_each_recording_once_is_as_it_should_be() -> None:
    refuse_overlap([A, B], [C], WHY)
    refuse_copies([crane_log(1), crane_log(2)])


@pytest.mark.parametrize(
    ("train", "validate", "said"),
    [
        ([A, B], [Path("./a")], f"a: given for training and for validation; {WHY}"),
        ([A, B, Path("./b")], [C], "b: given twice"),
        ([A], [B, C, Path("./c")], "c: given twice"),
    ],
)
def test_a_path_is_given_once(train: list[Path], validate: list[Path], said: str) -> None:
    with pytest.raises(DataError, match=said):
        refuse_overlap(train, validate, WHY)


def test_a_copy_is_told_by_its_samples() -> None:
    log = crane_log(1)
    copy = replace(log, source="copy")
    with pytest.raises(DataError, match=f"copy: the same samples as {log.source}"):
        refuse_copies([log, crane_log(2), copy])


def test_the_same_motion_at_another_time_or_with_other_forces_is_no_copy() -> None:
    log = crane_log(1)
    assert log.pressure_a is not None
    changed = replace(log.pressure_a, value=1.01 * log.pressure_a.value)
    refuse_copies([log, replace(log, start=log.start + 10**9), replace(log, pressure_a=changed)])
