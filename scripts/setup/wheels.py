"""Mends the ROS wheels: their CMake targets name folders of the machine that built them."""

import re
import subprocess

from machine import Machine

# /opt/python/cp311-cp311/include/python3.11 and .../numpy/_core/include below the same folder
FOREIGN = re.compile(
    r"/opt/python/[^;\"\s]*?/(?:(?P<numpy>numpy/_core/include)|include/python3\.\d+)"
)


def mend_include_folders(machine: Machine) -> None:
    """Let the exported CMake targets name the include folders of this Python and its numpy."""
    query = (
        "import numpy, sysconfig; print(sysconfig.get_path('include')); print(numpy.get_include())"
    )
    answer = subprocess.run(
        [machine.venv_python, "-c", query], capture_output=True, text=True, check=True
    )
    python_include, numpy_include = answer.stdout.splitlines()
    for path in machine.venv.glob("share/*/cmake/*.cmake"):
        text = path.read_text()
        mended = FOREIGN.sub(lambda m: numpy_include if m["numpy"] else python_include, text)
        if mended != text:
            # uv links files from its cache: write a new file, never into the shared one.
            path.unlink()
            path.write_text(mended)
