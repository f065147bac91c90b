"""Imports point one way, and the mathematics knows nothing of ROS; read from the source itself."""

import ast
from graphlib import TopologicalSorter
from pathlib import Path

import pytest
from from_code.imports import MAY_IMPORT, Imports

ROOT = Path(__file__).resolve().parents[3]
FOLDERS = {
    "crane_machines": ROOT / "src" / "crane_machines" / "crane_machines",
    "crane_model": ROOT / "src" / "crane_model" / "crane_model",
    "crane_bags": ROOT / "src" / "crane_bags" / "crane_bags",
    "crane_nodes": ROOT / "src" / "crane_nodes" / "crane_nodes",
    "crane_sim": ROOT / "src" / "crane_sim" / "crane_sim",
    "crane_observer": ROOT / "src" / "crane_observer" / "crane_observer",
    "crane_viewer": ROOT / "src" / "crane_viewer" / "crane_viewer",
    "crane_benchmark": ROOT / "src" / "crane_benchmark" / "crane_benchmark",
    "crane_driver": ROOT / "crane_driver" / "crane_driver",
    "crane_trajectory": ROOT / "crane_trajectory" / "crane_trajectory",
    "crane_identification": ROOT / "crane_identification" / "crane_identification",
}
ROS_PREFIXES = ("rclpy", "rcl_interfaces", "crane_interfaces", "launch", "rosidl_")
ROS_SUFFIXES = ("_msgs", "_srvs")


def imported_packages(file: Path) -> set[str]:
    """Top-level names that a file imports, anywhere in it."""
    names = set()
    for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names |= {alias.name.split(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.level == 0:
            names.add(str(node.module).split(".")[0])
    return names


def is_ros(name: str) -> bool:
    return name.startswith(ROS_PREFIXES) or name.endswith(ROS_SUFFIXES)


@pytest.mark.parametrize("package", FOLDERS)
def test_imports_point_one_way(package: str) -> None:
    files = list(FOLDERS[package].rglob("*.py"))
    assert files
    for file in files:
        others = imported_packages(file) & (FOLDERS.keys() - {package})
        forbidden = others - MAY_IMPORT[package]
        assert not forbidden, f"{file.relative_to(ROOT)} imports {', '.join(sorted(forbidden))}"


def test_no_components_import_each_other_in_a_cycle() -> None:
    components = Imports.of(ROOT).components
    assert len(components) > 50
    TopologicalSorter(components).prepare()  # CycleError names them


NODE_SIDE = ("_node", "_action", "parameters", "topics", "condition")


@pytest.mark.parametrize("package", sorted(FOLDERS.keys() - {"crane_driver", "crane_nodes"}))
def test_mathematics_imports_no_ros(package: str) -> None:
    """Only nodes (..._node.py) do, with their actions, parameters, topics and diagnostics, and
    the driver and crane_nodes, whose work it is; crane_model has no node.
    """
    for file in FOLDERS[package].rglob("*.py"):
        if file.stem.endswith(NODE_SIDE) and package != "crane_model":
            continue
        ros = sorted(name for name in imported_packages(file) if is_ros(name))
        assert not ros, f"{file.relative_to(ROOT)} imports {', '.join(ros)}"


def test_ros_packages_are_recognised() -> None:
    """Guards the check above against a list that matches nothing."""
    for name in ("rclpy", "sensor_msgs", "std_srvs", "crane_interfaces"):
        assert is_ros(name)
    assert not any(is_ros(name) for name in ("numpy", "rosbags", "crane_model", "pydantic"))


def test_no_two_public_classes_have_one_name() -> None:
    places: dict[str, set[str]] = {}
    for folder in FOLDERS.values():
        for file in folder.rglob("*.py"):
            for node in ast.parse(file.read_text(encoding="utf-8")).body:
                if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
                    places.setdefault(node.name, set()).add(str(file.relative_to(ROOT)))
    assert len(places) > 300
    twice = {name: files for name, files in places.items() if len(files) > 1}
    assert not twice


@pytest.mark.parametrize("package", ["crane_bags", "crane_nodes", "crane_identification"])
def test_a_docstring_says_more_than_a_name(package: str) -> None:
    """Of one or two words, none does."""
    short = [
        f"{file.relative_to(ROOT)}:{node.lineno} {node.name}"
        for file in FOLDERS[package].rglob("*.py")
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8")))
        if isinstance(node, ast.FunctionDef | ast.ClassDef)
        and len((ast.get_docstring(node) or "it needs none").split()) < 3
    ]
    assert not short


def test_the_diagnosis_asks_no_term_for_its_fields() -> None:
    """A term says its own physics."""
    folder = FOLDERS["crane_identification"] / "diagnosis"
    files = list(folder.rglob("*.py"))
    assert len(files) > 20
    asking = {"hasattr", "isinstance", "issubclass"}
    for file in files:
        nodes = ast.walk(ast.parse(file.read_text(encoding="utf-8")))
        names = {node.id for node in nodes if isinstance(node, ast.Name)}
        assert not names & asking, f"{file.relative_to(ROOT)} asks {names & asking}"
