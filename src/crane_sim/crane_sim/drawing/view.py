"""`view`: a window that shows the simulated crane in one pose or replays a trajectory."""

import os
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from crane_model import cli
from crane_model.errors import ConfigurationError
from crane_model.machine import Machine, parse_pose
from crane_sim.drawing.scene import Scene
from crane_sim.parts.parameters import add_plant, load_both
from crane_trajectory.motion.periodic import PeriodicTrajectory, load_trajectory

FRAME_S = 1 / 60

Motion = Callable[[float], np.ndarray]


def replayed(trajectory: PeriodicTrajectory, machine: Machine, rest: np.ndarray) -> Motion:
    """Coordinates (j,) at a time [s]: those of (32), period after period, the others at `rest`."""
    columns = [machine.index(joint) for joint in trajectory.joint_names]

    def motion(t: float) -> np.ndarray:
        q = rest.copy()
        q[columns] = trajectory.evaluate(np.array([t])).position[0]
        return q

    return motion


def _held(pose: np.ndarray, _: float) -> np.ndarray:
    return pose


def require_display() -> None:
    """`ConfigurationError` where no window can be opened."""
    if not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        raise ConfigurationError(
            "view: no display: neither DISPLAY nor WAYLAND_DISPLAY is set; start it on a desktop "
            "(or by ssh -X), or draw into a file: ros2 run crane_sim picture --out FILE.png"
        )


def show(scene: Scene, motion: Motion) -> None:
    """Show the motion in a window, in real time, until it is closed."""
    from mujoco import viewer  # it looks for a display on import

    with viewer.launch_passive(scene.model, scene.data, show_left_ui=False) as window:
        camera = scene.camera(16 / 10)
        with window.lock():
            window.cam.lookat[:], window.cam.distance = camera.lookat, camera.distance
            window.cam.azimuth, window.cam.elevation = camera.azimuth, camera.elevation
        start = time.monotonic()
        while window.is_running():
            with window.lock():
                scene.set_pose(motion(time.monotonic() - start))
            window.sync()
            time.sleep(FRAME_S)


@dataclass(frozen=True)
class _Request:
    pose: Sequence[str]
    trajectory: Path | None
    plant: Path | None
    machine: str | None


def main(argv: Sequence[str] | None = None) -> int:
    """Show the simulated crane in a window; it follows a trajectory where one is given."""
    parser = cli.command_line(description=main.__doc__)
    parser.add_argument(
        "--pose",
        nargs="+",
        default=[],
        metavar="JOINT=VALUE",
        help="positions [rad, m] (default: the rest pose)",
    )
    parser.add_argument("--trajectory", type=Path, help="trajectory file to replay (YAML)")
    add_plant(parser)
    cli.add_machine(parser)
    request = _Request(**vars(parser.parse_args(argv)))

    def body() -> None:
        machine, parameters = load_both(request.machine, request.plant)
        pose = parse_pose(request.pose, machine, parameters.start)
        scene = Scene(parameters, machine)
        scene.set_pose(pose)
        if request.trajectory:
            motion = replayed(load_trajectory(request.trajectory), machine, pose)
        else:
            motion = partial(_held, pose)
        require_display()
        show(scene, motion)

    return cli.run(body)
