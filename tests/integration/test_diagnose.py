"""The diagnosis by its executable: a machine that lacks nothing, and EMPS without its friction."""

import json
import re
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from ament_index_python.packages import get_package_prefix
from integration.emps_published import (
    FILES,
    NAMES,
    PROCESSING,
    RELATIVE_ERROR,
    VALUES,
    recording,
)
from scipy.io import loadmat

from crane_identification import fit
from crane_model import load_model
from crane_model.machine_files import machine_file
from crane_model.terms.single_axis import Offset

MODEL = machine_file("model.yaml")
BARE = """
name: EMPS, inertia and viscous friction only
joints: {axis: m}
terms:
  - {type: inertia, joint: axis}
  - {type: viscous, joint: axis}
"""


def _run(package: str, executable: str, *arguments: object) -> subprocess.CompletedProcess[str]:
    path = Path(get_package_prefix(package)) / "lib" / package / executable
    return subprocess.run([str(path), *map(str, arguments)], capture_output=True, text=True)


def _diagnose(*arguments: object) -> subprocess.CompletedProcess[str]:
    return _run("crane_identification", "diagnose", *arguments)


def _findings(folder: Path) -> dict[str, Any]:
    return json.loads((folder / "findings.json").read_text(encoding="utf-8"))


@pytest.fixture(scope="module")
def bags(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path, Path]:
    folder = tmp_path_factory.mktemp("bags")
    out = []
    for name, trajectory, seed in (
        ("first", "excitation_20s.yaml", 21),
        ("second", "validation_20s.yaml", 22),
        ("held_out", "validation_20s.yaml", 23),
    ):
        file = machine_file(trajectory)
        what = ("--trajectory", file, "--periods", 2, "--seed", seed, "--out", folder / name)
        done = _run("crane_sim", "make_bag", *what)
        assert done.returncode == 0, done.stderr
        out.append(folder / name)
    return out[0], out[1], out[2]


@pytest.fixture(scope="module")
def nothing(
    bags: tuple[Path, Path, Path], tmp_path_factory: pytest.TempPathFactory
) -> tuple[Path, str]:
    """The folder that a diagnosis of the whole model writes, and what it prints."""
    out = tmp_path_factory.mktemp("diagnosis") / "new"
    what = ("--model", MODEL, "--train", *bags[:2], "--validate", bags[2], "--out", out)
    done = _diagnose(*what)
    assert done.returncode == 0, done.stderr
    return out, done.stdout


def test_a_machine_that_obeys_its_model_lacks_nothing(nothing: tuple[Path, str]) -> None:
    out, said = nothing
    content = _findings(out)
    assert content["verdict"] == "none" and content["findings"] == []
    assert "Nothing is missing" in said
    for joint, error in content["model_error"]["after"].items():
        assert error["force_relative_error"] < 2.0 * error["noise_floor"], joint
    assert load_model(out / "model.yaml").values is not None
    assert "Nothing is missing" in (out / "report.html").read_text(encoding="utf-8")


def test_the_answer_is_told_again(nothing: tuple[Path, str]) -> None:
    out, said = nothing
    done = _diagnose("--explain", out)
    assert done.returncode == 0
    assert len(done.stdout.splitlines()) <= 20
    assert done.stdout.strip() in said


def test_the_time_that_it_took_is_said(nothing: tuple[Path, str]) -> None:
    last = nothing[1].splitlines()[-1]
    assert re.fullmatch(r"3 recordings, \d+ samples of each joint, \d+ s", last), last


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--model", MODEL], "--train, --validate, --out"),
        (["--explain", "absent"], "findings.json"),
        (
            ["--model", MODEL, "--train", "a", "--validate", "a", "--out", "b"],
            "on held-out recordings",
        ),
        (
            ["--model", MODEL, "--train", "a", "./a", "--validate", "b", "--out", "c"],
            "given twice",
        ),
        (["--explain", "."], "holds no findings.json"),
    ],
)
def test_what_cannot_be_done_is_said(tmp_path: Path, arguments: list[object], said: str) -> None:
    done = _diagnose(*arguments)
    assert done.returncode == 1
    assert done.stderr.startswith("error: ") and said in done.stderr


@pytest.fixture(scope="module")
def emps(real_data: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A diagnosis of inertia and viscous friction on the first part, proved on the last."""
    folder = tmp_path_factory.mktemp("emps")
    data = loadmat(real_data / "emps" / "DATA_EMPS.mat")
    table = np.column_stack([data[name].ravel() for name in ("t", "qm", "vir")])
    cut = int(0.7 * len(table))
    for name, part in (("train", table[:cut]), ("held_out", table[cut:])):
        rows = "\n".join(",".join(map(repr, row)) for row in part.tolist())
        (folder / f"{name}.csv").write_text("t,qm,vir\n" + rows, encoding="utf-8")
    (folder / "bare.yaml").write_text(BARE, encoding="utf-8")
    done = _diagnose(
        *("--model", folder / "bare.yaml", "--columns", FILES / "columns.yaml"),
        *("--train", folder / "train.csv", "--validate", folder / "held_out.csv"),
        *("--out", folder / "out"),
    )
    assert done.returncode == 0, done.stderr
    return folder / "out"


def test_coulomb_friction_of_emps_is_found_then_its_asymmetry(emps: Path) -> None:
    """A constant force, as the authors have it, is next best."""
    first, second = _findings(emps)["findings"]
    assert first["effect"] == "coulomb" and not first["ambiguity_group"]
    assert second["effect"] == "viscous_asymmetry" and not second["ambiguity_group"]
    assert second["runner_up"]["effect"] in {"offset", "coulomb_asymmetry"}
    assert second["margin"] > second["margin_needed"]
    gap = _findings(emps)["model_error"]
    after = gap["after"]["axis"]["force_relative_error"]
    assert after < 0.2 * gap["before"]["axis"]["force_relative_error"]


def test_the_additions_bring_the_published_fit_of_emps(emps: Path, real_data: Path) -> None:
    """With the authors' processing: their values, and a smaller error than with their offset."""
    model = load_model(emps / "model.yaml")
    estimate = fit(model, [recording(real_data, model.joints)], PROCESSING).estimate
    assert estimate.names[:3] == NAMES[:3]
    np.testing.assert_allclose(estimate.values[:3], VALUES[:3], rtol=1e-3)
    assert estimate.relative_error[0] < RELATIVE_ERROR


def test_with_a_constant_force_instead_it_is_their_model(emps: Path, real_data: Path) -> None:
    """To every digit that the authors print."""
    found = load_model(emps / "model.yaml")
    model = found.without_term(found.terms[3]).with_term(Offset(joint="axis"))
    estimate = fit(model, [recording(real_data, model.joints)], PROCESSING).estimate
    assert dict(zip(estimate.names, estimate.values.round(4), strict=True)) == dict(
        zip(NAMES, VALUES, strict=True)
    )
