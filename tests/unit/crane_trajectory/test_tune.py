"""`tune` tells gains that a crane stands from those that make it swing, on its simulation alone."""

from pathlib import Path

import pytest
import yaml
from known_crane import write_known_model

from crane_model.machine_files import machine_file
from crane_trajectory.tune import DELAYS, SCALES, JointMargins, main

SHORT = {
    "name": "short",
    "period": 2.5,
    "joints": {"boom": {"offset": 0.3, "sine": [0.06], "cosine": [0.03]}},
}


@pytest.fixture
def given(tmp_path: Path) -> list[str]:
    """A known machine of one joint, and a short motion of it."""
    short = tmp_path / "short.yaml"
    short.write_text(yaml.safe_dump(SHORT))
    model = write_known_model(tmp_path / "model.yaml", "single_axis")
    return ["--machine", "single_axis", "--model", str(model), "--trajectory", str(short)]


def test_gains_of_a_law_that_uses_the_model_are_half_of_what_is_stable(
    given: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([*given, "--law", "flow_and_pressures"]) == 0
    told = capsys.readouterr().out
    assert "margins suffice, also both at once" in told
    (row,) = (line.split() for line in told.splitlines() if line.startswith("boom"))
    assert float(row[1]) < 1.0  # mrad


def test_gains_that_make_it_swing_are_named_with_what_to_do(
    given: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    gains = yaml.safe_load(machine_file("controller.yaml", "single_axis").read_text())
    kp = 8.0 * gains["boom"]["kp"]
    gains["boom"] |= {"kp": kp, "position_tolerance": 1e-4}
    file = tmp_path / "controller.yaml"
    file.write_text(yaml.safe_dump(gains))
    assert main([*given, "--controller", str(file)]) == 1
    told = capsys.readouterr().err
    assert "boom: too near to swinging; wanted are 2 times the gains and 50 ms" in told
    advised = float(told.split("kp of boom to ")[1].split()[0])
    assert advised <= kp / 2.0


def test_what_is_advised_leaves_the_margins_that_are_wanted() -> None:
    assert JointMargins(SCALES[-1], DELAYS[-1], True).advised == 1.0
    assert JointMargins(1.5, DELAYS[-1], True).advised == 0.75
    assert JointMargins(SCALES[-1], 0.02, True).advised == pytest.approx(0.4)
    assert JointMargins(0.0, 0.0, False).advised == 0.25
    assert not JointMargins(0.0, 0.0, False).suffice


def test_a_model_without_hydraulics_is_refused(
    given: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    bare = str(machine_file("model.yaml", "single_axis"))
    assert main(["--machine", "single_axis", "--model", bare]) == 1
    assert "holds no hydraulics; identify them" in capsys.readouterr().err
