"""The crane with its surroundings, in any pose: what pictures and the viewer show."""

import math

import mujoco
import numpy as np

from crane_model.errors import RangeError
from crane_model.machine import JOINT_UNITS, JOINTS, Machine
from crane_sim.drawing.bodies import dress
from crane_sim.drawing.moving import add_moving_parts, placements
from crane_sim.drawing.pins import pins
from crane_sim.drawing.shapes import add_materials
from crane_sim.parts.mujoco_model import crane_spec, raised
from crane_sim.parts.parameters import StandIn

GRIPPER_REACH = 0.92  # m, of the hanging gripper below the boom tip
PADDING = np.array([0.35, 0.35, 0.12])  # m, of links and jaws around the pins
MARGIN = 1.22  # of the picture over the crane in it


class Scene:
    """`model` and `data` for MuJoCo, held in the pose last set; nothing in it moves by itself."""

    def __init__(self, parameters: StandIn, machine: Machine, width: int = 0, height: int = 0):
        """`width` and `height` [pixels]: of the largest picture to be taken of it."""
        self._machine = machine
        spec = crane_spec(parameters, machine)
        add_materials(spec)
        dress(spec, machine)
        add_moving_parts(spec, machine)
        _surround(spec)
        view = spec.visual.global_
        view.offwidth, view.offheight = max(width, view.offwidth), max(height, view.offheight)
        self.model = spec.compile()
        self.data = mujoco.MjData(self.model)
        self.set_pose(parameters.start)

    def set_pose(self, q: np.ndarray) -> None:
        """Show the crane at q (4,), in the order of JOINTS.

        `RangeError` where q leaves Table 2: beyond it the linkages may not reach.
        """
        for joint, value in zip(JOINTS, q, strict=True):
            limits = self._machine.limits[joint]
            if not limits.position_min <= value <= limits.position_max:
                raise RangeError(
                    f"{joint}: {value:.6g} {JOINT_UNITS[joint]} is outside "
                    f"[{limits.position_min}, {limits.position_max}] of Table 2; "
                    "the linkages are drawn within it"
                )
        self.data.qpos[:] = q
        turn = np.array([math.cos(q[0] / 2), 0.0, 0.0, math.sin(q[0] / 2)])
        for part in placements(pins(self._machine, q)):
            slot = self.model.body(part.name).mocapid[0]
            radius, height = part.origin
            self.data.mocap_pos[slot] = (
                radius * math.cos(q[0]),
                radius * math.sin(q[0]),
                height,
            )
            mujoco.mju_mulQuat(self.data.mocap_quat[slot], turn, np.array(raised(part.angle)))
        mujoco.mj_forward(self.model, self.data)

    def camera(self, aspect: float) -> mujoco.MjvCamera:
        """A camera that has all of the crane, as it stands, in a picture of this aspect ratio."""
        elbow, tip = (self.data.body(name).xpos for name in ("outer_boom", "telescope"))
        joint_2 = self.data.body("pillar").xpos
        seen = np.array([(-0.8, 0.0, 0.0), joint_2, elbow, tip, tip - (0.0, 0.0, GRIPPER_REACH)])
        low, high = seen.min(axis=0) - PADDING, seen.max(axis=0) + PADDING
        half = math.radians(self.model.vis.global_.fovy) / 2
        height = max(high[2] - low[2], np.hypot(*(high - low)[:2]) / aspect)
        camera = mujoco.MjvCamera()
        camera.lookat[:] = (low + high) / 2
        camera.distance = MARGIN * height / 2 / math.tan(half)
        camera.azimuth, camera.elevation = 110.0, -10.0
        return camera


def _surround(spec: mujoco.MjSpec) -> None:
    """Ground, sky and light."""
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
