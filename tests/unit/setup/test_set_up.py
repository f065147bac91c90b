"""The set-up says what is missing, and does no work twice."""

import os
import platform
import shutil
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path

import packages
import prerequisites
import pytest
import workspace
from machine import Machine, SetupError

ROOT = Path(__file__).resolve().parents[3]
BASE_PYTHON = sys._base_executable  # the interpreter below the virtual environment


@pytest.fixture
def clone(tmp_path: Path) -> Path:
    """A clone in which nothing is set up yet."""
    root = tmp_path / "clone"
    shutil.copytree(ROOT / "scripts", root / "scripts", ignore=shutil.ignore_patterns("__py*"))
    for path in [ROOT / "Makefile", *ROOT.glob("requirements*.txt")]:
        shutil.copy(path, root)
    return root


@pytest.fixture
def tools(tmp_path: Path) -> Path:
    """A folder for PATH with what the shell script itself uses and no Python and no compiler."""
    folder = tmp_path / "tools"
    folder.mkdir()
    for name in ("sh", "dirname"):
        (folder / name).symlink_to(str(shutil.which(name)))
    return folder


def set_up(clone: Path, path: Path, variables: Mapping[str, str] = {}) -> list[str]:
    """Call the set-up with this PATH and these variables alone; its error lines."""
    done = subprocess.run(
        ["sh", str(clone / "scripts" / "setup.sh")],
        env={"PATH": str(path), "HOME": str(path), **variables},
        executable=shutil.which("sh"),
        capture_output=True,
        text=True,
    )
    assert done.returncode == 1
    assert not (clone / ".venv").exists()
    lines = done.stderr.splitlines()
    assert all(line.startswith("error: ") for line in lines), done.stderr
    return lines


def fake_python(folder: Path, version: str) -> None:
    program = folder / "python3"
    program.write_text(f'#!/bin/sh\n[ "$1" = --version ] && echo Python {version} || exit 1\n')
    program.chmod(0o755)


def test_no_python(clone: Path, tools: Path) -> None:
    (line,) = set_up(clone, tools)
    assert "found no python3" in line
    assert "install python3 python3-venv python3-dev" in line


def test_old_python(clone: Path, tools: Path) -> None:
    fake_python(tools, "3.9.2")
    (line,) = set_up(clone, tools)
    assert "CPython 3.11 to 3.14 is needed, found Python 3.9.2" in line


def test_python_named_by_the_user(clone: Path, tools: Path) -> None:
    (line,) = set_up(clone, tools, {"PYTHON": "snake"})
    assert "PYTHON=snake is not a program" in line
    fake_python(tools, "3.10.1")
    (line,) = set_up(clone, tools, {"PYTHON": "python3"})
    assert "PYTHON=python3 is Python 3.10.1; CPython 3.11 to 3.14 is needed" in line


def test_compilers_and_make(clone: Path, tools: Path) -> None:
    lines = set_up(clone, tools, {"PYTHON": BASE_PYTHON})
    assert [line.rpartition("; ")[2] for line in lines] == [
        "install g++",
        "install gcc",
        "install make",
    ]


def test_another_ros_is_refused(clone: Path, tools: Path) -> None:
    (line,) = set_up(clone, tools, {"PYTHON": BASE_PYTHON, "ROS_DISTRO": "humble"})
    assert "ROS_DISTRO=humble is sourced; the suite runs on ROS 2 Jazzy" in line


def test_installed_ros_that_lacks_parts(clone: Path, tools: Path) -> None:
    lines = set_up(clone, tools, {"PYTHON": BASE_PYTHON, "ROS_DISTRO": "jazzy"})
    (line,) = (line for line in lines if "ROS_DISTRO=jazzy, but" in line)
    assert "install ros-jazzy-ros-base" in line
    assert any("install ros-jazzy-rosidl-default-generators" in line for line in lines)


def wheels_machine(root: Path) -> Machine:
    return Machine(root, ros_installed=False)


@pytest.mark.parametrize(
    ("function", "value", "message"),
    [
        ("machine", "aarch64", "this is Linux on aarch64"),
        ("system", "Darwin", "this is Darwin on x86_64"),
        ("libc_ver", ("glibc", "2.27"), "this is glibc 2.27"),
        ("libc_ver", ("", ""), "this is another C library"),
    ],
)
def test_machine_without_wheels(
    function: str, value: object, message: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name, supported in (("machine", "x86_64"), ("system", "Linux")):
        monkeypatch.setattr(platform, name, lambda supported=supported: supported)
    monkeypatch.setattr(platform, function, lambda: value)
    with pytest.raises(SetupError) as caught:
        prerequisites.check(wheels_machine(tmp_path))
    (line,) = caught.value.args
    assert message in line


@pytest.mark.parametrize(
    ("part", "package"), [("ensurepip", "-venv"), ("Python.h", "-dev")], ids=["venv", "dev"]
)
def test_incomplete_python(
    part: str, package: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    find_spec = prerequisites.importlib.util.find_spec
    if part == "ensurepip":
        monkeypatch.setattr(
            prerequisites.importlib.util,
            "find_spec",
            lambda name: None if name == part else find_spec(name),
        )
    else:
        monkeypatch.setattr(prerequisites.sysconfig, "get_path", lambda name: str(tmp_path))
    with pytest.raises(SetupError) as caught:
        prerequisites.check(wheels_machine(tmp_path))
    version = f"python{sys.version_info.major}.{sys.version_info.minor}"
    (line,) = caught.value.args
    assert part.replace("ensurepip", "venv") in line
    assert f"install {version}{package}" in line


def test_uv_is_told_what_pip_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    here = tmp_path / "wheels"
    here.mkdir()
    configuration = tmp_path / "pip.conf"
    configuration.write_text(
        "[global]\n"
        "index-url = https://packages.invalid/simple\n"
        f"find-links = {here} {tmp_path / 'absent'}\n"
        "extra-index-url =\n    https://one.invalid/simple\n    https://two.invalid/simple\n"
        "cert = /somewhere/ca.pem\n"
    )
    for name in list(os.environ):
        if name.startswith(("PIP_", "UV_", "SSL_")):
            monkeypatch.delenv(name)
    monkeypatch.setenv("PIP_CONFIG_FILE", str(configuration))
    monkeypatch.setenv("PIP_INDEX_URL", "https://wins.invalid/simple")
    monkeypatch.setenv("SSL_CERT_FILE", "/set/already.pem")

    variables = packages.uv_settings([sys.executable, "-m", "pip"], dict(os.environ))

    assert variables["UV_DEFAULT_INDEX"] == "https://wins.invalid/simple"
    assert variables["UV_INDEX"] == "https://one.invalid/simple https://two.invalid/simple"
    assert variables["UV_FIND_LINKS"] == str(here)
    assert variables["UV_INDEX_STRATEGY"] == "unsafe-best-match"
    assert "SSL_CERT_FILE" not in variables


def test_installed_ros_keeps_its_numpy(clone: Path) -> None:
    with_ros = packages.pins(Machine(clone, ros_installed=True))
    assert [pin for pin in with_ros if pin.startswith("numpy==1.")]
    assert not any(pin.startswith("ros-") for pin in with_ros)
    assert any(pin.startswith("ros-jazzy-rclpy==") for pin in packages.pins(wheels_machine(clone)))


def test_what_an_extra_needs_is_added_once(clone: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (clone / ".venv").mkdir()
    installed: list[str] = []
    monkeypatch.setattr(packages, "_install_pins", lambda _, wanted, __: installed.extend(wanted))
    for _ in range(2):
        packages.install_extra(wheels_machine(clone), "docs")
    assert len([pin for pin in installed if pin.startswith("furo==")]) == 1
    (clone / "requirements-docs.txt").write_text("furo==1.0\n")
    packages.install_extra(wheels_machine(clone), "docs")
    assert installed[-1] == "furo==1.0"
    with pytest.raises(SetupError, match="no extra 'snake'; there are benchmark, docs, pictures"):
        packages.install_extra(wheels_machine(clone), "snake")
    before = list(installed)
    packages.install_extra(Machine(clone, ros_installed=True), "test")
    assert installed == before
    with pytest.raises(SetupError, match="Rerun needs numpy 2"):
        packages.install_extra(Machine(clone, ros_installed=True), "view")


def test_installed_ros_with_another_python(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(prerequisites.sys, "version_info", (3, 13, 0))
    with pytest.raises(SetupError, match="ROS_DISTRO=jazzy comes with Python 3.12, this is"):
        prerequisites.check(Machine(tmp_path, ros_installed=True))


def test_include_folders_of_the_wheels_are_repaired(tmp_path: Path) -> None:
    import sysconfig

    import numpy

    exported = tmp_path / ".venv" / "share" / "some_msgs" / "cmake" / "targets.cmake"
    exported.parent.mkdir(parents=True)
    foreign = "/opt/python/cp312-cp312"
    exported.write_text(
        f'INCLUDES "${{PREFIX}}/include/some_msgs;{foreign}/include/python3.12;'
        f'{foreign}/lib/python3.12/site-packages/numpy/_core/include"'
    )
    shared = tmp_path / "in_the_package_cache"
    os.link(exported, shared)
    python = tmp_path / ".venv" / "bin" / "python"
    python.parent.mkdir()
    python.write_text(f'#!/bin/sh\nexec "{sys.executable}" "$@"\n')
    python.chmod(0o755)

    packages.repair_include_folders(wheels_machine(tmp_path))

    assert exported.read_text() == (
        f'INCLUDES "${{PREFIX}}/include/some_msgs;{sysconfig.get_path("include")};'
        f'{numpy.get_include()}"'
    )
    assert foreign in shared.read_text()  # uv links its cache into the environment


@pytest.mark.parametrize(
    ("change", "built"),
    [
        ("crane_thing/crane_thing/node.py", True),  # linked into the installed tree
        ("crane_thing/crane_thing/data/new.yaml", False),  # has no link yet
        ("crane_thing/setup.py", False),
        ("src/crane_other/msg/New.msg", False),
        (".venv/crane-packages", False),
        ("README.md", True),
    ],
)
def test_only_what_the_build_reads_asks_for_another_build(
    change: str, built: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("crane_thing/package.xml", "src/crane_other/package.xml", ".venv/crane-packages"):
        (tmp_path / name).parent.mkdir(parents=True)
        (tmp_path / name).write_text(name)
    (tmp_path / "install").mkdir()
    machine = wheels_machine(tmp_path)
    assert not workspace.up_to_date(machine)
    calls: list[str] = []

    def colcon(command: list[str], **_: object) -> subprocess.CompletedProcess[str]:
        calls.append(" ".join(command))
        return subprocess.CompletedProcess(command, 0)

    monkeypatch.setattr(workspace.subprocess, "run", colcon)
    workspace.build(machine)
    assert "colcon" in calls[0]
    assert workspace.up_to_date(machine)

    (tmp_path / change).parent.mkdir(parents=True, exist_ok=True)
    (tmp_path / change).write_text("changed")
    assert workspace.up_to_date(machine) is built


@pytest.mark.parametrize("ros_installed", [False, True])
def test_a_failed_build_says_what_failed_why_and_where_the_log_is(
    ros_installed: bool,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    log = tmp_path / "log" / "latest_build"
    (log / "crane_thing").mkdir(parents=True)
    (log / "events.log").write_text(
        "[1.0] (crane_other) JobEnded: {'identifier': 'crane_other', 'rc': 0}\n"
        "[2.0] (crane_third) JobEnded: {'identifier': 'crane_third', 'rc': 'SIGINT'}\n"
        "[2.0] (crane_thing) JobEnded: {'identifier': 'crane_thing', 'rc': 2}\n"
    )
    words = log / "crane_thing" / "stdout_stderr.log"
    words.write_text("long ago\n" + "no such header\n" * 10)

    def colcon(command: list[str], **_: object) -> subprocess.CompletedProcess[str]:
        assert f"-DPYTHON_ONLY={'OFF' if ros_installed else 'ON'}" in command
        return subprocess.CompletedProcess(command, 1)

    monkeypatch.setattr(workspace.subprocess, "run", colcon)
    with pytest.raises(SetupError) as caught:
        workspace.build(Machine(tmp_path, ros_installed))
    first, *why, remedy, place = str(caught.value).splitlines()
    assert "crane_thing" in first
    assert why == ["  no such header"] * 10
    assert remedy.startswith("try: ")
    assert place == f"log: {words}"
    assert "min" in capsys.readouterr().out


def test_callers_of_a_changed_function_are_compiled_anew(tmp_path: Path) -> None:
    machine = wheels_machine(tmp_path)
    package = tmp_path / "src" / "crane_fast"
    cache = package / "crane_fast" / "__pycache__"
    for folder in (cache, tmp_path / "install"):
        folder.mkdir(parents=True)
    (package / "package.xml").touch()
    called = package / "crane_fast" / "called.py"
    index, code = (cache / f"caller.calls-1.py311.{kind}" for kind in ("nbi", "1.nbc"))
    (package / "crane_fast" / "caller.py").write_text("@njit\ndef calls(): ...\n")

    def kept(text: str) -> bool:
        index.touch()
        code.touch()
        called.write_text(text)
        workspace.forget_compiled(machine)
        assert index.exists() == code.exists()
        return index.exists()

    first = "@njit\ndef called(): ...\n"
    assert not kept(first)
    assert kept(first)
    assert not kept(first.replace("...", "return 1"))


def test_changed_pins_ask_for_another_installation(clone: Path) -> None:
    machine = wheels_machine(clone)
    assert not packages.up_to_date(machine)
    machine.venv.mkdir()
    packages.stamp_file(machine).write_text(packages.wanted_stamp(machine))
    assert packages.up_to_date(machine)
    with (clone / "requirements.txt").open("a") as requirements:
        requirements.write("snake==1.0\n")
    assert not packages.up_to_date(machine)
