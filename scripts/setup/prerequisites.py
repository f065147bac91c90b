"""What must be there before: each thing that is missing becomes one line with its remedy."""

import importlib.util
import os
import platform
import shutil
import subprocess
import sys
import sysconfig
from pathlib import Path

from machine import Machine, SetupError


def check(machine: Machine) -> None:
    """Raise SetupError with one line for everything that is missing on this machine."""
    if missing := _unsupported(machine) or _missing_tools() + _missing_ros(machine):
        raise SetupError(*missing)


def _unsupported(machine: Machine) -> list[str]:
    if machine.ros_installed:
        running = sys.version_info
        if running < (3, 13):
            return []
        return [  # requirements-apt.txt holds numpy 1, which ends at 3.12
            f"ROS_DISTRO=jazzy comes with Python 3.12, this is {platform.python_version()} "
            f"({sys.executable}); name the Python of ROS: make PYTHON=/usr/bin/python3"
        ]
    found = f"{platform.system()} on {platform.machine()}"
    if (platform.system(), platform.machine()) != ("Linux", "x86_64"):
        return [
            f"ROS 2 Jazzy comes as packages for Linux on x86_64 only, this is {found}; "
            "install ROS 2 Jazzy itself and source its setup.bash, then call again"
        ]
    library, version = platform.libc_ver()
    if library != "glibc" or tuple(int(n) for n in version.split(".")) < (2, 28):
        return [
            "ROS 2 Jazzy comes as packages for glibc 2.28 or newer, this is "
            f"{library or 'another C library'} {version}; use Debian 10, Ubuntu 20.04 or newer"
        ]
    return []


def _missing_tools() -> list[str]:
    missing = []
    python = f"python{sys.version_info.major}.{sys.version_info.minor}"
    if importlib.util.find_spec("ensurepip") is None or importlib.util.find_spec("venv") is None:
        missing.append(f"{sys.executable} has no venv; install {python}-venv")
    if not Path(sysconfig.get_path("include"), "Python.h").is_file():
        missing.append(f"{sys.executable} has no Python.h; install {python}-dev")
    if not any(shutil.which(name) for name in (os.environ.get("CXX", "c++"), "g++", "clang++")):
        missing.append("no C++ compiler on PATH; install g++")
    if not any(shutil.which(name) for name in (os.environ.get("CC", "cc"), "gcc", "clang")):
        missing.append("no C compiler on PATH; install gcc")
    if not shutil.which("make"):
        missing.append("no make on PATH; install make")
    return missing


def _missing_ros(machine: Machine) -> list[str]:
    """On a machine with ROS: the parts of it that the suite needs."""
    if not machine.ros_installed:
        return []
    missing = []
    imports = "import rclpy, sensor_msgs, diagnostic_msgs, std_srvs, numpy"
    if subprocess.run([sys.executable, "-c", imports], capture_output=True).returncode:
        missing.append(
            f"ROS_DISTRO=jazzy, but {sys.executable} cannot import rclpy and its messages; "
            "source /opt/ros/jazzy/setup.bash, or install ros-jazzy-ros-base"
        )
    prefixes = os.environ.get("AMENT_PREFIX_PATH", "").split(":")
    index = "share/ament_index/resource_index/packages"
    for package in ("ament_cmake", "rosidl_default_generators"):
        if not any(Path(prefix, index, package).exists() for prefix in prefixes):
            name = package.replace("_", "-")
            missing.append(f"ROS package {package} is missing; install ros-jazzy-{name}")
    if not shutil.which("cmake"):
        missing.append("no cmake on PATH; install cmake")
    return missing
