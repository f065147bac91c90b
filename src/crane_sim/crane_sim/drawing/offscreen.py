"""Pictures of a scene, drawn without a display."""

from types import TracebackType
from typing import Any, Self

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


class Canvas:
    """Where a scene is drawn, within a `with` block, as often as it changes."""

    def __init__(self, scene: Scene, width: int, height: int):
        """`scene` was made for this size [pixels] or a larger one."""
        self._scene, self._size = scene, (width, height)

    def __enter__(self) -> Self:
        self._context = gl_context(*self._size)
        try:
            model = self._scene.model
            self._renderer = mujoco.MjrContext(model, mujoco.mjtFontScale.mjFONTSCALE_100)
            mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN, self._renderer)
            self._visible = mujoco.MjvScene(model, maxgeom=1000)
        except BaseException:
            self._context.free()
            raise
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._renderer.free()
        self._context.free()

    def draw(self, camera: mujoco.MjvCamera) -> np.ndarray:
        """(height, width, 3) 8-bit picture of the scene as it stands."""
        mujoco.mjv_updateScene(
            self._scene.model,
            self._scene.data,
            mujoco.MjvOption(),
            mujoco.MjvPerturb(),
            camera,
            mujoco.mjtCatBit.mjCAT_ALL,
            self._visible,
        )
        width, height = self._size
        area = mujoco.MjrRect(0, 0, width, height)
        mujoco.mjr_render(area, self._visible, self._renderer)
        pixels = np.empty((height, width, 3), np.uint8)
        mujoco.mjr_readPixels(pixels, None, area, self._renderer)
        return pixels[::-1]


def draw(scene: Scene, camera: mujoco.MjvCamera, width: int, height: int) -> np.ndarray:
    """(height, width, 3) 8-bit picture of a scene that was made for this size or a larger one."""
    with Canvas(scene, width, height) as canvas:
        return canvas.draw(camera)


def take_picture(scene: Scene, width: int, height: int) -> Image.Image:
    """The crane as it stands, from the side and a little above, with smooth edges."""
    fine = draw(scene, scene.camera(width / height), FINENESS * width, FINENESS * height)
    return Image.fromarray(fine).reduce(FINENESS)
