"""`picture`: the stand-in crane in one pose as a PNG file, drawn without a display."""

import argparse
import ctypes
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from PIL import Image

from crane_model import cli
from crane_model.errors import ConfigurationError, DataError
from crane_model.machine import load_machine
from crane_sim.drawing.pose import parse_pose
from crane_sim.drawing.scene import Scene
from crane_sim.parameters import load_stand_in

SIZE = (1600, 1000)
FINENESS = 2  # drawn so many times larger, then averaged: smooth edges with any driver
COLOURS = 256  # of the palette, which keeps the file small
LIBRARIES = {
    "egl": ("libEGL.so.1", "libegl1 libgl1-mesa-dri"),
    "osmesa": ("libOSMesa.so.8", "libosmesa6"),
}  # back end of MuJoCo: library, Debian packages that bring it


def gl_context(width: int, height: int) -> Any:
    """A context of OpenGL without a display, made current; to be freed with `.free()`.

    EGL where there is one, else OSMesa; the environment variable MUJOCO_GL chooses one of them.
    `ConfigurationError` names the Debian packages where neither is installed or works.
    """
    backend = _backend()
    try:
        if backend == "egl":
            from mujoco.egl import GLContext
        else:
            from mujoco.osmesa import GLContext
        context = GLContext(width, height)
        context.make_current()
    except Exception as error:  # each driver raises what it likes
        raise ConfigurationError(
            f"pictures: OpenGL by {backend} does not work on this machine ({error}); "
            f"install: sudo apt install {LIBRARIES[backend][1]}"
        ) from error
    return context


def _backend() -> str:
    chosen = os.environ.get("MUJOCO_GL", "").lower()
    names = [chosen] if chosen in LIBRARIES else list(LIBRARIES)
    for name in names:
        try:
            ctypes.CDLL(LIBRARIES[name][0])
        except OSError:
            continue
        return name
    wanted = " or ".join(f"{LIBRARIES[name][0]} ({LIBRARIES[name][1]})" for name in names)
    raise ConfigurationError(
        f"pictures: no OpenGL without a display on this machine: neither found nor loaded: "
        f"{wanted}; install: sudo apt install {LIBRARIES[names[0]][1]}"
    )


def draw(scene: Scene, camera: mujoco.MjvCamera, width: int, height: int) -> np.ndarray:
    """(height, width, 3) 8-bit picture of a scene that was made for this size or a larger one."""
    context = gl_context(width, height)
    try:
        renderer = mujoco.MjrContext(scene.model, mujoco.mjtFontScale.mjFONTSCALE_100)
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN, renderer)
        visible = mujoco.MjvScene(scene.model, maxgeom=1000)
        mujoco.mjv_updateScene(
            scene.model,
            scene.data,
            mujoco.MjvOption(),
            mujoco.MjvPerturb(),
            camera,
            mujoco.mjtCatBit.mjCAT_ALL,
            visible,
        )
        area = mujoco.MjrRect(0, 0, width, height)
        mujoco.mjr_render(area, visible, renderer)
        pixels = np.empty((height, width, 3), np.uint8)
        mujoco.mjr_readPixels(pixels, None, area, renderer)
        renderer.free()
    finally:
        context.free()
    return pixels[::-1]


def take_picture(scene: Scene, width: int, height: int) -> Image.Image:
    """The crane as it stands, from the side and a little above, with smooth edges."""
    fine = draw(scene, scene.camera(width / height), FINENESS * width, FINENESS * height)
    return Image.fromarray(fine).reduce(FINENESS)


def main(argv: Sequence[str] | None = None) -> int:
    """Draw the stand-in crane into a PNG file."""
    parser = argparse.ArgumentParser(prog="picture", description=main.__doc__)
    parser.add_argument("--out", type=Path, required=True, help="PNG file to write")
    parser.add_argument(
        "--pose", nargs="+", default=[], metavar="JOINT=VALUE", help="rad, m; else at rest"
    )
    parser.add_argument("--size", type=int, nargs=2, default=SIZE, metavar=("WIDTH", "HEIGHT"))
    parser.add_argument("--plant", type=Path, help="stand-in file (default: the packaged one)")
    parser.add_argument("--machine", type=Path, help="machine file (default: the packaged one)")
    arguments = parser.parse_args(argv)

    def body() -> None:
        if arguments.out.suffix.lower() != ".png":
            raise DataError(f"{arguments.out}: the picture is a PNG file; name it *.png")
        width, height = arguments.size
        parameters = load_stand_in(arguments.plant)
        machine = load_machine(arguments.machine)
        scene = Scene(parameters, machine, FINENESS * width, FINENESS * height)
        scene.set_pose(parse_pose(arguments.pose, parameters.start))
        picture = take_picture(scene, width, height)
        palette = picture.quantize(COLOURS, dither=Image.Dither.FLOYDSTEINBERG)
        palette.save(arguments.out, optimize=True)

    return cli.run(body)
