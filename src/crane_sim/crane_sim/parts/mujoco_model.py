"""The rigid bodies of a crane for MuJoCo: a second opinion on `rigid_bodies`, and for pictures.

The same bodies and the same machine, but MuJoCo derives the dynamics by its own spatial algebra, in
frames of the links. Joint limits, friction and actuators are left out: the plant has them.
"""

import mujoco
import numpy as np

from crane_model.kinematics import link_transforms
from crane_model.machine import Machine
from crane_sim.parts.parameters import Body, SimulatedCrane


def link_name(joint: str) -> str:
    """Name of the body that a joint moves first."""
    return f"{joint} link"


def machine_spec(parameters: SimulatedCrane, machine: Machine) -> mujoco.MjSpec:
    """Editable MuJoCo model: a link for each joint, and on it the bodies of its file.

    Links have the frames of the machine's links, and joints its names; those that follow another
    joint are there too, and are put where they belong by `chain_positions`. Bodies carry their
    inertia and no geometry.
    """
    spec = mujoco.MjSpec()
    spec.modelname = machine.name
    spec.option.gravity = machine.gravity_vector
    hinge, slide = mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE
    parent, before = spec.worldbody, machine.base.matrix
    frames = link_transforms(machine, np.zeros(len(machine.joint_names)))[0]
    world = np.eye(4)
    for joint, frame in zip(machine.joints, frames, strict=True):
        link = add_body(parent, link_name(joint.name), np.linalg.inv(world) @ frame)
        moving = np.linalg.inv(frame) @ before @ joint.before  # its joint, seen from the link
        link.add_joint(
            name=joint.name,
            type=slide if joint.kind == "prismatic" else hinge,
            axis=moving[:3, :3] @ joint.direction,
            pos=moving[:3, 3],
        )
        for name, body in parameters.bodies.items():
            if body.link == joint.name:
                _add_inertia(link, name, body)
        parent, world, before = link, frame, frame
    return spec


def chain_positions(machine: Machine, q: np.ndarray) -> np.ndarray:
    """(m,) positions of all joints of the chain from coordinates (j,)."""
    led = [machine.led_by(joint) for joint in machine.joints]
    return np.array([ratio * q[leader] for leader, ratio in led])


def add_body(parent: mujoco.MjsBody, name: str, placed: np.ndarray) -> mujoco.MjsBody:
    """A body without mass, fixed at a place (4, 4) in the frame of its parent."""
    quat = np.empty(4)
    mujoco.mju_mat2Quat(quat, np.ascontiguousarray(placed[:3, :3]).ravel())
    return parent.add_body(name=name, pos=placed[:3, 3], quat=quat)


def _add_inertia(link: mujoco.MjsBody, name: str, body: Body) -> None:
    placed = np.eye(4)
    placed[:3, :3], placed[:3, 3] = body.rotation, body.origin
    added = add_body(link, name, placed)
    added.mass, added.ipos = body.mass, body.centre_of_mass
    added.fullinertia = (*body.inertia, *body.products)
    added.explicitinertial = True
