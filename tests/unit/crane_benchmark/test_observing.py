"""Which aims of the observers are missed."""

import pytest

from crane_benchmark.measured import MeasuredRow
from crane_benchmark.observing.observer import missed


@pytest.mark.parametrize(("value", "misses"), [(1.9, 0), (2.0, 0), (2.01, 1)])
def test_an_aim_is_missed_by_more_than_it(value: float, misses: int) -> None:
    row = MeasuredRow(cells=["boom [mrad]"], values={"sensor": value, "aim": 2.0})
    found = missed([row])
    assert len(found) == misses
    assert all(text.startswith("boom [mrad]: ") and text.endswith("aim 2") for text in found)
