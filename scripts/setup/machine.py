"""What this machine offers: its ROS 2, its Python, and the places that the set-up fills."""

import os
import sys
from dataclasses import dataclass
from pathlib import Path

LAST = 10  # lines of a log that are shown


class SetupError(Exception):
    """The set-up cannot go on; every argument tells the user one fault, and what to do."""


def failure(what: str, log: Path, remedy: str) -> str:
    """Return the text about a failed step: last lines of its log, remedy, place of the log."""
    lines = log.read_text(errors="replace").splitlines()[-LAST:] if log.is_file() else []
    return "\n".join(
        [f"{what}; the last lines of its log:", *(f"  {line}" for line in lines)]
        + [f"try: {remedy}", f"log: {log}"]
    )


@dataclass(frozen=True)
class Machine:
    """The kind of machine and the folders of this clone."""

    root: Path
    ros_installed: bool  # ROS 2 Jazzy is installed and sourced; otherwise it comes as wheels

    @classmethod
    def this(cls, root: Path) -> "Machine":
        """Return this machine; SetupError if another ROS distribution than Jazzy is sourced."""
        distribution = os.environ.get("ROS_DISTRO", "")
        if distribution not in ("", "jazzy"):
            raise SetupError(
                f"ROS_DISTRO={distribution} is sourced; the suite runs on ROS 2 Jazzy: source "
                "/opt/ros/jazzy/setup.bash, or source no ROS at all to get Jazzy as packages"
            )
        return cls(root, ros_installed=distribution == "jazzy")

    @property
    def venv(self) -> Path:
        """Virtual environment of this clone."""
        return self.root / ".venv"

    @property
    def venv_python(self) -> Path:
        """Interpreter of the virtual environment."""
        return self.venv / "bin" / "python"

    def environment(self) -> dict[str, str]:
        """Environment variables for programs of the virtual environment, as if activated."""
        variables = dict(os.environ)
        variables["VIRTUAL_ENV"] = str(self.venv)
        variables["PATH"] = f"{self.venv / 'bin'}:{variables.get('PATH', os.defpath)}"
        if self.ros_installed:
            # An earlier build of this clone, if sourced, is not something to build upon.
            for name in ("AMENT_PREFIX_PATH", "CMAKE_PREFIX_PATH", "PYTHONPATH"):
                variables[name] = self._outside_clone(variables.get(name, ""))
        else:
            # The wheels make the virtual environment a ROS installation of its own.
            variables["AMENT_PREFIX_PATH"] = variables["CMAKE_PREFIX_PATH"] = str(self.venv)
            variables.pop("PYTHONPATH", None)
        return variables

    def _outside_clone(self, paths: str) -> str:
        kept = [p for p in paths.split(":") if p and not Path(p).is_relative_to(self.root)]
        return ":".join(kept)

    def describe(self) -> str:
        """Return what an installed tree depends on; a change of it makes the tree useless."""
        ros = os.environ.get("AMENT_PREFIX_PATH", "") if self.ros_installed else ""
        outside = self._outside_clone(ros)
        version = ".".join(str(n) for n in sys.version_info[:2])
        return f"{self.root}\nPython {version}\nROS {outside or 'wheels'}\n"
