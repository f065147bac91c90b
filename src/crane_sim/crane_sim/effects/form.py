"""Forms of injected effects and their parameters, and all of a machine for compiled code."""

from collections.abc import Callable, Sequence
from enum import Enum
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from crane_model.cylinders import lever_arm
from crane_model.machine import Machine
from crane_sim.parts.parameters import SimulatedCrane


def measured_joints(machine: Machine) -> tuple[str, ...]:
    """The joints whose chamber pressures are measured, from the base to the tip."""
    return tuple(
        joint for joint, cylinder in machine.cylinders.items() if cylinder.pressure_sensors
    )


class SensorFault:
    """A law between true signals and what noise-free sensors show of them.

    `values` are the parameters in the order of the form; `joint` is that of the faulty sensor.
    """

    def __init__(self, machine: Machine, joint: str, values: Sequence[float]):
        self.column = machine.index(joint)
        self.measured = [machine.index(name) for name in measured_joints(machine)]
        self.values = tuple(values)

    def positions(self, q: np.ndarray) -> np.ndarray:
        """Coordinates (..., j) [rad, m] as the encoders see them."""
        return q

    def pressures(
        self, time: np.ndarray, chamber_a: np.ndarray, chamber_b: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Pressures of the chambers (n, j) [Pa] as the transducers see them at `time` (n,) [s]."""
        return chamber_a, chamber_b


Scale = Callable[[SimulatedCrane, str], float]


def coulomb(simulated: SimulatedCrane, joint: str) -> float:
    """f_c of the joint [N m, N]."""
    return simulated.friction[joint].f_c


def viscous(simulated: SimulatedCrane, joint: str) -> float:
    """f_v of the joint [N m s/rad, N s/m]."""
    return simulated.friction[joint].f_v


def unscaled(simulated: SimulatedCrane, joint: str) -> float:
    """In the unit of the parameter itself: a factor of 1."""
    return 1.0


class Magnitude(NamedTuple):
    """The parameter that is set so that the effect has the wanted relative magnitude.

    Calibration begins at `start` and refuses to go beyond `highest`, both in units of `of`. In
    `unit`, {force} and {coordinate} stand for N m and rad, on a joint that slides for N and m.
    """

    name: str
    unit: str
    start: float
    highest: float
    of: Scale = unscaled


class Draw(NamedTuple):
    """A further parameter, drawn between two values in units of `of`: evenly, or by `ratio`."""

    name: str
    unit: str
    lowest: float
    highest: float
    of: Scale = unscaled
    ratio: bool = False

    def between(self, rng: np.random.Generator) -> float:
        """A value in units of `of`."""
        if self.ratio:
            return float(np.exp(rng.uniform(np.log(self.lowest), np.log(self.highest))))
        return float(rng.uniform(self.lowest, self.highest))


class Where(Enum):
    """Joints an effect can act on, of those with measured pressures, or whole machines."""

    ANY = "a joint"
    TURNING = "a joint that turns"
    SLIDING = "a joint that slides"
    FOLLOWING = "a joint that follows another such"
    WHOLE = "the whole machine"
    SLEWING = "the whole of a machine whose first joint turns and is not measured"
    TELESCOPIC = "the whole of a machine that has a joint which slides"

    def joints(self, machine: Machine) -> tuple[str, ...]:
        """Those of a machine, from the base to the tip."""
        measured, units = measured_joints(machine), machine.units
        match self:
            case Where.ANY:
                return measured
            case Where.TURNING:
                return tuple(joint for joint in measured if units[joint] == "rad")
            case Where.SLIDING:
                return tuple(joint for joint in measured if units[joint] == "m")
            case Where.FOLLOWING:
                names = machine.joint_names
                pairs = pairwise(names)
                return tuple(joint for last, joint in pairs if {last, joint} <= set(measured))
            case _:
                return ()

    @property
    def whole(self) -> bool:
        return self in (Where.WHOLE, Where.SLEWING, Where.TELESCOPIC)

    def fits(self, machine: Machine) -> bool:
        """Return whether there is such a joint, or it is such a machine."""
        first = machine.joint_names[0]
        match self:
            case Where.WHOLE:
                return True
            case Where.SLEWING:
                return machine.units[first] == "rad" and first not in measured_joints(machine)
            case Where.TELESCOPIC:
                return "m" in machine.units.values()
            case _:
                return bool(self.joints(machine))


class Form(NamedTuple):
    """A law of an effect. `law` is its number in compiled code, or the fault of sensors it is."""

    effect: str
    name: str
    law: int | type[SensorFault]
    magnitude: Magnitude
    draws: tuple[Draw, ...] = ()
    where: Where = Where.ANY
    outside: bool = False  # of the catalogue that a diagnosis knows
    signed: bool = False  # its magnitude may as well be negative, which is drawn too

    def unit(self, text: str, machine: Machine, joint: str | None) -> str:
        coordinate = machine.units[joint] if joint else "rad"
        return text.format(force="N" if coordinate == "m" else "N m", coordinate=coordinate)


class InjectedForm(NamedTuple):
    """A form with its parameters: the magnitude, then those drawn, in the order of the form."""

    form: Form
    joint: str | None
    values: tuple[float, ...]
    requested: float | None = None  # relative magnitude that was asked for


# Numbers of laws, by where they act in a step. Whoever acts on a range refuses what it has no
# branch for; `END` is where the numbers end.
FRICTION, PUSHES, MEMORY, LOADS, FLOW, LEAKS, SOFTNESS, END = range(0, 800, 100)
MAX_VALUES = MAX_MEMORIES = 8
MAX_MODES = 2  # of a boom that bends


class Injected(NamedTuple):
    """k effects; arrays begin with k, an axis of j follows the joints."""

    law: np.ndarray  # int
    joint: np.ndarray  # int, -1: the whole machine
    value: np.ndarray  # (k, MAX_VALUES) parameters in the order of the form
    middle: np.ndarray  # (k,) of the range of the joint [rad, m]
    half: np.ndarray  # (k,) of the width of that range
    lever: np.ndarray  # (k,) m, 1: lever arm of the actuator in the middle; 1 of the whole machine
    memory: np.ndarray  # (k, MAX_MEMORIES) states, all zero at the start
    part: np.ndarray  # (k,) Coulomb friction, or force, that is added in this step
    mass: np.ndarray  # (k, j, j) inertia added in this step
    bias: np.ndarray  # (k, j) and forces that come with it
    slowing: np.ndarray  # (k, MAX_MODES, j + 1) of a mode that bends: -e'' by each q'', and without
    bent_mass: np.ndarray  # (j, j) room for M of a crane that is bent,
    bent_bias: np.ndarray  # (j,) and for h
    force: np.ndarray  # (k, j) what the drives must give more, after the last step
    flow: np.ndarray  # (k, j) what flows more into chamber A, m3/s
    clock: np.ndarray  # (1,) s since the machine was started
    meters: bool  # whether any of them acts in a valve
    leaks: bool  # whether any passes a piston
    softens: bool  # whether any gives way to pressure


def packed(
    effects: Sequence[InjectedForm], machine: Machine, running: float = 0.0
) -> Injected | None:
    """Effects that act in the plant, `running` [s] after it was started; None if there is none.

    Faults of sensors are left out. Raises ValueError for a law whose number is in no range.
    """
    inside = [effect for effect in effects if isinstance(effect.form.law, int)]
    laws = [effect.form.law for effect in inside if isinstance(effect.form.law, int)]
    for effect, law in zip(inside, laws, strict=True):
        if not FRICTION <= law < END:
            raise ValueError(
                f"law '{effect.form.name}' of '{effect.form.effect}' has the number {law}, which "
                f"must be from {FRICTION} to {END - 1}: take one of the range where it acts"
            )
    count, joints = len(inside), len(machine.joint_names)
    if count == 0:
        return None
    value = np.zeros((count, MAX_VALUES))
    middle, half, lever = np.zeros(count), np.ones(count), np.ones(count)
    for k, effect in enumerate(inside):
        value[k, : len(effect.values)] = effect.values
        if effect.joint is not None:
            limits = machine.limits[effect.joint]
            middle[k] = (limits.position_max + limits.position_min) / 2.0
            half[k] = (limits.position_max - limits.position_min) / 2.0
            lever[k] = abs(lever_arm(machine, effect.joint, middle[k : k + 1])[0])
    return Injected(
        law=np.array(laws, dtype=np.int64),
        joint=np.array(
            [-1 if effect.joint is None else machine.index(effect.joint) for effect in inside],
            dtype=np.int64,
        ),
        value=value,
        middle=middle,
        half=half,
        lever=lever,
        memory=np.zeros((count, MAX_MEMORIES)),
        part=np.zeros(count),
        mass=np.zeros((count, joints, joints)),
        bias=np.zeros((count, joints)),
        slowing=np.zeros((count, MAX_MODES, joints + 1)),
        bent_mass=np.zeros((joints, joints)),
        bent_bias=np.zeros(joints),
        force=np.zeros((count, joints)),
        flow=np.zeros((count, joints)),
        clock=np.array([running]),
        meters=any(FLOW <= law < LEAKS for law in laws),
        leaks=any(LEAKS <= law < SOFTNESS for law in laws),
        softens=any(law >= SOFTNESS for law in laws),
    )
