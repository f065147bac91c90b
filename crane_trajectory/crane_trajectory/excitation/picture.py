"""A picture of a trajectory like Fig. 8: positions and velocities with the limits of Table 2."""

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from crane_model.machine import Machine
from crane_trajectory.motion.check import Clearance, TipRoom, pump_flow
from crane_trajectory.motion.periodic import PeriodicTrajectory

POINTS = 1000
LINE, LIMIT = "#1f4e79", "#c0392b"


def draw(
    path: Path, machine: Machine, trajectory: PeriodicTrajectory, clearance: Clearance
) -> None:
    """Write one period as a picture; the format is that of the file's name (.png, .svg, .pdf).

    Below positions and velocities of the joints that it moves: pump flow, and the tip's room.
    """
    time = np.linspace(0.0, trajectory.period, POINTS)
    motion = trajectory.evaluate(time)
    joints = trajectory.joint_names
    columns = max(len(joints), 3)
    figure = Figure(figsize=(11.0 / 3.0 * columns, 7.5), layout="constrained")
    figure.suptitle(f"{trajectory.name}: one period of {trajectory.period:g} s, limits dashed")
    axes = figure.subplots(3, columns, sharex=True)
    for i, joint in enumerate(joints):
        limits, unit = machine.limits[joint], machine.units[joint]
        title = joint.replace("_", " ")
        _panel(
            axes[0, i],
            time,
            motion.position[:, i],
            (limits.position_min, limits.position_max),
            f"{title} [{unit}]",
        )
        _panel(
            axes[1, i],
            time,
            motion.velocity[:, i],
            (limits.velocity_min, limits.velocity_max),
            f"{title}, velocity [{unit}/s]",
        )
    if machine.supply:
        flow = pump_flow(machine, joints, motion.position, motion.velocity)
        litres = 60e3 * flow, (60e3 * machine.supply.pump_flow,)
        _panel(axes[2, 0], time, *litres, "pump flow, all cylinders [l/min]")
    room = TipRoom(machine)
    if set(room.joints) <= set(joints):
        distance, height = room.at(joints, motion.position).T
        nearest, lowest = clearance.kept.tolist()
        _panel(axes[2, 1], time, distance, (nearest,), "tip from pillar [m]")
        _panel(axes[2, 2], time, height, (lowest,), "tip above ground [m]")
    for panel in axes.ravel():
        if not panel.has_data():
            panel.remove()
    for below in axes[2]:
        below.set_xlabel("time [s]")
    figure.savefig(path, dpi=120)


def _panel(
    axes: Axes, time: np.ndarray, values: np.ndarray, limits: tuple[float, ...], title: str
) -> None:
    axes.plot(time, values, color=LINE, linewidth=1.5)
    for limit in filter(np.isfinite, limits):
        axes.axhline(limit, color=LIMIT, linestyle="--", linewidth=1.0)
    axes.set_title(title, fontsize="medium", loc="left")
    axes.margins(x=0.0, y=0.1)
    axes.grid(alpha=0.3)
