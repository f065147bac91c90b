"""A class, the experiment that `diagnose` names for it, and what is left of the class with that."""

import re
import shlex
from pathlib import Path

import pytest
from integration.discriminated import (
    HiddenCase,
    diagnosed,
    findings,
    narrowly_recorded,
    record,
    run,
)

from crane_trajectory.design import main as design
from crane_trajectory.excitation.discrimination import DiscriminationPlan

CASE = HiddenCase("load_friction", "outer_boom", 0.03)


def test_the_experiment_that_is_named_discriminates_the_group(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    narrowly_recorded(tmp_path, CASE)
    before = diagnosed(tmp_path, "before")
    said = capsys.readouterr().out
    assert before.verdict == "ambiguous"
    assert before.holds(CASE)
    (question,) = findings(tmp_path / "before")["open"]["questions"]
    members = {(one["effect"], one["joint"]) for one in question["members"]}
    assert members == before.classes[0]
    (found,) = findings(tmp_path / "before")["findings"]
    refitted = [one["value"] for one in found["parameters"]]
    assert question["members"][0]["values"] == pytest.approx(refitted, rel=0.1)

    named = re.search(r"ros2 run crane_trajectory design (.*)", said)
    assert named is not None
    run(design, *shlex.split(named[1]))
    plan = DiscriminationPlan.read(tmp_path / "before" / "discriminate.json")
    assert all((one.predicted or 0.0) > (one.so_far or 0.0) for one in plan.separations)
    record(
        tmp_path, "discriminating", tmp_path / "before" / "discriminate.yaml", plan.periods, seed=4
    )
    after = diagnosed(tmp_path, "after", "discriminating")
    assert after.discriminated(CASE)
    assert findings(tmp_path / "after")["open"]["questions"] == []
