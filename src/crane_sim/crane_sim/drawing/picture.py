"""`picture`: the simulated crane in one pose as a PNG file, drawn without a display."""

import ctypes
import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from crane_model import cli
from crane_model.errors import ConfigurationError, DataError
from crane_model.machine import parse_pose
from crane_model.progress_bar import progress_bar
from crane_sim.parts.parameters import add_plant, load_both

# Which OpenGL draws without a display. Imports nothing that needs one, so that it can explain.

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


PICTURE_SIZE = (1600, 1000)
MAX_PICTURE_SIDE = 4000  # pixels
COLOURS = 256  # of the palette, which keeps the file small


@dataclass(frozen=True)
class _Request:
    out: Path
    pose: Sequence[str]
    size: Sequence[int]  # pixels: width, height
    plant: Path | None
    machine: str | None
    replace: bool


def main(argv: Sequence[str] | None = None) -> int:
    """Draw the simulated crane into a PNG file."""
    parser = cli.command_line(description=main.__doc__)
    parser.add_argument("--out", type=Path, required=True, help="PNG file to write")
    parser.add_argument(
        "--pose",
        nargs="+",
        default=[],
        metavar="JOINT=VALUE",
        help="positions [rad, m] (default: the rest pose)",
    )
    parser.add_argument(
        "--size", type=int, nargs=2, default=PICTURE_SIZE, metavar=("WIDTH", "HEIGHT"),
        help="size of the picture [pixels] (default: {} {})".format(*PICTURE_SIZE),
    )  # fmt: skip
    add_plant(parser)
    cli.add_machine(parser)
    cli.add_replace(parser)
    request = _Request(**vars(parser.parse_args(argv)))

    def body() -> None:
        if request.out.suffix.lower() != ".png":
            raise DataError(f"{request.out}: the picture is a PNG file; name it *.png")
        if not request.out.parent.is_dir():
            raise DataError(f"{request.out}: there is no folder {request.out.parent}; make it")
        cli.check_out(request.out, replace=request.replace)
        width, height = request.size
        if not all(1 <= side <= MAX_PICTURE_SIDE for side in (width, height)):
            raise DataError(f"--size {width} {height}: each from 1 to {MAX_PICTURE_SIDE} pixels")
        machine, parameters = load_both(request.machine, request.plant)
        pose = parse_pose(request.pose, machine, parameters.start)
        find_backend()
        # only now: without OpenGL the import of mujoco may fail, and less clearly
        from PIL import Image

        from crane_sim.drawing.scene import FINENESS, Scene, take_picture

        with progress_bar(request.out.name, 3) as bar:
            scene = Scene(parameters, machine, FINENESS * width, FINENESS * height)
            scene.set_pose(pose)
            bar.update()
            picture = take_picture(scene, width, height)
            bar.update()
            palette = picture.quantize(COLOURS, dither=Image.Dither.FLOYDSTEINBERG)
            palette.save(request.out, optimize=True)
            bar.update()
        print(f"written: {request.out}")

    return cli.run(body)
