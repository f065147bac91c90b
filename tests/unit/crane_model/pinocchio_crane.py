"""The crane in Pinocchio, straight from the Denavit-Hartenberg table: an independent oracle.

Nothing of crane_model's planar derivation is used: four joints, each link's constant part of (1) as
the placement of the next joint, and bodies with all ten inertial parameters.
"""

import math

import numpy as np
import pinocchio as pin

THETA_20, D_40 = 0.1192, 1.813  # Table 1
D_1, A_2, A_3 = 2.202, 1.4, 0.104
GRAVITY = 9.81
TABLE_1 = (  # theta offset, d offset, a, alpha
    (0.0, D_1, 0.0, math.pi / 2),
    (THETA_20, 0.0, A_2, 0.0),
    (math.pi / 2 - THETA_20, 0.0, A_3, math.pi / 2),
    (0.0, D_40, 0.0, 0.0),
)
PLANAR_BODIES = {"FL": "inner_boom", "SL": "outer_boom", "TG": "telescope"}


def _link(theta: float, d: float, a: float, alpha: float) -> pin.SE3:
    turn = pin.SE3(pin.utils.rotate("z", theta), np.array([0.0, 0.0, d]))
    return turn * pin.SE3(pin.utils.rotate("x", alpha), np.array([a, 0.0, 0.0]))


def spatial_crane(bodies: dict[str, pin.Inertia] | None = None) -> pin.Model:
    """All four joints, with a frame `tip`; bodies by name, each given in its joint's frame."""
    model = pin.Model()
    model.gravity.linear = np.array([0.0, 0.0, -GRAVITY])
    placement, parent = pin.SE3.Identity(), 0
    joints = (
        ("slew", pin.JointModelRZ()),
        ("inner_boom", pin.JointModelRZ()),
        ("outer_boom", pin.JointModelRZ()),
        ("telescope", pin.JointModelPZ()),
    )
    for (name, joint), row in zip(joints, TABLE_1, strict=True):
        parent = model.addJoint(parent, joint, placement, name)
        joint_frame = model.addJointFrame(parent)
        placement = _link(*row)
    model.addFrame(pin.Frame("tip", parent, joint_frame, placement, pin.FrameType.OP_FRAME))
    for body, inertia in (bodies or {}).items():
        joint = dict(zip(PLANAR_BODIES, ("inner_boom", "outer_boom", "telescope"), strict=True))[
            body
        ]
        model.appendBodyToJoint(model.getJointId(joint), inertia, pin.SE3.Identity())
    return model


def planar_crane(bodies: dict[str, pin.Inertia], slew: float = 0.0) -> pin.Model:
    """The same crane with its slew joint locked: revolute, revolute, prismatic, as in (7)."""
    spatial = spatial_crane(bodies)
    return pin.buildReducedModel(spatial, [spatial.getJointId("slew")], np.array([slew, 0, 0, 0]))


def random_bodies(seed: int) -> dict[str, pin.Inertia]:
    """Three bodies with all ten parameters: any mass, place and (positive definite) inertia."""
    rng = np.random.default_rng(seed)
    bodies = {}
    for name in PLANAR_BODIES:
        mass = rng.uniform(20.0, 200.0)
        spread = rng.standard_normal((3, 3))
        second_moments = mass * 0.05 * (spread @ spread.T)  # about the centre of mass
        inertia = np.trace(second_moments) * np.eye(3) - second_moments
        bodies[name] = pin.Inertia(mass, rng.uniform(-1.0, 1.0, 3), inertia)
    return bodies


def standard_from_pinocchio() -> np.ndarray:
    """(12, 30): crane_model's standard parameters of three bodies from Pinocchio's ten of each.

    Pinocchio's are mass, three mass moments, Ixx, Ixy, Iyy, Ixz, Iyz, Izz in the joint's frame.
    The frames of the boom joints are turned by theta20 against the line to the elbow (inner boom)
    and against the telescope's axis (outer boom, the other way), with z out of the plane; the
    telescope's frame has x along the normal, z along the axis and lies a3 off the elbow.
    """
    m, mx, my, mz, i_yy, i_zz = 0, 1, 2, 3, 6, 9
    cos, sin = math.cos(THETA_20), math.sin(THETA_20)
    to_standard = np.zeros((12, 30))
    first, second, third = to_standard[0:4, 0:10], to_standard[4:8, 10:20], to_standard[8:12, 20:30]
    first[0, m] = first[3, i_zz] = 1.0
    first[1, [mx, my]] = cos, sin
    first[2, [mx, my]] = -sin, cos
    second[0, m] = second[3, i_zz] = 1.0
    second[1, [mx, my]] = cos, -sin
    second[2, [mx, my]] = sin, cos
    third[0, m] = 1.0
    third[1, mz] = 1.0
    third[2, [mx, m]] = 1.0, A_3
    third[3, [i_yy, mx, m]] = 1.0, 2.0 * A_3, A_3**2
    return to_standard


def dynamic_parameters(bodies: dict[str, pin.Inertia]) -> np.ndarray:
    """(30,): Pinocchio's parameters of the three bodies, in the order of the joints."""
    return np.concatenate([bodies[name].toDynamicParameters() for name in PLANAR_BODIES])
