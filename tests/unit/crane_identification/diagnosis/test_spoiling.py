"""Effects without which the others predict the force better."""

from collections.abc import Mapping, Sequence
from types import SimpleNamespace
from typing import Any
from unittest.mock import Mock

import numpy as np
import pytest

from crane_identification.diagnosis.proof import proof
from crane_identification.diagnosis.proof.proof import spoiling
from crane_identification.thresholds import load_thresholds

BOTH = 0.10  # held-out error of either joint with all effects, relative to the force


def effect(joint: str | None) -> Any:
    def joints(names: Sequence[str]) -> list[int]:
        return [j for j, name in enumerate(names) if joint in (name, None)]

    return Mock(shaped=SimpleNamespace(joints=joints))


@pytest.mark.parametrize(
    ("joints", "without", "spoiled"),
    [
        (("boom", "boom"), {1: (0.08, 0.10)}, 1),
        (("boom", "boom"), {1: (0.097, 0.10)}, None),  # by less than chance
        (("boom", "boom"), {1: (0.10, 0.01)}, None),  # on a joint that it does not act on
        (("boom", "boom"), {0: (0.08, 0.10)}, 0),
        (("boom", "boom"), {0: (0.08, 0.10), 1: (0.08, 0.10)}, 1),  # the weaker one first
        (("boom", "arm"), {1: (0.10, 0.01)}, None),  # alone on its joint: the whole gap says it
        (("boom", None), {1: (0.10, 0.01)}, 1),
        (("boom", None), {1: (0.09, 0.4)}, None),  # it takes more away elsewhere
        (("boom",), {0: (0.01, 0.01)}, None),
    ],
)
def test_an_effect_that_makes_predictions_worse_beside_the_others(
    monkeypatch: pytest.MonkeyPatch,
    joints: tuple[str | None, ...],
    without: Mapping[int, tuple[float, float]],
    spoiled: int | None,
) -> None:
    effects = [effect(joint) for joint in joints]

    def error(_fit: Any, _search: Any, rest: list[Any]) -> np.ndarray:
        (left_out,) = [k for k, one in enumerate(effects) if not any(one is two for two in rest)]
        return np.array(without.get(left_out, (0.2, 0.2)))

    monkeypatch.setattr(proof, "held_out_error", error)
    gap: Any = SimpleNamespace(
        joints=("boom", "arm"), held_to=SimpleNamespace(after=np.array([BOTH, BOTH]))
    )
    trial: Any = SimpleNamespace(effects=tuple(effects))
    nothing: Any = None
    found = spoiling(nothing, nothing, trial, gap, load_thresholds())
    assert [one.effect for one in found] == ([] if spoiled is None else [effects[spoiled]])
    if found and joints[1] == "boom":
        (said,) = (one.objection for one in found)
        assert said == "without it, the held-out error of boom is 8.00% and not 10.00%"
