"""A new virtual environment without ROS: pip installs the wheels, and identify fits a bag."""

import json
import os
import shutil
import subprocess
import sys
import venv
from pathlib import Path

from crane_model.machine_files import machine_file
from crane_sim.make_bag import main as make_bag

ROOT = Path(__file__).resolve().parents[2]
PACKAGES = (
    Path("src/crane_machines"),
    Path("src/crane_model"),
    Path("src/crane_bags"),
    Path("src/crane_observer"),
    Path("crane_identification"),
)
LEFT_OUT = shutil.ignore_patterns("build", "*.egg-info", "__pycache__")


def uv(*arguments: str | Path) -> None:
    subprocess.run([Path(sys.executable).with_name("uv"), *arguments], check=True)


def test_fit_of_a_bag_where_there_is_no_ros(tmp_path: Path) -> None:
    tree = tmp_path / "tree"
    for folder in (*PACKAGES, Path("crane_interfaces")):  # the link to its definitions stays one
        shutil.copytree(ROOT / folder, tree / folder, symlinks=True, ignore=LEFT_OUT)
    for package in PACKAGES:
        uv("build", "--quiet", "--wheel", "--out-dir", tmp_path / "wheels", tree / package)
    environment = tmp_path / "environment"
    venv.create(environment)
    python = environment / "bin" / "python"
    pinned = (ROOT / f"requirements{part}.txt" for part in ("", "-tables"))
    pins = [word for file in pinned for word in ("--constraint", file)]
    wheels = sorted((tmp_path / "wheels").glob("*.whl"))
    uv("pip", "install", "--quiet", "--python", python, *pins, *wheels)

    bag = tmp_path / "bag"
    trajectory = machine_file("excitation_20s.yaml")
    assert make_bag(["--trajectory", str(trajectory), "--periods", "3", "--out", str(bag)]) == 0
    model = machine_file("model.yaml")
    command: list[str | Path] = [
        environment / "bin" / "crane-identify",
        "--model",
        model,
        "--train",
        bag,
    ]
    names = ("PYTHONPATH", "AMENT_PREFIX_PATH")
    without_ros = {key: value for key, value in os.environ.items() if key not in names}
    out = tmp_path / "fit"
    subprocess.run([*command, "--out", out], check=True, env=without_ros)
    assert json.loads((out / "summary.json").read_text())["parameters"]
