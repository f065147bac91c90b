"""Work cycles: moves between drawn poses, with loads that come and go between them."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from crane_model.machine import Machine
from crane_sim.effects.form import Planted
from crane_sim.effects.forms import FORMS
from crane_sim.parts.parameters import StandIn
from crane_sim.plant.closed_loop import REST
from crane_sim.plant.plant import Plant
from crane_trajectory.motion.motion import Reference

REACHED = 0.7  # of the range of a joint, about its middle
HASTE = 0.6  # of the speed that a joint may have, at most
RESTS = (0.8, 2.5)  # s between two moves
LEAST = 2.0  # s that a move takes
STAYING = 0.3  # share of the moves in which a joint stays
CARRIED = (20.0, 150.0)  # kg


@dataclass(frozen=True)
class WorkCycles:
    """Moves k from `poses[k]` to `poses[k + 1]`, from `begins[k]` to `ends[k]` [s]; at rest then.

    `loads` (k,) [kg] hangs at the tip from the middle of the rest before move k on, its centre
    `beyond` (k,) [m] it, along the line from the last joint.
    """

    poses: np.ndarray  # (k + 1, j)
    begins: np.ndarray  # (k,)
    ends: np.ndarray  # (k,)
    loads: np.ndarray  # (k,)
    beyond: np.ndarray  # (k,)

    @classmethod
    def drawn(
        cls,
        machine: Machine,
        start: np.ndarray,
        duration: float,
        seed: int,
        loaded: bool = True,
        hung: float = 0.0,
    ) -> "WorkCycles":
        """From the pose `start` (j,), for at least `duration` [s]; joints without pressure
        transducers stay where they are. `hung` [m] is the standard deviation of the centres of
        the loads about the tip.
        """
        rng = np.random.default_rng([seed, 17])
        joints = machine.joint_names
        limits = [machine.limits[joint] for joint in joints]
        low = np.array([one.position_min for one in limits])
        high = np.array([one.position_max for one in limits])
        speed = np.array([min(-one.velocity_min, one.velocity_max) for one in limits])
        moving = np.array([machine.cylinders[joint].pressure_sensors for joint in joints])
        middle, half = (low + high) / 2.0, REACHED * (high - low) / 2.0
        poses, begins, ends, loads, now, load = [start], [], [], [], 0.0, 0.0
        while now < duration:
            now += rng.uniform(*RESTS)
            free = moving & (rng.uniform(size=len(joints)) > STAYING)
            target = np.where(free, middle + half * rng.uniform(-1.0, 1.0, len(joints)), poses[-1])
            needed = 1.875 * np.abs(target - poses[-1]) / (HASTE * speed)  # of the fifth-order move
            begins.append(now)
            now += max(LEAST, float(needed.max()))
            ends.append(now)
            if loaded and begins[1:] and rng.uniform() < 0.5:
                load = 0.0 if load else float(rng.uniform(*CARRIED))
            loads.append(load)
            poses.append(target)
        came = np.concatenate([[False], np.diff(loads) != 0.0])
        centres = hung * np.random.default_rng([seed, 18]).normal(size=len(loads))
        beyond = centres[np.cumsum(came)]
        return cls(*map(np.array, (poses, begins, ends, loads, beyond)))

    @property
    def start(self) -> np.ndarray:
        """(j,) the first pose."""
        return np.asarray(self.poses[0])

    @property
    def duration(self) -> float:
        """Until the last move is over [s]."""
        return float(self.ends[-1])

    def reference(self, time: np.ndarray) -> Reference:
        """At time (n,) [s]: polynomials of fifth order, from rest to rest."""
        k = np.clip(np.searchsorted(self.begins, time, side="right") - 1, 0, None)
        span = (self.ends - self.begins)[k, np.newaxis]
        s = np.clip((time - self.begins[k])[:, np.newaxis] / span, 0.0, 1.0)
        way = (self.poses[1:] - self.poses[:-1])[k]
        return Reference(
            position=self.poses[k] + way * s**3 * (10.0 - 15.0 * s + 6.0 * s**2),
            velocity=way * 30.0 * s**2 * (1.0 - s) ** 2 / span,
            acceleration=way * 60.0 * s * (1.0 - 3.0 * s + 2.0 * s**2) / span**2,
            phase=np.full(len(time), np.nan),
        )

    def probe(self, time: np.ndarray) -> np.ndarray:
        """Nothing is added to the commands."""
        return np.zeros((len(time), self.poses.shape[1]))

    def load(self, time: np.ndarray) -> np.ndarray:
        """What hangs at the tip at time (n,) [s] since the beginning of the motion, (n,) [kg]."""
        k = self._carried(time)
        return np.where(k < 0, 0.0, self.loads[np.clip(k, 0, None)])

    def carried(self, time: float) -> tuple[float, float]:
        """The same at one time, and how far its centre is beyond the tip [m]."""
        k = int(self._carried(np.array([time]))[0])
        return (0.0, 0.0) if k < 0 else (float(self.loads[k]), float(self.beyond[k]))

    def _carried(self, time: np.ndarray) -> np.ndarray:
        """(n,) the move whose load hangs there; -1 before the first."""
        rest_before = np.concatenate([[0.0], self.ends[:-1]])
        changes = (rest_before + self.begins) / 2.0
        return np.searchsorted(changes, time, side="right") - 1


PAYLOAD = Planted(FORMS["payload"][0], None, (0.0, 0.0, 0.1))
"""A load that hangs in the tip itself; its mass comes and goes, and its centre with it."""


class LiftingPlant(Plant):
    """The machine at work: what hangs at its tip comes and goes, beside what else it hides."""

    def __init__(
        self, parameters: StandIn, machine: Machine, cycles: WorkCycles, hidden: Sequence[Planted]
    ):
        super().__init__(parameters, machine, cycles.start, [PAYLOAD, *hidden])
        self._cycles = cycles

    def advance(self, command: np.ndarray, duration: float) -> None:
        """With the load of the moment; the motion begins when the machine has been at rest."""
        self.set_magnitude(0, *self._cycles.carried(self.time - REST))
        super().advance(command, duration)
