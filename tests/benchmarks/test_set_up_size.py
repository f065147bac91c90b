"""A fresh clone is set up as `make setup` does it: what that downloads, and takes on the disk."""

import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import packages
import pytest

ROOT = Path(__file__).resolve().parents[2]
MADE = (".venv", "build", "install")
MEGABYTE = 2**20  # bytes, as `du -m` counts
MOST = 1200.0  # MB
OF_A_SHELL = ("HOME", "LANG", "USER", "TMPDIR")


def allocated(folder: Path) -> float:
    """What `du -m` tells [MB]."""
    done = subprocess.run(["du", "-sk", folder], capture_output=True, text=True, check=True)
    return int(done.stdout.split()[0]) * 1024 / MEGABYTE


@pytest.mark.skipif("ROS_DISTRO" in os.environ, reason="beside an installed ROS all comes at once")
def test_a_set_up_without_extras_is_not_large(
    tmp_path: Path, measured: Callable[..., None]
) -> None:
    clone = tmp_path / "clone"
    subprocess.run(["git", "clone", "--quiet", ROOT, clone], check=True)
    settings = ("UV_", "PIP_", "SSL_", "PYTHON", "HTTP", "http", "NO_PROXY", "no_proxy")
    environment = {
        name: value
        for name, value in os.environ.items()
        if (name in OF_A_SHELL or name.startswith(settings)) and name != "PYTHONPATH"
    } | {"PATH": os.defpath}
    try:
        subprocess.run([clone / "scripts" / "setup.sh"], env=environment, check=True)
        sizes = {name: allocated(clone / name) for name in MADE}
    finally:
        shutil.rmtree(clone)
    whole = sum(sizes.values())
    measured(
        "a fresh set-up, without extras: the whole; packages; build",
        "1200 MB",
        "{whole:.0f}; {packages:.0f}; {built:.0f} MB",
        whole=whole,
        packages=sizes[".venv"],
        built=whole - sizes[".venv"],
    )
    assert whole <= MOST


@pytest.mark.skipif("ROS_DISTRO" in os.environ, reason="beside an installed ROS all comes at once")
@pytest.mark.parametrize("extra", ["", *packages.EXTRAS])
def test_what_the_set_up_says_of_a_download_holds(
    extra: str, tmp_path: Path, measured: Callable[..., None]
) -> None:
    part = packages.EXTRAS[extra] if extra else packages.CORE
    names = [f"-{extra}"] if extra else ["", "-dev", "-ros"]
    pip = [sys.executable, "-m", "pip", "download", "--quiet", "--no-deps", "--dest", tmp_path]
    for name in names:
        pip += ["--requirement", ROOT / f"requirements{name}.txt"]
    subprocess.run(pip, check=True)
    size = sum(path.stat().st_size for path in tmp_path.iterdir()) / 1e6
    measured(
        f"packages for {part.purpose}: download", f"{part.download} MB", "{size:.0f} MB", size=size
    )
    assert 0.9 * part.download <= size <= part.download
