"""The study in small: designed, recorded, identified recursively and at once, and shown."""

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from unit.crane_identification.report.html_reader import figure_descriptions, read_html

from crane_benchmark.measured import MeasuredFigures
from crane_benchmark.study import recordings
from crane_benchmark.study.recordings import Campaign, StudyPlan
from crane_model import load_model

STUDY = [sys.executable, "-m", "crane_benchmark.study.study"]
EXPERIMENT = StudyPlan(period=14.0, harmonics=3, starts=1, periods=2)


@pytest.fixture(scope="module")
def out(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("study") / "new"


@pytest.fixture(scope="module")
def printed(out: Path) -> str:
    """What a study of two trajectories and one to validate on prints; the real axis is not there:
    test_emps.py looks at it."""
    done = subprocess.run(
        [*STUDY, "--out", str(out)]
        + ["--training", "2", "--validation", "1"]
        + [f"--{name}={value}" for name, value in vars(EXPERIMENT).items()],
        capture_output=True,
        text=True,
        env=os.environ
        | {"COLUMNS": "160", "CRANE_REAL_DATA": str(out)},  # no heading is to be broken
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.fixture(scope="module")
def summary(printed: str, out: Path) -> dict[str, Any]:
    return json.loads((out / "summary.json").read_text(encoding="utf-8"))


def test_recursion_finds_true_values(summary, out):
    true_values = json.loads((out / "true_values.json").read_text(encoding="utf-8"))
    for row in summary["recursive"]["parameters"]:
        true = true_values[row["name"]]
        assert abs(row["value"] - true) < 0.1 * abs(true), row


def test_both_estimates_predict_a_bag_that_neither_saw(summary):
    assert len(summary["training_bags"]) == 2
    assert len(summary["validation_bags"]) == 1
    for errors in (
        summary["heldout_relative_error"],
        summary["recursive"]["heldout_relative_error"],
    ):
        assert list(errors) == ["inner_boom", "outer_boom", "telescope"]
        assert max(errors.values()) < 0.05


def test_its_page_has_the_figures_of_the_report(summary, out):
    tree = read_html((out / "report.html").read_text(encoding="utf-8"))
    keys = figure_descriptions(tree).keys()
    joints = summary["heldout_relative_error"]
    for figure in ("reference-0", "recording-1", "average-0", "validation-0"):  # 8, 9, 10, 12
        assert {f"{figure}-{joint}" for joint in joints} <= keys
    (table,) = tree.find("table", class_="recursive")
    assert len(table.find("td", class_="value")) == 20


def test_its_figures_are_those_of_its_summary(summary, out):
    """With the times of all steps: nothing was there before."""
    found = MeasuredFigures.read(out / "figures.json")
    for joint, error in summary["heldout_relative_error"].items():
        assert found.value(f"fit_{joint}") == error
        ratio = error / summary["training_relative_error"][joint]
        assert found.value(f"over_training_{joint}") == pytest.approx(ratio)
    assert found.value("fit_sigmas") < 5.0
    assert 0.0 < found.value("after_2") < found.value("after_1")
    assert found.value("wall") > found.value("wall_2") > 0.0


def test_its_crane_follows_by_what_one_bag_behind_a_bus_told(printed, out):
    """Half as long as the aims ask for; how well is for `make study` to say."""
    found = MeasuredFigures.read(out / "figures.json")
    for joint, far in {"inner_boom": 0.5, "outer_boom": 0.7, "telescope": 0.5}.items():
        for trajectory in ("excitation_20s", "validation_20s"):
            key = f"{trajectory}_flow_and_pressures_{joint}"
            assert found.value(key) < far
            before = found.value(f"{trajectory}_pd_dead_band_{joint}")
            assert before / found.value(key) == pytest.approx(found.value(f"{key}_better"))
        assert found.value(f"ahead_5_{joint}") < 0.005
    hydraulics = out / "following" / "identified" / "model.yaml"
    assert load_model(hydraulics).hydraulics is not None


def test_tables_and_times_are_printed(printed):
    for words in (
        *("bags recorded", "CPU", "20 parameters", "scatter between", "EMPS"),
        *("dead volumes", "computed_force", "mrad"),
    ):
        assert words in printed


def test_what_is_there_is_not_made_again(printed, out, monkeypatch):
    def never(*arguments: object) -> str:
        raise AssertionError(arguments)

    monkeypatch.setattr(recordings, "run", never)
    done: list[None] = []
    campaigns = [Campaign("training", 2, 1, out), Campaign("validation", 1, 101, out)]
    for campaign in campaigns:
        recordings.design(campaign, EXPERIMENT)
    recordings.record(campaigns, EXPERIMENT, lambda: done.append(None))
    assert len(done) == 3


def test_an_executable_that_fails_ends_the_study_with_its_error(tmp_path):
    done = subprocess.run(
        [*STUDY, "--out", str(tmp_path / "new"), "--starts", "0"],
        capture_output=True,
        text=True,
    )
    assert done.returncode == 1
    assert done.stderr.startswith("error: crane_trajectory design failed")
    assert "--starts: must be a whole number at least 1, got 0" in done.stderr
