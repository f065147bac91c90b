"""Which OpenGL draws without a display. Imports nothing that needs one, so that it can explain."""

import ctypes
import os

from crane_model.errors import ConfigurationError

LIBRARIES = {
    "egl": ("libEGL.so.1", "libegl1 libgl1-mesa-dri"),
    "osmesa": ("libOSMesa.so.8", "libosmesa6"),
}  # back end of MuJoCo: library, Debian packages that bring it


def find_backend() -> str:
    """`egl` where its library is, else `osmesa`; MUJOCO_GL in the environment chooses one of them.

    `ConfigurationError` names the Debian packages where there is none.
    """
    chosen = os.environ.get("MUJOCO_GL", "").lower()
    names = [chosen] if chosen in LIBRARIES else list(LIBRARIES)
    for name in names:
        try:
            ctypes.CDLL(LIBRARIES[name][0])
        except OSError:
            continue
        return name
    libraries = " or ".join(LIBRARIES[name][0] for name in names)
    raise ConfigurationError(
        f"pictures: OpenGL without a display needs {libraries}, which this machine lacks; "
        f"install: sudo apt install {LIBRARIES[names[0]][1]}"
    )


def broken(backend: str, reason: Exception) -> ConfigurationError:
    """The error for a library that is there and does not work."""
    return ConfigurationError(
        f"pictures: OpenGL by {backend} does not work on this machine ({reason}); "
        f"install its drivers: sudo apt install {LIBRARIES[backend][1]}"
    )
