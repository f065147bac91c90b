"""Launch files: what they name exists; and, where ROS has `launch`, they do what they say."""

import ast
import importlib.util
import os
import signal
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from ament_index_python.packages import get_package_prefix, get_package_share_directory
from integration.processes import PATIENCE, free_port

from crane_driver.driver_parameters import driver_parameters
from crane_identification.online.identification_node import PARAMETERS as IDENTIFICATION
from crane_model import load_machine
from crane_model.machine_files import DEFAULT_MACHINE
from crane_observer.node.payload_estimator_node import PARAMETERS as PAYLOAD_ESTIMATOR
from crane_observer.node.position_estimator_node import PARAMETERS as POSITION_ESTIMATOR
from crane_observer.node.sensor_monitor_node import PARAMETERS as SENSOR_MONITOR
from crane_trajectory.trajectory_topics import parameters_of

ROOT = Path(__file__).resolve().parents[2]
FILES = sorted([*ROOT.glob("crane_*/launch/*.py"), *ROOT.glob("src/*/launch/*.py")])
SHARED = ROOT / "src/crane_nodes/crane_nodes/launching.py"
NAMES = [path.name.removesuffix(".launch.py") for path in FILES]
OF_EVERY_NODE = {"use_sim_time"}
DECLARED = {
    "driver": {one.name for one in driver_parameters(load_machine(), DEFAULT_MACHINE)},
    "trajectory": {one.name for one in parameters_of()},
    "identification": {one.name for one in IDENTIFICATION},
    "position_estimator": {one.name for one in POSITION_ESTIMATOR},
    "sensor_monitor": {one.name for one in SENSOR_MONITOR},
    "payload_estimator": {one.name for one in PAYLOAD_ESTIMATOR},
    "recorder": set(),
    "player": set(),
    "robot_state_publisher": set(),
}


def calls(tree: ast.AST, name: str) -> Iterator[ast.Call]:
    for node in ast.walk(tree):
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == name:
            yield node


def keywords(call: ast.Call) -> dict[str, ast.expr]:
    return {one.arg: one.value for one in call.keywords if one.arg}


def text(node: ast.expr) -> str:
    value = ast.literal_eval(node)
    assert isinstance(value, str)
    return value


def dictionaries(path: Path) -> dict[str, set[str]]:
    """Keys of the dictionaries of text that a file states, by name; some are unions of others."""
    found: dict[str, set[str]] = (
        {} if path == SHARED else {"COMMON": dictionaries(SHARED)["COMMON"]}
    )

    def keys(node: ast.expr) -> set[str]:
        if isinstance(node, ast.BinOp):
            return keys(node.left) | keys(node.right)
        return found[node.id] if isinstance(node, ast.Name) else set(ast.literal_eval(node))

    for node in ast.parse(path.read_text()).body:
        if isinstance(node, ast.Assign) and isinstance(node.value, ast.Dict | ast.BinOp):
            found[ast.unparse(node.targets[0])] = keys(node.value)
    return found


def declared(path: Path) -> set[str]:
    """The arguments of a launch file."""
    return dictionaries(path)["ARGUMENTS"]


@pytest.fixture(params=FILES, ids=NAMES)
def path(request: pytest.FixtureRequest) -> Path:
    return request.param


def test_each_takes_namespace_parameter_file_log_level_and_prefix(path: Path) -> None:
    assert {"namespace", "parameters", "log_level", "prefix"} <= declared(path)


def test_every_package_with_nodes_has_one() -> None:
    assert NAMES == [
        "driver",
        "identification",
        "trajectory",
        "observer",
        "demo",
        "simulated_crane",
    ]


def test_it_is_installed(path: Path) -> None:
    share = Path(get_package_share_directory(path.parents[1].name))
    assert (share / "launch" / path.name).read_text() == path.read_text()


def test_executables_and_their_parameters_exist(path: Path) -> None:
    tree = ast.parse(path.read_text())
    started = [*calls(tree, "node"), *calls(tree, "ExecutableInPackage")]
    for call in started:
        given = keywords(call)
        package, name = text(given["package"]), text(given["executable"])
        assert os.access(Path(get_package_prefix(package)) / "lib" / package / name, os.X_OK)
        if parameters := given.get("parameters"):
            for one in ast.walk(parameters):
                if isinstance(one, ast.Dict):
                    names = {text(key) for key in one.keys if key}
                    assert names <= DECLARED[name] | OF_EVERY_NODE
    assert started or path.name == "demo.launch.py"


def test_every_argument_that_is_used_is_declared_and_every_declared_one_used(path: Path) -> None:
    tree, source = ast.parse(path.read_text()), path.read_text()
    for call in calls(tree, "LaunchConfiguration"):
        if isinstance(call.args[0], ast.Constant):
            assert text(call.args[0]) in declared(path)
    for name in declared(path):
        known = dictionaries(path)
        unpacked = [keys for one, keys in known.items() if f"*{one}" in source] + [known["COMMON"]]
        assert source.count(f'"{name}"') > 1 or any(name in keys for keys in unpacked), name


def test_launch_files_that_are_included_exist_and_take_what_they_are_given() -> None:
    handed_on = 0
    for path in FILES:
        known = dictionaries(path)
        for call in calls(ast.parse(path.read_text()), "included"):
            package, file, *arguments = call.args
            share = Path(get_package_share_directory(text(package)))
            taken = declared(share / "launch" / text(file))
            for one in arguments:
                starred = isinstance(one, ast.Starred)
                assert (known[ast.unparse(one.value)] if starred else {text(one)}) <= taken
                handed_on += 1
    assert handed_on == 6


@pytest.mark.realtime
def test_the_whole_suite_starts_and_ends(ros_domain: int, tmp_path: Path) -> None:
    """Every node runs, Ctrl-C ends all of them well and leaves a closed bag."""
    if not importlib.util.find_spec("ros2launch"):
        pytest.skip("no ros2 launch here: ROS as Python packages comes without it")
    output = tmp_path / "output"
    arguments = [f"bus_options:=port={free_port()}", f"record:={tmp_path / 'bag'}"]
    with output.open("w") as file:
        process = subprocess.Popen(
            ["ros2", "launch", "crane_sim", "demo.launch.py", *arguments],
            stdout=file,
            stderr=subprocess.STDOUT,
        )
    until = time.monotonic() + PATIENCE
    needed = ("offline -> disabled", "recording /generalized_forces", "recording /joint_reference")
    try:
        while not all(one in output.read_text() for one in needed):
            assert process.poll() is None and time.monotonic() < until, output.read_text()
            time.sleep(0.1)
    finally:
        process.send_signal(signal.SIGINT)
        process.wait(PATIENCE)
    assert output.read_text().count("process has finished cleanly") == 5, output.read_text()
    assert (tmp_path / "bag" / "metadata.yaml").exists()
