"""What pip installs: declared needs, names that shadow nobody, tools that start without ROS."""

import ast
import re
import runpy
import subprocess
import sys
import xml.etree.ElementTree as ElementTree
from pathlib import Path
from typing import Any

import pytest
import setuptools
import yaml
from ament_index_python.packages import get_package_share_directory

from crane_model.cli import EXTRAS

ROOT = Path(__file__).resolve().parents[3]
SETUPS = sorted([*ROOT.glob("crane_*/setup.py"), *ROOT.glob("src/*/setup.py")])
DISTRIBUTIONS = {
    "PIL": "pillow",
    "annotated_types": "annotated-types",
    "can": "python-can",
    "cvxpy": "cvxpy-base",
    "pydantic_core": "pydantic-core",
    "rerun": "rerun-sdk",
    "rerun_cli": "rerun-sdk",
    "ruamel": "ruamel.yaml",
    "sklearn": "scikit-learn",
    "typing_extensions": "typing-extensions",
    "yaml": "pyyaml",
}  # where another name is imported
NOT_IMPORTED = {"clarabel", "msgpack"}  # cvxpy solves with one, python-can sends with the other
ROSDEP = {
    "PIL": "python3-pil",
    "can": "python3-can",
    "canopen": "canopen-pip",
    "cantools": "python3-cantools-pip",
    "cvxpy": "python3-cvxpy-pip",
    "filterpy": "python3-filterpy-pip",
    "msgpack": "python3-msgpack",
    "mujoco": "python3-mujoco-pip",
    "rosbags": "python3-rosbags-pip",
    "sklearn": "python3-sklearn",
    "typing_extensions": "python3-typing-extensions",
    "yaml": "python3-yaml",
} | {
    name: f"python3-{name}"
    for name in ("jinja2", "matplotlib", "numba", "numpy", "rich", "scipy", "tornado", "tqdm")
}
"""Keys of rosdistro's python.yaml, by the name that is imported. Not those of pydantic and ruamel:
Ubuntu 24.04 has them too old."""
ROS = re.compile(
    r"launch(_ros)?|rclpy|ament_index_python|crane_interfaces|robot_state_publisher"
    r"|domain_coordinator"
    r"|\w+_(msgs|srvs|interfaces)"
)
PACKAGES = {path.parent.name for path in SETUPS} | {"crane_interfaces"}

each_package = pytest.mark.parametrize("path", SETUPS, ids=lambda path: path.parent.name)


def declared(path: Path, command: str, monkeypatch: pytest.MonkeyPatch) -> dict[str, Any]:
    """What a setup.py hands to setuptools."""
    seen: dict[str, Any] = {}
    monkeypatch.setattr(setuptools, "setup", lambda **content: seen.update(content))
    monkeypatch.setattr(sys, "argv", ["setup.py", command])
    monkeypatch.chdir(path.parent)
    runpy.run_path(str(path))
    return seen


def imported(folder: Path) -> set[str]:
    names = set()
    for file in folder.rglob("*.py"):
        for node in ast.walk(ast.parse(file.read_text("utf-8"))):
            if isinstance(node, ast.Import):
                names |= {alias.name.split(".")[0] for alias in node.names}
            elif isinstance(node, ast.ImportFrom) and node.level == 0:
                names.add(str(node.module).split(".")[0])
    return names - sys.stdlib_module_names


@each_package
def test_its_version_is_that_of_the_manifest(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    manifest = ElementTree.parse(path.with_name("package.xml"))
    version = manifest.findtext("version")
    assert version
    assert declared(path, "bdist_wheel", monkeypatch)["version"] == version


@each_package
def test_a_wheel_asks_for_what_its_modules_import(
    path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    content = declared(path, "bdist_wheel", monkeypatch)
    extras = content.get("extras_require", {})
    texts = [*content["install_requires"], *(one for extra in extras.values() for one in extra)]
    asked = {re.split(r"[\[>]", text)[0] for text in texts}
    found = imported(path.parent / path.parent.name) - {path.parent.name}
    needed = {DISTRIBUTIONS.get(name, name) for name in found if not ROS.fullmatch(name)}
    assert asked - NOT_IMPORTED == needed


@each_package
def test_the_manifest_names_what_is_imported(path: Path) -> None:
    """What the database of rosdep lacks has a key of `scripts/rosdep.yaml`."""
    folder = path.parent
    depends = set(
        re.findall("<exec_depend>(.+)</exec_depend>", path.with_name("package.xml").read_text())
    )
    found = imported(folder / folder.name) | imported(folder / "launch") | named(folder)
    keyless = {n for n in found if n not in ROSDEP and not (ROS.fullmatch(n) or n in PACKAGES)}
    own = {f"python3-{DISTRIBUTIONS.get(name, name)}-pip" for name in keyless}
    also = {ROSDEP.get(name, f"python3-{name}-pip") for name in NOT_IMPORTED}
    assert depends - also == own | {
        ROSDEP.get(name, name) for name in found - keyless - {folder.name}
    }


def test_the_keys_of_our_own_are_those_that_packages_need() -> None:
    keys = yaml.safe_load((ROOT / "scripts/rosdep.yaml").read_text())
    manifests = "".join(path.with_name("package.xml").read_text() for path in SETUPS)
    depends = set(re.findall("<exec_depend>(.+)</exec_depend>", manifests))
    assert set(keys) <= depends
    assert depends - set(keys) <= set(ROSDEP.values()) | set(PACKAGES) | {
        one for one in depends if ROS.fullmatch(one)
    }
    for key, systems in keys.items():
        (package,) = systems["ubuntu"]["pip"]["packages"]
        assert key == f"python3-{package}-pip"
        assert systems["debian"] == systems["ubuntu"]


def named(folder: Path) -> set[str]:
    """Packages that launch files, messages and what starts a program of ROS ask for."""
    launched = {
        name
        for file in folder.glob("launch/*.py")
        for name in PACKAGES
        if f'"{name}"' in file.read_text("utf-8")
    }
    started = {path.stem for path in folder.glob("crane_*/robot_state_publisher.py")}
    messages = {"crane_interfaces"} if (folder / folder.name / "msg").exists() else set()
    return launched | started | messages


@each_package
def test_data_are_where_people_look_for_them(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    package = path.parent.name
    shared = dict(declared(path, "develop", monkeypatch)["data_files"])
    of_machines = path.parent.glob("crane_machines/*/machine.yaml")
    folders = {"config": ("config/*.*", f"{package}/data/*.yaml")} | {
        file.parent.name: (f"{package}/{file.parent.name}/*.*",) for file in of_machines
    }
    for kind, patterns in folders.items():
        files = sorted(one for pattern in patterns for one in path.parent.glob(pattern))
        given = sorted(path.parent / one for one in shared.get(f"share/{package}/{kind}", []))
        assert given == files
        for file in given:
            installed = Path(get_package_share_directory(package), kind, file.name)
            assert installed.read_bytes() == file.read_bytes()


@each_package
def test_scripts_that_pip_installs_shadow_nobody(
    path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """ImageMagick has an `identify`, vim a `view`; `ros2 run` looks into folders of its own."""
    wheel, ros = (
        dict(line.split(" = ") for line in content["entry_points"]["console_scripts"])
        for content in (declared(path, one, monkeypatch) for one in ("bdist_wheel", "develop"))
    )
    assert all(name.startswith("crane-") for name in wheel)
    short = {name.removeprefix("crane-").replace("-", "_"): main for name, main in wheel.items()}
    assert short.items() <= ros.items()


WITHOUT = """
import sys
from importlib.abc import MetaPathFinder

class Absent(MetaPathFinder):
    def find_spec(self, name, path, target=None):
        top = name.partition(".")[0]
        if top in {blocked} or top.endswith(("_msgs", "_srvs", "_interfaces")):
            raise ModuleNotFoundError(f"No module named '{{top}}'", name=top)

sys.meta_path.insert(0, Absent())
import crane_identification.diagnose
import crane_identification.identify
import crane_driver.decode
import crane_sim.make_bag
import crane_identification.data.recording_log
import crane_nodes.recording.recover
from crane_bags.types import CYLINDER_PRESSURES, typestore
assert CYLINDER_PRESSURES.msgtype in typestore().fielddefs
"""


def test_recordings_are_read_and_fitted_without_ros_can_and_extras() -> None:
    ros_and_can = {"rclpy", "ament_index_python", "can", "cantools", "canopen"}
    blocked = ros_and_can | {"distributed", *EXTRAS}
    script = WITHOUT.format(blocked=sorted(blocked))
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
