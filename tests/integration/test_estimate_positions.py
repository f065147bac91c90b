"""`estimate_positions` on a bag of the simulated crane."""

import csv
from pathlib import Path

import numpy as np
import pytest
from unit.crane_observer.observed import JOINTS, known

from crane_model import save_model
from crane_model.machine_files import machine_file
from crane_observer.estimate_positions import PICTURE, TABLE, main
from crane_sim.make_bag import main as make_bag

WITHOUT = "outer_boom"


def test_the_course_and_its_smoothed_one_stand_beside_each_other(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bag, model, out = (str(tmp_path / name) for name in ("bag", "model.yaml", "out"))
    given = ["--trajectory", str(machine_file("excitation_20s.yaml")), "--periods", "1"]
    assert make_bag([*given, "--out", bag]) == 0
    save_model(Path(model), known())
    arguments = ["--bag", bag, "--model", model, "--out", out]
    assert main([*arguments, "--without", WITHOUT]) == 0
    assert f"{WITHOUT}   without encoder  error rms" in capsys.readouterr().out
    assert (Path(out) / PICTURE).stat().st_size > 10_000
    with (Path(out) / TABLE).open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) > 300

    def column(name: str) -> np.ndarray:
        return np.array([float(row[f"{WITHOUT}.{name}"]) for row in rows])

    deviation, later = column("std_dev [rad]"), column("smoothed_std_dev [rad]")
    # errors that are considered and not estimated leave it wider at some moments
    assert (later < 1.3 * deviation).all()
    assert later.mean() < 0.9 * deviation.mean()
    for name in ("position [rad]", "smoothed [rad]"):
        assert np.abs(column(name) - column("encoder [rad]")).max() < 5e-3
    speeds = np.gradient(column("encoder [rad]"), 0.05)
    assert np.abs(column("smoothed_velocity [rad/s]") - speeds)[20:-20].max() < 0.05
    assert len(rows[0]) == 1 + 8 * len(JOINTS) + 5
    assert main([*arguments, "--without", "elbow", "--replace"]) == 1
    assert "no joint elbow; the model has inner_boom" in capsys.readouterr().err
