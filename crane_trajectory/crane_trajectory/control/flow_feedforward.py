"""`flow_feedforward`: the valve opening that the reference needs, by the inverse of its flow.

Per joint, with the error e = q_ref - q,

    v = v_ref(t + T) + kv e + ki Int(e),    n = dx/dq v + [F' - kp H(F_meas - F)] / (k_A + k_B)

F is the piston force of (16) along the reference, with the load at the tip where one is told
(`tip_load`), H a high-pass of `DAMPED` seconds. The opening is n / g (see `inverse_flow`), crossed
over the dead zone in the direction wanted. With chamber pressures g follows from them and H damps
the oil (dynamic pressure feedback); without, or where a transducer fails, g follows from F and kp
is zero. Where reference and crane rest, the valve is closed.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from crane_model.machine import Machine
from crane_model.model_file import Model
from crane_trajectory.control.adaptation import WINDOW_FIELDS, begin
from crane_trajectory.control.cycle import cycle
from crane_trajectory.control.geometry import tables
from crane_trajectory.control.interface import (
    ControlCondition,
    Point,
    SensorReading,
    Wanted,
    conditions,
)
from crane_trajectory.control.load import ReferenceLoad
from crane_trajectory.control.memory import HISTORY, STATE, CycleSetting, Memory
from crane_trajectory.control.valves_and_oil import ValvesAndOil
from crane_trajectory.control.watch import WATCH

LARGEST_STEP = 0.05  # s; a longer gap counts as this
TOLERANCES = {"rad": 3e-4, "m": 5e-4}  # of a crane at rest
KV = {"rad": 4.5, "m": 5.5}  # 1/s; a telescope rides on its oil at 140 rad/s, the booms at 18 to 36
KI = {"rad": 10.0, "m": 15.0}  # 1/s2


class FeedbackGains(NamedTuple):
    """Gains of j joints, (j,) each."""

    kv: np.ndarray  # 1/s
    ki: np.ndarray  # 1/s2
    kp: np.ndarray  # 1/s, dynamic pressure feedback
    kp_alone: np.ndarray  # 1/s, the same without pressures, of the flow that the model expects
    tolerance: np.ndarray  # rad, m: error that a crane at rest is left with
    largest_speed: np.ndarray  # rad/s, m/s

    def records(self) -> np.ndarray:
        """(j,) records with these fields."""
        records = np.empty(len(self.kv), np.dtype([(name, float) for name in self._fields]))
        for name, column in zip(self._fields, self, strict=True):
            records[name] = column
        return records


def feedback_gains(
    machine: Machine, model: Model, scale: float = 1.0, joints: Sequence[str] | None = None
) -> FeedbackGains:
    """Half of what is stable on the laboratory crane; times `scale`. Of all joints, or of `joints`.

    Joints that the model does not have, and whose load is unknown, get less.
    """
    joints = joints or machine.joint_names
    limits = [machine.limits[joint] for joint in joints]
    one = scale * np.ones(len(limits))
    known = np.array([joint in model.joints for joint in joints])
    return FeedbackGains(
        kv=np.where(known, [KV[machine.units[joint]] for joint in joints], 3.0) * one,
        ki=np.where(known, [KI[machine.units[joint]] for joint in joints], 2.0) * one,
        kp=8.0 * one,
        kp_alone=np.where(known, 0.0, 6.0) * one,
        tolerance=np.array([TOLERANCES[machine.units[joint]] for joint in joints]),
        largest_speed=np.array([max(one.velocity_max, -one.velocity_min) for one in limits]),
    )


class FlowFeedforward:
    """See the head of this file; `adaptive` learns dead zones and gain while the crane moves."""

    def __init__(
        self,
        machine: Machine,
        model: Model,
        hydraulics: ValvesAndOil,
        gains: FeedbackGains | None = None,
        pressures: bool = True,
        adaptive: bool = False,
        by_force: bool = False,
        joints: Sequence[str] | None = None,
    ):
        """Of all joints of the machine, or of `joints` alone, as are `hydraulics` and `gains`.

        `pressures`: whether to use those of the cylinders that have transducers; `by_force`: follow
        a force (computed force) and not the flow.
        """
        joints = tuple(joints or machine.joint_names)
        self.columns = np.array([machine.index(joint) for joint in joints])
        self.joints, self.adaptive = joints, adaptive
        self.by_model = np.isin(np.arange(len(machine.joint_names)), self.columns)
        self.preview = float(np.mean(hydraulics.lag))
        self._load = ReferenceLoad(model, machine)
        fitted = [pressures and machine.cylinders[joint].pressure_sensors for joint in joints]
        self.gains = (gains or feedback_gains(machine, model, joints=joints)).records()
        self._setting = CycleSetting(
            hydraulics.records(),
            self.gains,
            tables(machine)[self.columns],
            np.array(fitted),
            adaptive,
            by_force,
            self.preview,
        )
        self.memory = Memory(
            np.zeros(len(joints), np.dtype([(name, float) for name in STATE])),
            np.zeros(len(joints), np.dtype([(name, float) for name in WATCH])),
            begin(hydraulics.dead_zone_extend, hydraulics.dead_zone_retract),
            np.zeros((len(joints), WINDOW_FIELDS)),
            *np.zeros((2, len(joints), HISTORY)),
        )
        self._count = 0
        self._started = False

    def start(self, command: np.ndarray) -> None:
        """Take over where `command` (j,) was in force, without a jump; what was learnt stays."""
        state = self.memory.state
        for each in self.memory:
            if each is not self.memory.learnt:
                each[...] = np.zeros((), each.dtype)
        state["command"], state["direction"] = command, 1.0
        state["p_a"] = state["p_b"] = np.nan
        self._count = 0
        self._started = True

    def command(self, dt: float, reading: SensorReading, wanted: Wanted) -> np.ndarray:
        """As `Controller` has it: of `columns` of the machine's joints, from all of them."""
        u = np.empty(len(self.memory.state))
        step = min(max(dt, 0.0), LARGEST_STEP)
        load = self._load(*wanted.ahead)[self.columns]
        q, v, p_a, p_b, supply = reading
        at = self.columns
        reading = SensorReading(q[at], v[at], p_a[at], p_b[at], supply)
        now, ahead = (Point(*(each[at] for each in one)) for one in wanted[:2])
        wanted = wanted._replace(now=now, ahead=ahead)
        cycle(
            self._setting, self.memory, self._started, step, self._count, reading, wanted, load, u
        )
        self._count += 1
        return u

    def carry(self, mass: float) -> None:
        """Expect a mass [kg] at the tip beside what the model has there, from the next cycle on."""
        self._load.at_tip = mass

    @property
    def conditions(self) -> tuple[ControlCondition, ...]:
        """Of each joint, after the last command."""
        if not self._started:
            return (ControlCondition.NOT_INITIALISED,) * len(self.memory.state)
        return conditions(self.memory.state["condition"])
