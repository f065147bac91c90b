"""The experiment of `design --discriminate` decides at least nine in ten ambiguity groups.

Each is recorded on the simulated crane, and diagnosed with what was there.
"""

from collections.abc import Callable
from pathlib import Path

import pytest
from integration.discriminated import CASES, HiddenCase, designed, diagnosed, narrowly_recorded

from crane_model.terms import REGISTRY

DISCRIMINATED: dict[str, bool] = {}


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.name)
def test_the_experiment_is_for_the_class(
    case: HiddenCase, tmp_path: Path, measured: Callable[..., None]
) -> None:
    narrowly_recorded(tmp_path, case)
    before = diagnosed(tmp_path, "before")
    assert before.verdict == "ambiguous"
    assert before.holds(case)
    plan = designed(tmp_path, "before")
    after = diagnosed(tmp_path, "after", "discriminating")
    DISCRIMINATED[case.name] = after.discriminated(case)
    so_far = min(one["so_far"] for one in plan["separations"] if one["so_far"] is not None)
    predicted = min(one["predicted"] for one in plan["separations"])
    effect = REGISTRY[case.effect].effect
    assert effect is not None
    measured(
        f"{effect.name}, {case.joint}, {case.relative_magnitude:.1%} of the drive, "
        f"seed {case.seed}: members "
        "of the ambiguity group; smallest separation before, predicted; recording; answer with it",
        "named",
        f"{len(before.classes[0])}; {so_far:.1f}, {predicted:.0f} σ; {plan['duration']:.0f} s; "
        + ("named" if DISCRIMINATED[case.name] else f"`{after.verdict}`, not discriminated"),
        members=len(before.classes[0]),
        so_far=so_far,
        predicted=predicted,
        duration=plan["duration"],
        discriminated=DISCRIMINATED[case.name],
    )


def test_nine_in_ten_groups_are_discriminated(measured: Callable[..., None]) -> None:
    if len(DISCRIMINATED) < len(CASES):
        pytest.skip("not every class was asked")
    count = sum(DISCRIMINATED.values())
    measured(
        "ambiguity groups discriminated",
        "9 in 10",
        f"{count} of {len(DISCRIMINATED)}",
        discriminated=count,
    )
    assert count >= 0.9 * len(DISCRIMINATED)
