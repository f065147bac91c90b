"""The stand-in's rigid bodies for MuJoCo: a second opinion on `rigid_bodies`, and for pictures.

The same body parameters and Table 1, but MuJoCo derives the dynamics by its own spatial algebra.
Axes of every body: x along it, z up or along its normal, y to the side; all joints of the plane
turn about -y, so that positive coordinates raise the booms as in Table 1. Joint limits, friction
and actuators are left out: the plant has them.
"""

import math

import mujoco

from crane_model.machine import JOINTS, Machine
from crane_sim.parts.parameters import Body, StandIn

SIDE = (0.0, -1.0, 0.0)  # axis of the inner and outer boom


def crane_spec(parameters: StandIn, machine: Machine) -> mujoco.MjSpec:
    """Editable MuJoCo model: bodies `pillar`, `inner_boom`, ... with joints named as in JOINTS.

    The pillar's frame is at joint 2, that of the inner boom too with x along phi, that of the outer
    boom at the elbow with x along psi, those of telescope and gripper at the boom tip. Bodies carry
    their inertia and no geometry.
    """
    dh, bodies = machine.denavit_hartenberg, parameters.bodies
    spec = mujoco.MjSpec()
    spec.modelname = "forwarder_crane"
    spec.option.gravity = (0.0, 0.0, -machine.gravity)
    hinge, slide = mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE

    pillar = _body(spec.worldbody, "pillar", bodies.pillar, (0.0, 0.0, dh.base_height), 0.0)
    inner = _body(pillar, "inner_boom", bodies.inner_boom, (0.0, 0.0, 0.0), dh.theta_2_0)
    elbow = (dh.inner_boom_length, 0.0, 0.0)
    outer = _body(inner, "outer_boom", bodies.outer_boom, elbow, -dh.theta_2_0)
    tip = (dh.telescope_length, 0.0, dh.telescope_offset)
    telescope = _body(outer, "telescope", bodies.telescope, tip, 0.0)
    _body(telescope, "gripper", bodies.gripper, (0.0, 0.0, 0.0), 0.0)

    moved = (pillar, inner, outer, telescope)
    kinds = (hinge, hinge, hinge, slide)
    axes = ((0.0, 0.0, 1.0), SIDE, SIDE, (1.0, 0.0, 0.0))
    for body, joint, kind, axis in zip(moved, JOINTS, kinds, axes, strict=True):
        body.add_joint(name=joint, type=kind, axis=axis)
    return spec


def raised(angle: float) -> tuple[float, float, float, float]:
    """Quaternion that raises the x axis by `angle` [rad]: a turn about SIDE."""
    return math.cos(angle / 2), 0.0, -math.sin(angle / 2), 0.0


def _body(
    parent: mujoco.MjsBody,
    name: str,
    body: Body,
    position: tuple[float, float, float],
    angle: float,
) -> mujoco.MjsBody:
    """A body in the frame of its parent; its principal axes are along, to the side, normal."""
    along, normal = body.centre_of_mass
    inertia_along, inertia_normal, inertia_plane = body.principal_inertia
    return parent.add_body(
        name=name,
        pos=position,
        quat=raised(angle),
        mass=body.mass,
        ipos=(along, 0.0, normal),
        inertia=(inertia_along, inertia_plane, inertia_normal),
        explicitinertial=True,
    )
