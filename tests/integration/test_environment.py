"""The shell that scripts/env.sh gives, and the set-up that has nothing to do."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import packages
import pytest
import workspace
from machine import Machine

from crane_nodes.this_computer import DISCOVERY_RANGE, MIDDLEWARE, PROFILES, variables

ROOT = Path(__file__).resolve().parents[2]
PACKAGES = [
    *("crane_bags", "crane_driver", "crane_identification", "crane_interfaces", "crane_model"),
    *("crane_nodes", "crane_sim", "crane_trajectory"),
]
SHELLS = {"bash": ["bash", "--norc", "-c"], "zsh": ["zsh", "-f", "-c"]}


def fresh_environment() -> dict[str, str]:
    """What a login shell has, with an installed ROS sourced where there is one."""
    kept = ["HOME", "LANG", "TMPDIR"]
    if Machine.this(ROOT).ros_installed:
        kept += ["ROS_DISTRO", "AMENT_PREFIX_PATH", "PYTHONPATH", "LD_LIBRARY_PATH"]
    variables = {name: os.environ[name] for name in kept if name in os.environ}
    outside = [p for p in os.environ["PATH"].split(":") if not Path(p).is_relative_to(ROOT)]
    return variables | {"PATH": ":".join(outside)}


@pytest.mark.parametrize("shell", SHELLS)
def test_sourced_shell_runs_the_suite(shell: str, tmp_path: Path) -> None:
    if shutil.which(shell) is None:
        pytest.skip(f"no {shell} on this machine")
    script = f"""
        source '{ROOT}/scripts/env.sh' && source '{ROOT}/scripts/env.sh' || exit 1
        ros2 pkg executables || exit 1
        python - <<'EOF'
import os, sys
import rclpy, crane_interfaces.msg, {", ".join(PACKAGES)}
prefixes = os.environ["AMENT_PREFIX_PATH"].split(":")
print("python", sys.prefix)
print("sourced twice", len(prefixes) == len(set(prefixes)))
EOF
        """
    done = subprocess.run(
        [*SHELLS[shell], script],
        cwd=tmp_path,
        env=fresh_environment(),
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr
    lines = done.stdout.splitlines()
    assert f"python {ROOT / '.venv'}" in lines
    assert "sourced twice True" in lines
    assert "crane_trajectory design" in lines


def sourced(shell: dict[str, str], then: str = "true") -> dict[str, str]:
    """Variables about who is found, after env.sh was sourced, something done, and sourced again."""
    script = f"source '{ROOT}/scripts/env.sh' && {then} && source '{ROOT}/scripts/env.sh' && env"
    done = subprocess.run(
        ["bash", "--norc", "-c", script],
        env=fresh_environment() | shell,
        capture_output=True,
        text=True,
        check=True,
    )
    found = dict(line.split("=", 1) for line in done.stdout.splitlines() if "=" in line)
    return {name: found[name] for name in (DISCOVERY_RANGE, MIDDLEWARE, PROFILES) if name in found}


@pytest.mark.parametrize(
    "shell",
    [
        {},
        {MIDDLEWARE: ""},
        {DISCOVERY_RANGE: "LOCALHOST"},
        {MIDDLEWARE: "rmw_cyclonedds_cpp"},
        {PROFILES: "/etc/other.xml"},
    ],
    ids=str,
)
def test_nodes_of_other_computers_are_not_seen(shell: dict[str, str]) -> None:
    found = sourced(shell)
    if "other.xml" in found.get(PROFILES, ""):
        del found[PROFILES]
    assert found == variables(shell)


def test_unless_the_shell_asks_for_them() -> None:
    asked = {DISCOVERY_RANGE: "SUBNET", MIDDLEWARE: "rmw_fastrtps_cpp"}
    assert sourced({DISCOVERY_RANGE: "SUBNET"}) == asked
    assert sourced({}, f"export {DISCOVERY_RANGE}=SUBNET") == asked


def test_another_middleware_is_kept_to_this_computer_too() -> None:
    other = {MIDDLEWARE: "rmw_cyclonedds_cpp"}
    assert sourced({}, f"export {MIDDLEWARE}={other[MIDDLEWARE]}") == variables(other)


def test_a_set_up_without_the_profile_is_refused(tmp_path: Path) -> None:
    """Fast DDS would say an error, and use every network."""
    for folder in ("scripts", "install"):
        (tmp_path / folder).mkdir()
    shutil.copy(ROOT / "scripts" / "env.sh", tmp_path / "scripts")
    (tmp_path / "install" / "crane-build").touch()
    done = subprocess.run(
        ["bash", "--norc", "-c", f"source '{tmp_path}/scripts/env.sh'"],
        env=fresh_environment(),
        capture_output=True,
        text=True,
    )
    assert done.returncode == 1
    assert done.stderr.startswith("error: the suite is not set up; run: make -C")


def test_executables_of_the_suite_run_in_the_virtual_environment() -> None:
    """Their first line names the interpreter that has the pinned packages."""
    scripts = [p for p in (ROOT / "install").glob("crane_*/lib/crane_*/*") if p.is_file()]
    assert scripts
    for script in scripts:
        assert script.read_text().splitlines()[0] == f"#!{ROOT / '.venv' / 'bin' / 'python'}"


def test_second_set_up_does_nothing_at_once() -> None:
    machine = Machine.this(ROOT)
    assert packages.up_to_date(machine) and workspace.up_to_date(machine), "run: make setup"
    before = os.times()
    done = subprocess.run(
        ["sh", ROOT / "scripts" / "setup.sh"],
        env=os.environ | {"PYTHON": sys.executable},
        capture_output=True,
    )
    assert (done.returncode, done.stdout, done.stderr) == (0, b"", b"")
    after = os.times()
    spent = after.children_user + after.children_system
    assert spent - before.children_user - before.children_system < 2.0  # s, of the processor
