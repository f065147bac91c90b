"""Motions of a case: periodic ones slow and fast, and sweeps at constant speed with dwells."""

from collections.abc import Callable
from enum import StrEnum

import numpy as np

from crane_model.errors import RangeError
from crane_model.machine import PLANAR_JOINTS, Machine
from crane_trajectory.check import Clearance, pump_flow, tip_room
from crane_trajectory.fourier import FourierTrajectory
from crane_trajectory.motion import Motion, plan
from crane_trajectory.periodic import PeriodicTrajectory
from crane_trajectory.sweep import JointCourse, SweepTrajectory

HARMONICS = 4
ATTEMPTS = 200
SHRINK = 0.85  # of a motion that does not fit, before it is tried again
TRIES = 8  # to shrink it, before another is drawn
FREE = 0.05  # of the range of a joint, at both ends
LOOKS = 50  # instants of a motion at which it is looked at before it is planned
DWELL = (1.5, 2.5)  # s


class Excitation(StrEnum):
    """How well a case is excited."""

    RICH = "rich"
    POOR = "poor"  # one short, slow, small motion


def motions(
    rng: np.random.Generator,
    machine: Machine,
    start: np.ndarray,
    clearance: Clearance,
    excitation: Excitation,
    sets: int,
) -> tuple[list[Motion], list[Motion]]:
    """To train and to validate on: `sets` times a slow, a fast one and sweeps; a slow and a fast.

    Every motion begins at rest in the pose `start` (4,).
    """

    def fitting(draw: Callable[[float], PeriodicTrajectory], periods: int) -> Motion:
        for _ in range(ATTEMPTS):
            state = rng.bit_generator.state
            for attempt in range(TRIES):
                rng.bit_generator.state = state
                trajectory = draw(SHRINK**attempt)
                if not _has_room(machine, clearance, trajectory):
                    continue
                try:
                    return plan(machine, trajectory, start, periods, clearance)
                except RangeError:
                    continue
        raise RangeError(
            f"none of {ATTEMPTS} motions fits the machine, each tried in {TRIES} sizes down to "
            f"{SHRINK ** (TRIES - 1):.0%}; ask for slower or smaller ones"
        )

    def periodic(period: float, periods: int, size: float = 0.9) -> Motion:
        drawn = period * rng.uniform(0.9, 1.1)
        return fitting(lambda share: _fourier(rng, machine, round(drawn, 2), size * share), periods)

    def sweeps() -> Motion:
        drawn = round(rng.uniform(18.0, 22.0), 2)
        return fitting(lambda share: _sweeps(rng, machine, drawn, 0.9 * share), 2)

    if excitation is Excitation.POOR:
        return [periodic(16.0, 1, 0.08)], [periodic(16.0, 1, 0.08)]
    train = [
        motion for _ in range(sets) for motion in (periodic(17.0, 3), periodic(6.5, 4), sweeps())
    ]
    return train, [periodic(17.0, 3), periodic(6.5, 4)]


def _has_room(machine: Machine, clearance: Clearance, trajectory: PeriodicTrajectory) -> bool:
    """Whether tip and pump allow it at some instants: what `plan` looks at closely, but quick."""
    joints = trajectory.joint_names
    samples = trajectory.evaluate(np.linspace(0.0, trajectory.period, LOOKS))
    room = tip_room(machine, joints, samples.position)
    keep = np.array([clearance.pillar_clearance, clearance.lowest_tip])
    flow = pump_flow(machine, joints, samples.position, samples.velocity)
    return bool((room > keep).all() and (flow < machine.hydraulics.pump_flow).all())


def _fourier(
    rng: np.random.Generator, machine: Machine, period: float, size: float
) -> FourierTrajectory:
    """A random series; `size` is the share of range or speed that it takes, whichever is less."""
    time = np.linspace(0.0, period, 20 * HARMONICS, endpoint=False)
    columns = []
    for joint in PLANAR_JOINTS:
        coefficients = rng.standard_normal(2 * HARMONICS) / np.tile(np.arange(1, HARMONICS + 1), 2)
        shape = FourierTrajectory.from_coefficients(
            "", period, (joint,), np.append(0.0, coefficients)[:, np.newaxis]
        ).evaluate(time)
        limits = machine.limits[joint]
        span = (1.0 - 2.0 * FREE) * (limits.position_max - limits.position_min)
        fastest = min(limits.velocity_max, -limits.velocity_min)
        factor = size * min(span / np.ptp(shape.position), fastest / np.abs(shape.velocity).max())
        low, high = factor * shape.position.min(), factor * shape.position.max()
        free = FREE * (limits.position_max - limits.position_min)
        offset = rng.uniform(limits.position_min + free - low, limits.position_max - free - high)
        columns.append(np.append(offset, factor * coefficients))
    return FourierTrajectory.from_coefficients(
        "excitation", period, PLANAR_JOINTS, np.round(np.stack(columns, axis=1), 6)
    )


def _sweeps(
    rng: np.random.Generator, machine: Machine, period: float, size: float
) -> SweepTrajectory:
    """All joints at once, each up and down at its own constant speeds, with a dwell at each end."""
    courses = {}
    for joint in PLANAR_JOINTS:
        limits = machine.limits[joint]
        dwells = rng.uniform(*DWELL, 2)
        up = rng.uniform(0.35, 0.65) * (period - dwells.sum())
        times = np.cumsum([0.0, up, dwells[0], period - dwells.sum() - up, dwells[1]])
        times[-1] = period
        fastest = min(limits.velocity_max, -limits.velocity_min)
        span = (1.0 - 2.0 * FREE) * (limits.position_max - limits.position_min)
        way = size * min(span, fastest * min(up, times[3] - times[2]))
        free = FREE * (limits.position_max - limits.position_min)
        low = rng.uniform(limits.position_min + free, limits.position_max - free - way)
        ends = [low, low + way] if rng.uniform() < 0.5 else [low + way, low]
        positions = np.round([ends[0], ends[1], ends[1], ends[0], ends[0]], 6)
        courses[joint] = JointCourse(
            time=tuple(np.round(times, 6).tolist()), position=tuple(positions.tolist())
        )
    return SweepTrajectory(kind="sweep", name="sweeps", period=period, corner=0.5, joints=courses)
