"""The virtual environment and the pinned packages in it."""

import ast
import hashlib
import os
import re
import shutil
import subprocess
import sys
import venv
from dataclasses import dataclass
from pathlib import Path

from machine import Machine, SetupError, failure


@dataclass(frozen=True)
class Part:
    """Packages that are installed together."""

    purpose: str
    download: int  # MB, if no cache has them: tests/benchmarks/test_set_up_size.py measures it
    time: str  # beside the download


CORE = Part("the suite and ROS 2 Jazzy", 300, "20 s to 1 min")
WITH_ROS = Part("the suite and its tests, next to the installed ROS", 415, "20 s to 1 min")
EXTRAS = {
    "benchmark": Part("the benchmark of diagnoses", 5, "5 s"),
    "docs": Part("the manual", 40, "5 to 10 s"),
    "pictures": Part("pictures of the crane", 45, "5 to 10 s"),
    "tables": Part("tables", 55, "5 to 10 s"),
    "test": Part("the tests", 195, "10 to 40 s"),
    "view": Part("the live view", 255, "5 to 10 s"),
}
# Settings of pip (files or environment) that uv knows by other names.
PIP_TO_UV = {
    "index-url": "UV_DEFAULT_INDEX",
    "extra-index-url": "UV_INDEX",
    "find-links": "UV_FIND_LINKS",
    "trusted-host": "UV_INSECURE_HOST",
    "cert": "SSL_CERT_FILE",
    "proxy": "ALL_PROXY",
}
# /opt/python/cp311-cp311/include/python3.11 and .../numpy/_core/include below the same folder
FOREIGN_INCLUDE = re.compile(
    r"/opt/python/[^;\"\s]*?/(?:(?P<numpy>numpy/_core/include)|include/python3\.\d+)"
)


def stamp_file(machine: Machine) -> Path:
    """Written last, so that an interrupted installation is taken up again."""
    return machine.venv / "crane-packages"


def wanted_stamp(machine: Machine) -> str:
    """What the stamp says when the environment is up to date."""
    return _stamp(machine, pins(machine))


def pins(machine: Machine) -> list[str]:
    """Return the pinned requirements for this kind of machine, one a line."""
    if machine.ros_installed:
        return _read(machine, "requirements-apt.txt")
    return _read(machine, "requirements.txt", "requirements-dev.txt", "requirements-ros.txt")


def install_extra(machine: Machine, extra: str) -> None:
    """Add what only an extra needs to the environment, unless it is there.

    `SetupError` if there is no such extra, or none of it beside an installed ROS.
    """
    if extra not in EXTRAS:
        raise SetupError(f"no extra '{extra}'; there are {', '.join(EXTRAS)}")
    if machine.ros_installed and extra in ("benchmark", "pictures", "tables", "test"):
        return  # there with all others, since they have to agree with that ROS
    if machine.ros_installed and extra == "view":
        raise SetupError(
            "Rerun needs numpy 2, which conflicts with an installed ROS 2 Jazzy; view bags from a "
            "clone that was set up without ROS"
        )
    # gone with the environment when that is made anew
    stamp = machine.venv / f"crane-packages-{extra}"
    wanted = _read(machine, f"requirements-{extra}.txt")
    if stamp.is_file() and stamp.read_text() == _stamp(machine, wanted):
        return
    _install_pins(machine, wanted, EXTRAS[extra])
    stamp.write_text(_stamp(machine, wanted))


def _stamp(machine: Machine, wanted: list[str]) -> str:
    digest = hashlib.sha256("\n".join(wanted).encode()).hexdigest()
    return f"{machine.describe()}{digest}\n"


def _read(machine: Machine, *names: str) -> list[str]:
    lines = {
        line
        for name in names
        for line in (machine.root / name).read_text().splitlines()
        if not line.startswith("#")
    }
    return sorted(lines)


def up_to_date(machine: Machine) -> bool:
    """Whether the environment holds what the requirement files say."""
    stamp = stamp_file(machine)
    return stamp.is_file() and stamp.read_text() == wanted_stamp(machine)


def install(machine: Machine) -> None:
    """Make or repair the virtual environment and install the pinned packages."""
    stamp_file(machine).unlink(missing_ok=True)
    if not _usable(machine):
        print("set-up: virtual environment .venv: usually 5 to 15 s", flush=True)
        for folder in ("build", "install", "log"):  # built for another environment
            shutil.rmtree(machine.root / folder, ignore_errors=True)
        venv.create(
            machine.venv,
            clear=True,
            symlinks=True,
            with_pip=True,
            system_site_packages=machine.ros_installed,
        )
    _install_pins(machine, pins(machine), WITH_ROS if machine.ros_installed else CORE)
    if not machine.ros_installed:
        repair_include_folders(machine)
    stamp_file(machine).write_text(wanted_stamp(machine))


def _usable(machine: Machine) -> bool:
    """Whether the environment there is of this clone, this Python and this kind of machine."""
    try:
        text = (machine.venv / "pyvenv.cfg").read_text()
        configuration = dict(line.split(" = ", 1) for line in text.splitlines() if " = " in line)
        runs = subprocess.run([machine.venv_python, "-m", "pip", "--version"], capture_output=True)
    except OSError:
        return False
    version = f"{sys.version_info.major}.{sys.version_info.minor}."
    system_packages = configuration.get("include-system-site-packages")
    return (
        runs.returncode == 0
        and configuration.get("version", "").startswith(version)
        and system_packages == str(machine.ros_installed).lower()
        and configuration.get("command", "").endswith(f" {machine.venv}")
    )


def _install_pins(machine: Machine, wanted: list[str], part: Part) -> None:
    print(
        f"set-up: {len(wanted)} Python packages for {part.purpose}: downloads up to "
        f"{part.download} MB, then usually {part.time}",
        flush=True,
    )
    requirements = machine.venv / "crane-requirements.txt"
    requirements.write_text("\n".join(wanted) + "\n")
    quiet = [] if sys.stderr.isatty() else ["--quiet"]  # progress is for people
    pip = [str(machine.venv_python), "-m", "pip", "--disable-pip-version-check"]
    uv = [str(machine.venv / "bin" / "uv"), "pip"]

    uv_pin = next(pin for pin in pins(machine) if pin.startswith("uv=="))
    environment = machine.environment()
    subprocess.run([*pip, "install", "--quiet", uv_pin], env=environment)
    # Compiled now: where Python may not write bytecode, every start of a node would pay for it.
    # Not `sync`: the wheels of ROS carry metadata of packages that no pin names, and it would
    # remove their modules from an environment that is brought up to date.
    install = ["install", "--no-deps", *quiet, "--requirement", str(requirements)]
    done = subprocess.run(
        [*uv, *install, "--compile-bytecode"], env=environment | uv_settings(pip, environment)
    )
    if done.returncode:
        print("set-up: uv could not install the packages, pip tries (minutes)", flush=True)
        log = machine.venv / "crane-pip.log"
        log.unlink(missing_ok=True)  # pip appends
        done = subprocess.run([*pip, *install, "--log", str(log)], env=environment)
        if done.returncode:
            raise SetupError(
                failure(
                    f"the Python packages for {part.purpose} could not be installed",
                    log,
                    "the same command again, if the network failed; pip config list shows the "
                    "package index and the proxy",
                )
            )


def uv_settings(pip: list[str], environment: dict[str, str]) -> dict[str, str]:
    """Return pip's settings as uv's variables, so that both ask the same package index.

    Variables that are set already win. Local folders that do not exist are left out, as pip does.
    """
    listing = subprocess.run([*pip, "config", "list"], env=environment, capture_output=True)
    settings: dict[str, list[str]] = {}
    lines = listing.stdout.decode().splitlines()
    for section in ("global.", "install.", ":env:."):  # the later wins
        for line in lines:
            if line.startswith(section):
                name, _, value = line.removeprefix(section).partition("=")
                settings[name] = ast.literal_eval(value).split()
    variables = {
        variable: ("," if variable == "UV_FIND_LINKS" else " ").join(
            place for place in settings[name] if _exists(place)
        )
        for name, variable in PIP_TO_UV.items()
        if name in settings and variable not in os.environ
    }
    if "UV_INDEX" in variables:  # pip takes the best version of all indexes, uv the first index
        variables.setdefault("UV_INDEX_STRATEGY", "unsafe-best-match")
    return {name: value for name, value in variables.items() if value}


def _exists(place: str) -> bool:
    path = place.removeprefix("file://")
    return not path.startswith("/") or Path(path).exists()


def repair_include_folders(machine: Machine) -> None:
    """Let the CMake targets of the ROS wheels name the includes of this Python and its numpy.

    They name folders of the machine that built them.
    """
    query = (
        "import numpy, sysconfig; print(sysconfig.get_path('include')); print(numpy.get_include())"
    )
    answer = subprocess.run(
        [machine.venv_python, "-c", query], capture_output=True, text=True, check=True
    )
    python_include, numpy_include = answer.stdout.splitlines()
    for path in machine.venv.glob("share/*/cmake/*.cmake"):
        text = path.read_text()
        repaired = FOREIGN_INCLUDE.sub(
            lambda m: numpy_include if m["numpy"] else python_include, text
        )
        if repaired != text:
            # uv links files from its cache: write a new file, never into the shared one.
            path.unlink()
            path.write_text(repaired)
