"""The three tutorials: their cells run, in order, and end as the text says."""

import re
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from manual import ROOT, text

CELL = re.compile(r"```\{code-cell\} python\n(.*?)```", re.DOTALL)
OF_THE_PAGE = ":tags: [remove-cell]"  # where the site runs it


@pytest.fixture
def clone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder that looks like the clone, for what the tutorial writes."""
    for folder in ("src", "crane_trajectory"):
        (tmp_path / folder).symlink_to(ROOT / folder)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("MPLBACKEND", "Agg")
    return tmp_path


def run(page: str) -> dict[str, Any]:
    """Run the cells of a tutorial; what they have named. AssertionError if a command fails."""
    names: dict[str, Any] = {}
    for cell in CELL.findall(text(f"docs/tutorials/{page}")):
        if cell.startswith(OF_THE_PAGE):
            continue
        if cell.startswith("%%bash\n"):
            command = ["bash", "-euo", "pipefail", "-c", cell.removeprefix("%%bash\n")]
            done = subprocess.run(command, capture_output=True, text=True)
            assert done.returncode == 0, done.stderr
        else:
            exec(compile(cell, page, "exec"), names)
    return names


def test_a_bag_to_parameters(clone: Path) -> None:
    names = run("bag_to_parameters.md")
    off = np.abs(names["sigmas"])
    assert len(off) == 20
    assert np.sum(off < 2.0) >= 18
    assert off.max() < 4.0
    assert (clone / "runs/tutorial_identify/fit/report.html").is_file()
    for joint, error in names["summary"]["heldout_relative_error"].items():
        assert error < 3.0 * names["summary"]["noise_floor"][joint]


def test_which_effect_is_missing(clone: Path) -> None:
    names = run("missing_effect.md")
    assert names["answer"]["verdict"] == "named"
    assert [(one["effect"], one["joint"]) for one in names["answer"]["findings"]] == [
        (one["effect"], one["joint"]) for one in names["truth"]["effects"]
    ]


def test_your_machine_in_an_hour(clone: Path, capsys: pytest.CaptureFixture[str]) -> None:
    names = run("own_machine.md")
    printed = capsys.readouterr().out
    assert "joints.stick" in printed and "the cylinder's length must stay within" in printed
    assert "no actuator of type 'four_bars'; there are direct_cylinder, " in printed
    found = [(one.name, one.value, one.std_dev) for one in names["summary"].parameters]
    off = np.abs([(value - names["true_values"][name]) / doubt for name, value, doubt in found])
    assert len(off) == 38
    assert np.sum(off < 2.0) >= 33
    assert off.max() < 5.0
    errors = names["summary"].heldout_relative_error
    assert tuple(errors) == names["machine"].joint_names
    assert max(errors.values()) < 0.02
    assert (clone / "runs/my_excavator/fit/report.html").is_file()
