"""The twin of a crane: its identified model, stepped from valve commands as they come.

N twins run beside each other, each as late as it is told. A joint stops at its limits.
"""

from collections import deque
from dataclasses import replace

import numpy as np

from crane_model.array import Array
from crane_model.errors import RangeError
from crane_model.hydraulics.stepping import CraneCourse, move_spools, openings
from crane_model.model_file import Model
from crane_model.whole_crane import (
    CraneState,
    ModelMechanics,
    circuit_of,
    identified,
    settle,
    substeps,
)

CYCLE = 0.005  # s, at most: for which the mechanics of a state holds
REMEMBERED = 1.0  # s of commands: none may be later


class Twin:
    """N cranes of the joints of a model, at rest at first."""

    def __init__(self, model: Model, position: Array, late: Array | None = None):
        """At `position` (N, j); `late` (N,) [s] is what passes from a command to the spool (0).

        `ConfigurationError` if the model lacks values or the hydraulics of a joint; `RangeError`
        where the supply pressure cannot hold the joints.
        """
        machine, known = identified(model)
        self.joints, self.time = model.joints, 0.0
        self._late = np.zeros(len(position)) if late is None else np.asarray(late, dtype=float)
        self._circuit = circuit_of(model)
        self._mechanics = ModelMechanics(model, {}, CYCLE, self._circuit)
        valves = [known.joints[joint].valve for joint in model.joints]
        names = "natural_frequency", "damping_ratio", "hysteresis", "dead_zone_a", "dead_zone_b"
        values = [[getattr(valve, name).value for valve in valves] for name in names]
        self._frequency, self._damping, self._play, *self._dead_zones = np.array(values)
        limits = [machine.limits[joint] for joint in model.joints]
        self._low = np.array([one.position_min for one in limits])
        self._high = np.array([one.position_max for one in limits])
        self._state = self._at_rest(np.array(position, dtype=float))
        self._sense = np.sign(self._mechanics.cylinder(self.position)[..., 1])
        self._memory = self._mechanics.memory(_begin(self._state))
        self._spools = np.zeros((3, *position.shape))
        self._commands = deque([(-np.inf, np.zeros(position.shape))])

    @property
    def position(self) -> Array:
        """(N, j) rad, m."""
        now: Array = self._state.position[0]
        return now.copy()

    @property
    def velocity(self) -> Array:
        """(N, j) rad/s, m/s."""
        now: Array = self._state.velocity[0]
        return now.copy()

    @property
    def pressures(self) -> tuple[Array, Array, Array]:
        """Of chambers A (N, j) and B (N, j), and of the supply (N,) [Pa]."""
        state = self._state
        return state.chamber_a[0].copy(), state.chamber_b[0].copy(), state.supply[0].copy()

    def advance(self, commands: Array, duration: float) -> None:
        """Run on for `duration` [s] with commands (N, j) in -1..1; positive moves a joint up.

        `RangeError` if a command is not finite or the motion grows beyond all bounds.
        """
        if not np.isfinite(commands).all():
            raise RangeError(f"valve command {commands}: must be finite, in -1..1 for each joint")
        self._commands.append((self.time, np.clip(commands, -1.0, 1.0)))
        count = max(1, int(np.ceil(duration / CYCLE - 1e-6)))
        for _ in range(count):
            self._step(duration / count)
        while len(self._commands) > 1 and self._commands[1][0] < self.time - REMEMBERED:
            self._commands.popleft()

    def _step(self, period: float) -> None:
        steps = substeps(period)
        asked = self._sense * self._due(self.time + period * (np.arange(steps) + 0.5) / steps)
        edges = move_spools(
            self._spools, asked, period / steps, self._frequency, self._damping, self._play
        )
        between = np.empty((1, *edges.shape))
        for j, (a, b) in enumerate(zip(*self._dead_zones, strict=True)):
            between[0, ..., j] = openings(edges[..., j].ravel(), a, b).reshape(edges.shape[:2])
        course = CraneCourse(*(np.concatenate((one, one)) for one in self._state))
        mechanics = replace(
            self._mechanics, period=period, held=self._stopped(between.mean(axis=(0, 1)))
        )
        settle(mechanics, 0, course, between, self._memory)
        self._memory = mechanics.advanced(self._memory, 0, course)
        self._state = CraneCourse(*(one[1:] for one in course))
        held = np.clip(self._state.position, self._low, self._high)
        self._state.velocity[held != self._state.position] = 0.0
        self._state.position[:] = held
        self.time += period

    def _stopped(self, opening: Array) -> Array:
        """(N, j) whether a joint stands at a limit, and its valve does not lead it away."""
        way = self._sense * opening
        position = self._state.position[0]
        stopped: Array = ((position >= self._high) & (way >= 0.0)) | (
            (position <= self._low) & (way <= 0.0)
        )
        return stopped

    def _due(self, times: Array) -> Array:
        """Commands (S, N, j) that have reached the spools at `times` (S,)."""
        stamps = np.array([stamp for stamp, _ in self._commands])
        commands = np.array([command for _, command in self._commands])
        newest = np.searchsorted(stamps, times[:, np.newaxis] - self._late, side="right") - 1
        due: Array = commands[np.maximum(newest, 0), np.arange(len(self._late))]
        return due

    def _at_rest(self, position: Array) -> CraneCourse:
        """Chamber pressures that carry the weight, and add up to that of the supply."""
        circuit, joints = self._circuit, self.joints
        outside = (position < self._low) | (position > self._high)
        if outside.any():
            n, j = np.argwhere(outside)[0]
            raise RangeError(
                f"{joints[j]}: the twin cannot start at {position[n, j]:.6g}, outside "
                f"[{self._low[j]:g}, {self._high[j]:g}] of its machine"
            )
        full = np.full(position.shape, circuit.supply_pressure)
        parts = (position, np.zeros(position.shape), 0.5 * full, 0.5 * full, full[:, 0])
        state = CraneCourse(*(one[np.newaxis].copy() for one in parts))
        twice = CraneCourse(*(np.concatenate((one, one)) for one in state))
        memory = self._mechanics.memory(_begin(state))
        found = self._mechanics.mechanics(0, twice, memory)
        piston = -found.load[0] / found.cylinder[0, ..., 1]
        a, b, supply, tank = (
            circuit.area_a, circuit.area_b, circuit.supply_pressure, circuit.tank_pressure
        )  # fmt: skip
        p_a = (piston + b * (supply + tank)) / (a + b)
        p_a = np.clip(p_a, np.maximum(tank, (piston + b * tank) / a), supply)
        p_b = (a * p_a - piston) / b
        if not ((p_a >= tank) & (p_b >= tank) & (p_b <= supply)).all():
            n, j = np.argwhere((p_a < tank) | (p_b < tank) | (p_b > supply))[0]
            raise RangeError(
                f"{joints[j]}: its weight asks for {piston[n, j]:.0f} N of its cylinder, more than "
                f"the supply of {supply:.4g} Pa can hold; start from another pose"
            )
        state.chamber_a[0], state.chamber_b[0] = p_a, p_b
        return state


def _begin(course: CraneCourse) -> CraneState:
    return CraneState(
        course.position[0], course.velocity[0], course.chamber_a[0], course.chamber_b[0]
    )
