"""The machine with its surroundings, in any pose: what pictures and the viewer show."""

import math
from typing import TYPE_CHECKING, Any, Self

import mujoco
import numpy as np

from crane_model.errors import RangeError
from crane_model.kinematics import forward_kinematics, link_transforms, tip_position
from crane_model.machine import Machine
from crane_sim.drawing.bodies import (
    Material,
    add_materials,
    add_moving_parts,
    bar,
    dress,
    forwarder,
    pins,
    placements,
)
from crane_sim.drawing.picture import broken, find_backend
from crane_sim.parts.mujoco_model import chain_positions, link_name, machine_spec
from crane_sim.parts.parameters import SimulatedCrane

if TYPE_CHECKING:
    from PIL import Image

# Any machine, drawn simply: a bar from each joint to the next, and a pin where one turns.

THICKEST, THINNER = 0.09, 0.85  # m, radius of the first link; and of each next one, its share
PIN_HALF_LENGTH = 1.6  # length of a pin to either side, of the radius of its link
MIN_BAR_M = 0.02  # of a bar that is drawn


def sketch(spec: mujoco.MjSpec, machine: Machine) -> None:
    """Draw the links of `machine_spec`, and the base."""
    still = np.zeros(len(machine.joint_names))
    frames = link_transforms(machine, still)[0]
    before = [machine.base.matrix, *frames[:-1]]
    joints = [frame @ joint.before for frame, joint in zip(before, machine.joints, strict=True)]
    ends = [*(placed[:3, 3] for placed in joints[1:]), forward_kinematics(machine, still)[0, :3, 3]]
    bar(spec.worldbody, (0.0, 0.0, 0.0), (0.0, 0.0, 0.05), 2.5 * THICKEST, Material.CONCRETE)
    _bar(spec.worldbody, np.zeros(3), joints[0][:3, 3], THICKEST, Material.STEEL)
    for i, joint in enumerate(machine.joints):
        link, seen = spec.body(link_name(joint.name)), np.linalg.inv(frames[i])
        radius, slides = THICKEST * THINNER ** (i + 1), joint.kind == "prismatic"
        start, end = _point(seen, joints[i][:3, 3]), _point(seen, ends[i])
        _bar(link, start, end, radius, Material.CHROME if slides else Material.PAINT)
        if not slides:
            half = PIN_HALF_LENGTH * radius * (seen[:3, :3] @ joints[i][:3, :3] @ joint.direction)
            _bar(link, start - half, start + half, radius, Material.STEEL)


def _point(seen: np.ndarray, point: np.ndarray) -> np.ndarray:
    """(3,) in another frame."""
    placed: np.ndarray = seen[:3, :3] @ point + seen[:3, 3]
    return placed


def _bar(
    body: mujoco.MjsBody, start: np.ndarray, end: np.ndarray, radius: float, material: Material
) -> None:
    if np.linalg.norm(end - start) > MIN_BAR_M:
        bar(body, (start[0], start[1], start[2]), (end[0], end[1], end[2]), radius, material)


GRIPPER_REACH_M = 0.92  # of the hanging gripper below the boom tip
BASE_EDGE = (-0.8, 0.0, 0.0)  # m, the edge of the foundation
PADDING = np.array([0.35, 0.35, 0.12])  # m, of links and jaws around the pins
PICTURE_MARGIN = 1.22  # of the picture over the crane in it


class Scene:
    """`model` and `data` for MuJoCo, held in the pose last set; nothing in it moves by itself."""

    def __init__(
        self, parameters: SimulatedCrane, machine: Machine, width: int = 0, height: int = 0
    ):
        """`width` and `height` [pixels]: of the largest picture to be taken of it."""
        self._machine, self._detailed = machine, forwarder(machine)
        spec = machine_spec(parameters, machine)
        add_materials(spec)
        if self._detailed:
            dress(spec, machine)
            add_moving_parts(spec, machine)
        else:
            sketch(spec, machine)
        _surround(spec)
        view = spec.visual.global_
        view.offwidth, view.offheight = max(width, view.offwidth), max(height, view.offheight)
        self.model = spec.compile()
        self.data = mujoco.MjData(self.model)
        self.set_pose(parameters.start)

    def set_pose(self, q: np.ndarray) -> None:
        """Show the machine at q (j,), from the base to the tip.

        `RangeError` where q leaves Table 2: beyond it the linkages may not reach.
        """
        machine = self._machine
        for joint, value in zip(machine.joint_names, q, strict=True):
            limits = machine.limits[joint]
            if not limits.position_min <= value <= limits.position_max:
                raise RangeError(
                    f"{joint}: {value:.6g} {machine.units[joint]} is outside its limits "
                    f"[{limits.position_min}, {limits.position_max}]; "
                    "the linkages are drawn within them"
                )
        self.data.qpos[:] = chain_positions(machine, q)
        if self._detailed:
            self._place_moving_parts(q)
        mujoco.mj_forward(self.model, self.data)

    def _place_moving_parts(self, q: np.ndarray) -> None:
        turn = np.array([math.cos(q[0] / 2), 0.0, 0.0, math.sin(q[0] / 2)])
        for part in placements(pins(self._machine, q)):
            slot = self.model.body(part.name).mocapid[0]
            radius, height = part.origin
            self.data.mocap_pos[slot] = (radius * math.cos(q[0]), radius * math.sin(q[0]), height)
            mujoco.mju_mulQuat(self.data.mocap_quat[slot], turn, np.array(raised(part.angle)))

    def camera(self, aspect: float) -> mujoco.MjvCamera:
        """A camera that has all of the machine, as it stands, in a picture of this aspect ratio."""
        return self._camera(self._seen(), aspect)

    def camera_of(self, motion: np.ndarray, aspect: float) -> mujoco.MjvCamera:
        """One that has it in the picture throughout a motion (n, j)."""
        seen = []
        for q in motion:
            self.set_pose(q)
            seen.append(self._seen())
        return self._camera(np.concatenate(seen), aspect)

    def _seen(self) -> np.ndarray:
        """(k, 3) points of the machine as it stands, of which no other reaches farther [m]."""
        q = self.data.qpos[[self.model.joint(name).id for name in self._machine.joint_names]]
        tip = tip_position(self._machine, q)[0]
        seen = np.array([BASE_EDGE, *self.data.xanchor, tip])
        return np.vstack([seen, tip - (0.0, 0.0, GRIPPER_REACH_M)]) if self._detailed else seen

    def _camera(self, seen: np.ndarray, aspect: float) -> mujoco.MjvCamera:
        low, high = seen.min(axis=0) - PADDING, seen.max(axis=0) + PADDING
        half = math.radians(self.model.vis.global_.fovy) / 2
        height = max(high[2] - low[2], np.hypot(*(high - low)[:2]) / aspect)
        camera = mujoco.MjvCamera()
        camera.lookat[:] = (low + high) / 2
        camera.distance = PICTURE_MARGIN * height / 2 / math.tan(half)
        camera.azimuth, camera.elevation = 110.0, -10.0
        return camera


def raised(angle: float) -> tuple[float, float, float, float]:
    """Quaternion that raises the x axis by `angle` [rad]: a turn about minus y."""
    return math.cos(angle / 2), 0.0, -math.sin(angle / 2), 0.0


def _surround(spec: mujoco.MjSpec) -> None:
    builtin, texture = mujoco.mjtBuiltin, mujoco.mjtTexture
    spec.add_texture(
        name="sky",
        type=texture.mjTEXTURE_SKYBOX,
        builtin=builtin.mjBUILTIN_GRADIENT,
        rgb1=(0.62, 0.74, 0.86),
        rgb2=(0.94, 0.95, 0.96),
        width=512,
        height=3072,
    )
    spec.add_texture(
        name="tiles",
        type=texture.mjTEXTURE_2D,
        builtin=builtin.mjBUILTIN_CHECKER,
        rgb1=(0.71, 0.72, 0.72),
        rgb2=(0.685, 0.695, 0.70),
        width=512,
        height=512,
    )
    ground = spec.add_material(name="ground", texrepeat=(1.0, 1.0), texuniform=True)
    ground.textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = "tiles"
    ground.specular, ground.shininess, ground.reflectance = 0.05, 0.1, 0.0
    spec.worldbody.add_geom(
        type=mujoco.mjtGeom.mjGEOM_PLANE,
        size=(0.0, 0.0, 0.5),
        material="ground",
        contype=0,
        conaffinity=0,
    )
    directional = mujoco.mjtLightType.mjLIGHT_DIRECTIONAL
    sun, fill = (spec.worldbody.add_light(type=directional) for _ in range(2))
    sun.pos, sun.dir = (0.0, -3.0, 7.0), (0.35, 0.55, -1.0)
    sun.diffuse, sun.specular = (0.75, 0.74, 0.70), (0.5, 0.5, 0.5)
    fill.pos, fill.dir, fill.castshadow = (4.0, -4.0, 3.0), (-0.8, 0.6, -0.3), False
    fill.diffuse, fill.specular = (0.22, 0.23, 0.26), (0.1, 0.1, 0.1)
    head = spec.visual.headlight
    head.ambient, head.diffuse, head.specular = (0.38,) * 3, (0.12,) * 3, (0.0,) * 3
    spec.visual.map.shadowclip = 2.0
    spec.visual.rgba.haze = (0.94, 0.95, 0.96, 1.0)
    spec.visual.quality.shadowsize, spec.visual.quality.offsamples = 4096, 4
    spec.stat.center, spec.stat.extent = (1.2, 0.0, 1.4), 4.5


# Pictures of a scene, drawn without a display.

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
    """Canvas of a scene, within a `with` block, drawn as often as it changes."""

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

    def __exit__(self, *_: object) -> None:
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


def take_picture(scene: Scene, width: int, height: int) -> "Image.Image":
    """The crane as it stands, from the side and a little above, with smooth edges."""
    from PIL import Image  # not for the viewer, which draws on the screen

    fine = draw(scene, scene.camera(width / height), FINENESS * width, FINENESS * height)
    return Image.fromarray(fine).reduce(FINENESS)
