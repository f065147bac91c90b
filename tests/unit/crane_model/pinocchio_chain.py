"""Any machine in Pinocchio, from its joints one by one: an independent oracle of its dynamics."""

import numpy as np
import pinocchio as pin

from crane_model import Machine


def pinocchio_chain(machine: Machine, bodies: np.ndarray) -> pin.Model:
    """Joints where the machine has them, bodies (m, 10) each in the frame of its joint, and `tip`.

    For machines in which no joint follows another.
    """
    model, parent = pin.Model(), 0
    model.gravity.linear = machine.gravity_vector
    place = pin.SE3(machine.base.matrix)
    for joint, body in zip(machine.joints, bodies, strict=True):
        kind = pin.JointModelPrismaticUnaligned
        if joint.kind == "revolute":
            kind = pin.JointModelRevoluteUnaligned
        placed = place * pin.SE3(joint.before)
        parent = model.addJoint(parent, kind(joint.direction), placed, joint.name)
        frame = model.addJointFrame(parent)
        model.appendBodyToJoint(parent, pin.Inertia.FromDynamicParameters(body), pin.SE3.Identity())
        place = pin.SE3(joint.after)
    tip = place * pin.SE3(machine.tool.matrix)
    model.addFrame(pin.Frame("tip", parent, frame, tip, pin.FrameType.OP_FRAME))
    return model


def random_bodies(count: int, rng: np.random.Generator) -> np.ndarray:
    """(count, 10) bodies that could be made: any mass, place and (positive definite) inertia."""
    bodies = []
    for _ in range(count):
        mass, spread = rng.uniform(5.0, 200.0), rng.standard_normal((3, 3))
        second_moments = mass * 0.05 * (spread @ spread.T)  # about the centre of mass
        inertia = np.trace(second_moments) * np.eye(3) - second_moments
        body = pin.Inertia(mass, rng.uniform(-1.0, 1.0, 3), inertia)
        bodies.append(body.toDynamicParameters())
    return np.array(bodies)
