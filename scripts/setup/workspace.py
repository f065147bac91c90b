"""`colcon build` of the packages and compiled functions, and whether they have to be made again."""

import hashlib
import os
import re
import subprocess
from pathlib import Path

import packages
from machine import Machine, SetupError, failure


def _package_folders(machine: Machine) -> list[Path]:
    return sorted(
        path.parent
        for pattern in ("crane_*/package.xml", "src/*/package.xml")
        for path in machine.root.glob(pattern)
    )


def _inputs(machine: Machine) -> list[Path]:
    """Files that the build reads. Python modules and their data are linked, not copied."""
    return sorted(
        path
        for package in _package_folders(machine)
        for path in package.rglob("*")
        if path.is_file()
        and not path.is_relative_to(package / package.name)
        and not path.is_relative_to(package / "build")  # of pip
        and not any(part.endswith((".egg-info", "__pycache__")) for part in path.parts)
    )


def _linked_data(machine: Machine) -> list[Path]:
    """Data files in the packages: the build makes a link to each that is there."""
    return sorted(
        path
        for package in _package_folders(machine)
        for path in (package / package.name).rglob("*")
        if path.suffix in (".yaml", ".dbc")
    )


def _wanted(machine: Machine) -> str:
    digest = hashlib.sha256(packages.stamp_file(machine).read_bytes())
    for path in _linked_data(machine):
        digest.update(f"{path.relative_to(machine.root)}\n".encode())
    for path in _inputs(machine):
        digest.update(f"{path.relative_to(machine.root)}\n".encode() + path.read_bytes())
    return digest.hexdigest()


def _stamp(machine: Machine) -> Path:
    return machine.root / "install" / "crane-build"


def up_to_date(machine: Machine) -> bool:
    """Whether the installed tree was built from the present files."""
    stamp = _stamp(machine)
    return stamp.is_file() and stamp.read_text() == _wanted(machine)


def forget_compiled(machine: Machine) -> None:
    """Delete what numba has compiled where a source of it has changed since.

    Numba looks at the file of a function alone, not at those of functions that it calls: of these,
    callers would go on with the code of before.
    """
    sources = [
        path
        for package in _package_folders(machine)
        for path in sorted((package / package.name).rglob("*.py"))
        if b"njit" in path.read_bytes()
    ]
    digest = hashlib.sha256(b"".join(path.read_bytes() for path in sources)).hexdigest()
    stamp = machine.root / "install" / "crane-compiled"
    if stamp.is_file() and stamp.read_text() == digest:
        return
    for folder in {path.parent / "__pycache__" for path in sources}:
        for compiled in folder.glob("*.nb[ic]"):
            compiled.unlink(missing_ok=True)
    stamp.write_text(digest)


def build(machine: Machine) -> None:
    """Run `colcon build`; SetupError if it fails."""
    number = len(_package_folders(machine))
    print(
        f"set-up: colcon builds {number} packages, usually 30 s to 1 min",
        flush=True,
    )
    _stamp(machine).unlink(missing_ok=True)
    # No optimising build type: only generated message code is compiled, and that takes twice as
    # long with it. Log level: the wheels lack setup files, which colcon would remark every time.
    command = [str(machine.venv_python), "-m", "colcon", "--log-level", "error", "build"]
    command += ["--symlink-install", "--cmake-args", "-DBUILD_TESTING=OFF"]
    command += [f"-DPython3_EXECUTABLE={machine.venv_python}"]
    command += [f"-DPYTHON_ONLY={'OFF' if machine.ros_installed else 'ON'}"]
    jobs = {"MAKEFLAGS": f"-j{os.cpu_count()}"}  # else colcon adds a limit by load: one job at once
    done = subprocess.run(command, cwd=machine.root, env=machine.environment() | jobs)
    if done.returncode:
        raise SetupError(_failure(machine.root / "log" / "latest_build"))
    _stamp(machine).write_text(_wanted(machine))


def _failure(log: Path) -> str:
    """Return the text about the build that failed: which package, and why."""
    events = log / "events.log"
    text = events.read_text() if events.is_file() else ""
    if not (failed := re.search(r"'identifier': '(\w+)', 'rc': (?!0|'SIGINT')", text)):
        return "colcon build failed; the lines above say why"
    return failure(
        f"colcon build failed in {failed[1]}",
        log / failed[1] / "stdout_stderr.log",
        "make clean, then the same command again",
    )
