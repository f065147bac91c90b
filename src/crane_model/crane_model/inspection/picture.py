"""The arm in three poses, with its cylinders and what it reaches."""

from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from crane_model.array import Array
from crane_model.inspection.findings import poses, reached, travels
from crane_model.kinematics import link_transforms, tip_position
from crane_model.machine import Machine, MachineJoint

# Where joints and actuators of a machine stand in space, for pictures.


class PlacedBar(NamedTuple):
    """A cylinder, or a link, between two pins (3,) in the base's frame [m]."""

    joint: str
    begin: Array
    end: Array
    is_cylinder: bool


def placed_joints(machine: Machine, q: Array) -> Array:
    """(m, 4, 4) of each joint of the chain before it moves, in the base's frame, at q (j,)."""
    links = link_transforms(machine, q)[0]
    before = np.concatenate([machine.base.matrix[None], links[:-1]])
    placed: Array = before @ np.array([joint.before for joint in machine.joints])
    return placed


def placed_bars(machine: Machine, q: Array) -> list[PlacedBar]:
    """What the actuators consist of at q (j,), from the base to the tip."""
    return [
        PlacedBar(
            joint.name,
            _across(joint, frame, bar.begin),
            _across(joint, frame, bar.end),
            bar.is_cylinder,
        )
        for joint, frame in zip(machine.joints, placed_joints(machine, q), strict=True)
        if joint.actuator is not None
        for bar in joint.actuator.bars(q[machine.index(joint.name)])
    ]


def _across(joint: MachineJoint, frame: Array, pin: Array) -> Array:
    """A point (2,) of the plane across the joint's axis in the base's frame (3,)."""
    axis = joint.direction
    x = np.eye(3)[0] - axis[0] * axis
    if np.linalg.norm(x) < 1e-6:  # the joint turns about x: then it is y
        x = np.eye(3)[1] - axis[1] * axis
    x = x / np.linalg.norm(x)
    within = pin[0] * x + pin[1] * np.cross(axis, x)
    place: Array = frame[:3, :3] @ within + frame[:3, 3]
    return place


ARM, CYLINDER, LINK, REACH, JOINT = "#e07b1a", "#1f5fa8", "#7a8691", "#c2cad1", "#333333"
NAMES = ("all joints at their lower limits", "in the middle", "at their upper limits")


def picture(machine: Machine) -> Figure:
    """Side views in the upright plane from the base to the tip, and the lever arms [m]."""
    figure = Figure(figsize=(15.0, 4.6), layout="constrained")
    *sides, last = figure.subplots(1, 4)
    places = reached(machine)
    for axes, q, name in zip(sides, poses(machine), NAMES, strict=True):
        _reach(axes, machine, places)
        _arm(axes, machine, q)
        axes.set(title=name, xlabel="ahead [m]", aspect="equal")
    sides[0].set_ylabel("height [m]")
    _levers(last, machine)
    figure.suptitle(machine.name)
    return figure


def _ahead(machine: Machine, q: Array) -> Array:
    """(3,) horizontal unit vector of the view: where the arm points."""
    up = -machine.gravity_vector / machine.gravity
    joints, links = placed_joints(machine, q), link_transforms(machine, q)[0]
    tip = (links[-1] @ machine.tool.matrix)[:3, 3]
    for place in (tip - joints[0, :3, 3], *(links[:, :3, 3] - joints[0, :3, 3])):
        level = place - (place @ up) * up
        if (length := float(np.linalg.norm(level))) > 1e-6:
            ahead: Array = level / length
            break
    else:
        ahead = np.array([1.0, 0.0, 0.0])
    side = links[0, :3, 0]  # so that the arm may reach back over itself
    return -ahead if ahead @ side < -1e-9 and len(machine.joints) > 1 else ahead


def _seen(machine: Machine, q: Array, places: Array) -> tuple[Array, Array]:
    """Points (n, 3) in the view: how far ahead and how high [m]."""
    return places @ _ahead(machine, q), places @ (-machine.gravity_vector / machine.gravity)


def _reach(axes: Axes, machine: Machine, places: Array) -> None:
    up = -machine.gravity_vector / machine.gravity
    height = places @ up
    radius = np.linalg.norm(places - height[:, None] * up, axis=1)
    axes.plot(radius, height, ",", color=REACH, zorder=0, rasterized=True)


def _arm(axes: Axes, machine: Machine, q: Array) -> None:
    joints = placed_joints(machine, q)
    line = [np.zeros(3), *joints[:, :3, 3], tip_position(machine, q)[0]]
    axes.plot(*_seen(machine, q, np.array(line)), "-", color=ARM, linewidth=3.0, zorder=1)
    axes.plot(*_seen(machine, q, joints[:, :3, 3]), "o", color=JOINT, markersize=4, zorder=3)
    for bar in placed_bars(machine, q):
        ends = np.array([bar.begin, bar.end])
        colour, width = (CYLINDER, 4.0) if bar.is_cylinder else (LINK, 2.0)
        axes.plot(*_seen(machine, q, ends), "-", color=colour, linewidth=width, zorder=2)
        axes.plot(*_seen(machine, q, ends), ".", color=JOINT, markersize=5, zorder=3)


def _levers(axes: Axes, machine: Machine) -> None:
    for one in travels(machine):
        limits = machine.limits[one.joint]
        grid = np.linspace(limits.position_min, limits.position_max, 201)
        lever = np.abs(machine.cylinder(one.joint, grid)[:, 1])
        if np.ptp(lever) > 0.0:
            axes.plot(np.linspace(0.0, 1.0, len(grid)), lever, label=one.joint)
    axes.set(title="lever arms", xlabel="share of the joint's range", ylabel="|dx/dq| [m]")
    axes.set_ylim(bottom=0.0)
    if axes.lines:
        axes.legend(frameon=False)
    else:  # each is a constant, which the table tells
        axes.set_axis_off()
