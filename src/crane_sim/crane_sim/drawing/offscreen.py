"""Pictures of a scene, drawn without a display."""

from typing import Any

import mujoco
import numpy as np
from PIL import Image

from crane_sim.drawing.opengl import broken, find_backend
from crane_sim.drawing.scene import Scene

FINENESS = 2  # drawn so many times larger, then averaged: smooth edges with any driver


def gl_context(width: int, height: int) -> Any:
    """A context of OpenGL, made current; to be freed with `.free()`.

    `ConfigurationError` where there is none, with the Debian packages that bring one.
    """
    backend = find_backend()
    try:
        if backend == "egl":
            from mujoco.egl import GLContext
        else:
            from mujoco.osmesa import GLContext
        context = GLContext(width, height)
        context.make_current()
    except Exception as error:  # each driver raises what it likes
        raise broken(backend, error) from error
    return context


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
