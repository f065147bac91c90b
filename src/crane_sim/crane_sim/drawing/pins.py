"""Where the pins of both boom linkages are: points of the sagittal plane.

Points are (2,) arrays: radius from the slew axis and height [m]. They are constructed from lengths
and directions, the outer boom's four-bar by intersecting circles, apart from the closed forms of
`crane_model.linkages`; the distances between them are the cylinder lengths of (20) and (24).
"""

import math
from typing import NamedTuple

import numpy as np

from crane_model.actuators.direct_cylinder import DirectCylinder
from crane_model.actuators.four_bar_cylinder import FourBarCylinder
from crane_model.actuators.triangle_cylinder import TriangleCylinder
from crane_model.machine import Machine


class Pins(NamedTuple):
    """The pins in one pose (2,) each; letters as in `crane_model.linkages.outer_boom`."""

    joint_2: np.ndarray
    elbow: np.ndarray  # E
    inner_base: np.ndarray  # of the inner boom's cylinder, on the pillar
    inner_eye: np.ndarray  # and on the boom
    outer_base: np.ndarray  # B: of the outer boom's cylinder, on the inner boom
    outer_eye: np.ndarray  # K: where its eye and both links meet
    lever: np.ndarray  # P: of link c1 on the outer boom
    rocker: np.ndarray  # R: of link c2 on the inner boom
    tip: np.ndarray


def direction(angle: float) -> np.ndarray:
    """Unit vector (2,) raised by `angle` from the horizontal [rad]."""
    return np.array([math.cos(angle), math.sin(angle)])


def forwarder(machine: Machine) -> bool:
    """Whether it is a crane as of the report: a slew, two booms with its linkages, a telescope."""
    planar = machine.planar
    if planar is None or len(machine.joints) != 1 + len(planar.joints):
        return False
    inner, outer, telescope = (machine.actuators[joint] for joint in planar.joints)
    return (
        isinstance(inner, TriangleCylinder)
        and isinstance(outer, FourBarCylinder)
        and not outer.mirrored
        and isinstance(telescope, DirectCylinder)
    )


def triangle(machine: Machine) -> TriangleCylinder:
    """What raises the inner boom of a `forwarder`."""
    actuator = machine.actuators[machine.as_planar().joints[0]]
    assert isinstance(actuator, TriangleCylinder)
    return actuator


def four_bar(machine: Machine) -> FourBarCylinder:
    """What moves the outer boom of a `forwarder`."""
    actuator = machine.actuators[machine.as_planar().joints[1]]
    assert isinstance(actuator, FourBarCylinder)
    return actuator


def outer_boom_pins(machine: Machine, angle: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """Pins B and R seen from the elbow, in axes in which the inner boom's line is at `angle`."""
    linkage = four_bar(machine)
    to_base = angle + math.pi - linkage.pin_rise
    to_rocker = to_base + linkage.gamma_32
    return linkage.s31 * direction(to_base), linkage.s23 * direction(to_rocker)


def lever_pin(machine: Machine, angle: float = 0.0) -> np.ndarray:
    """Pin P seen from the elbow, in axes in which the telescope's direction psi is at `angle`."""
    linkage = four_bar(machine)
    # from P to R the angle at the elbow is gamma_21 (21), and R is fixed to the inner boom
    to_rocker = machine.as_planar().theta_2_0 + math.pi - linkage.pin_rise + linkage.gamma_32
    return linkage.s22 * direction(angle + to_rocker - linkage.gamma_21_0)


def pins(machine: Machine, q: np.ndarray) -> Pins:
    """The pins at q (4,) of a `forwarder`; not finite where the links do not reach."""
    dh, inner, outer = machine.as_planar(), triangle(machine), four_bar(machine)
    phi, psi = q[1] + dh.theta_2_0, q[1] + q[2]
    joint_2 = np.array([0.0, dh.base_height])
    elbow = joint_2 + dh.inner_boom_length * direction(phi)
    base, rocker = (elbow + pin for pin in outer_boom_pins(machine, phi))
    lever = elbow + lever_pin(machine, psi)
    return Pins(
        joint_2=joint_2,
        elbow=elbow,
        inner_base=joint_2 + inner.j1 * direction(inner.phi_4 - math.pi / 2),
        inner_eye=joint_2 + inner.j2 * direction(q[1] + inner.phi_3),
        outer_base=base,
        outer_eye=_meeting(lever, outer.c1, rocker, outer.c2),
        lever=lever,
        rocker=rocker,
        tip=elbow
        + dh.telescope_offset * direction(psi + math.pi / 2)
        + (dh.telescope_length + q[3]) * direction(psi),
    )


def _meeting(lever: np.ndarray, c1: float, rocker: np.ndarray, c2: float) -> np.ndarray:
    """Where circles of radius c1 and c2 meet, to the right of the line from lever to rocker."""
    line = rocker - lever
    distance = math.hypot(*line)
    along = (c1**2 - c2**2 + distance**2) / (2.0 * distance)
    square = c1**2 - along**2
    across = math.sqrt(square) if square >= 0.0 else math.nan
    unit = line / distance
    return lever + along * unit + across * np.array([unit[1], -unit[0]])
