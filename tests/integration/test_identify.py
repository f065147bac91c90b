"""From the simulated crane to a fitted, validated model, by the executables alone."""

import json
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from ament_index_python.packages import get_package_prefix

from crane_model import load_model
from crane_model.machine_files import machine_file

MODEL = machine_file("model.yaml")


def _run(package: str, executable: str, *arguments: object) -> subprocess.CompletedProcess[str]:
    path = Path(get_package_prefix(package)) / "lib" / package / executable
    return subprocess.run([str(path), *map(str, arguments)], capture_output=True, text=True)


def _bag(out: Path, trajectory: str, seed: int) -> Path:
    file = machine_file(trajectory)
    what = ("--trajectory", file, "--periods", 3, "--seed", seed, "--out", out)
    done = _run("crane_sim", "make_bag", *what)
    assert done.returncode == 0, done.stderr
    return out


@pytest.fixture(scope="module")
def bags(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """One to fit on, and one of another trajectory and other noise to validate on."""
    folder = tmp_path_factory.mktemp("bags")
    train = _bag(folder / "train", "excitation_20s.yaml", 11)
    return train, _bag(folder / "held_out", "validation_20s.yaml", 12)


@pytest.fixture(scope="module")
def true_values() -> dict[str, float]:
    """Theta of the machine, and its hydraulics."""
    return json.loads(_run("crane_sim", "true_values", "--json").stdout)


@pytest.fixture(scope="module")
def result(bags: tuple[Path, Path], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder that identify writes."""
    out = tmp_path_factory.mktemp("fit") / "new"
    train, held_out = bags
    what = ("--model", MODEL, "--train", train, "--validate", held_out, "--out", out)
    done = _run("crane_identification", "identify", *what)
    assert done.returncode == 0, done.stderr
    return out


@pytest.fixture(scope="module")
def summary(result: Path) -> dict[str, Any]:
    """Its numbers."""
    return json.loads((result / "summary.json").read_text(encoding="utf-8"))


def test_true_parameters_are_found(summary: dict[str, Any], true_values: dict[str, float]) -> None:
    """Within 3 sigma but for one at most, and every sigma under 10 % of its value."""
    rows = summary["parameters"]
    names = [row["name"] for row in rows]
    assert names + [row["name"] for row in summary["hydraulics"]] == list(true_values)
    value = np.array([row["value"] for row in rows])
    std_dev = np.array([row["std_dev"] for row in rows])
    true = np.array([true_values[name] for name in names])
    assert (std_dev < 0.1 * np.abs(value)).all()
    assert (np.abs(value - true) > 3.0 * std_dev).sum() <= 1
    assert (np.abs(value - true) < 0.1 * np.abs(true)).all()


def test_force_and_motion_of_the_held_out_bag_are_predicted(summary: dict[str, Any]) -> None:
    """Force to 5 % in each joint; the joints half a second ahead to a tenth of their way."""
    assert max(summary["heldout_relative_error"].values()) < 0.05
    assert max(summary["heldout_relative_error_moving"].values()) < 0.02
    motion = summary["simulated_motion"]
    for joint, error in motion["position_rms"].items():
        assert error < 0.1 * motion["displacement_rms"][joint]


def test_friction_is_about_half_of_the_drive_force(summary: dict[str, Any]) -> None:
    """As the report says of its crane."""
    assert all(0.4 < share < 0.7 for share in summary["friction_share"].values())


def test_written_model_loads_with_its_values(result: Path, summary: dict[str, Any]) -> None:
    """And carries machine, standard deviations and where they come from."""
    model = load_model(result / "model.yaml")
    assert model.values == pytest.approx([row["value"] for row in summary["parameters"]])
    assert model.std_devs == pytest.approx([row["std_dev"] for row in summary["parameters"]])
    assert model.machine is not None and model.provenance


@pytest.mark.parametrize(
    ("train", "validate", "said"),
    [
        ("absent", None, "absent"),
        ("train", "train", "validate on recordings that the fit has not seen"),
        ("table.csv", None, "--columns"),
    ],
)
def test_what_cannot_be_done_is_said_and_nothing_written(
    bags: tuple[Path, Path], tmp_path: Path, train: str, validate: str | None, said: str
) -> None:
    """An absent bag, the same bag for both, a table without a column map."""
    folder = bags[0].parent
    arguments = ["--model", MODEL, "--train", folder / train, "--out", tmp_path / "out"]
    if validate:
        arguments += ["--validate", folder / validate]
    done = _run("crane_identification", "identify", *arguments)
    assert done.returncode == 1
    assert done.stderr.startswith("error: ") and said in done.stderr
    assert not (tmp_path / "out").exists()
