"""The machine: a serial arm of joints, what drives them, and its supply, from one YAML file."""

import math
from collections.abc import Mapping, Sequence
from functools import cached_property
from pathlib import Path
from typing import Annotated, NamedTuple, Self, TypeVar

import numpy as np
from pydantic import Discriminator, Field, Tag, model_validator

from crane_model.actuators import Actuator, HydraulicActuator
from crane_model.array import Array
from crane_model.chain import SerialChain
from crane_model.configuration import Positive, Schema, load
from crane_model.errors import ConfigurationError, RangeError
from crane_model.joint import DenavitHartenberg, JointLimits, MachineJoint, Origin, Vector
from crane_model.machine_files import machine_file

WEIGHED = ("S_FL_along", "S_SL_along", "m_TL")
"""Base parameters that gravity shows: mass moments of the two booms, mass of the telescope."""

_KINDS = ("revolute", "revolute", "prismatic")
_TOLERANCE = 1e-9  # rad, m
USUAL_RANGE = 25e6  # Pa, of transducers
LARGEST_DROP_MARGINS = 2.0  # margins of a pump with load sensing


class JointRanges(NamedTuple):
    """Limits of j joints, (j,) each [rad or m, and per s]; see `JointLimits`."""

    low: Array
    high: Array
    middle: Array
    slower_speed: Array
    top_speed: Array


class PlanarCrane(NamedTuple):
    """The constants of Table 1 that matter in the plane [m, rad, m/s2]."""

    joints: tuple[str, str, str]  # inner boom, outer boom, telescope
    base_height: float  # d1, of joint 2
    theta_2_0: float  # from q2 to the line from joint 2 to the elbow
    inner_boom_length: float  # a2
    telescope_offset: float  # a3, along the normal of the telescope's axis
    telescope_length: float  # d4,0: elbow to tip along the axis at q4 = 0
    gravity: float


def planar_crane(
    joints: Sequence[MachineJoint], base: Origin, tool: Origin, gravity: Array
) -> PlanarCrane | None:
    """The constants if the last three joints are those of Table 1, else None.

    Whatever turns before them turns about the vertical, so that their plane stays upright.
    """
    if len(joints) < 3 or tool != Origin() or any(joint.follows for joint in joints):
        return None
    *before, inner, outer, telescope = joints
    first, second, third = inner.dh, outer.dh, telescope.dh
    kinds = tuple(joint.kind for joint in (inner, outer, telescope))
    if first is None or second is None or third is None or kinds != _KINDS:
        return None
    zeros = np.array(
        [
            *(first.d, first.alpha),
            *(second.theta + first.theta - math.pi / 2, second.d, second.alpha - math.pi / 2),
            *(third.theta, third.a, third.alpha),
        ]
    )
    g = float(np.linalg.norm(gravity))
    up, frame = -gravity / g, base.matrix
    for joint in before:
        axis = frame[:3, :3] @ joint.before[:3, :3] @ joint.direction
        if joint.kind != "revolute" or abs(axis @ up) < 1.0 - _TOLERANCE:
            return None
        frame = frame @ joint.transform(np.zeros(1))[0]
    if np.abs(zeros).max() > _TOLERANCE or np.abs(frame[:3, 1] - up).max() > _TOLERANCE:
        return None
    return PlanarCrane(
        joints=(inner.name, outer.name, telescope.name),
        base_height=float(up @ frame[:3, 3]),
        theta_2_0=first.theta,
        inner_boom_length=first.a,
        telescope_offset=second.a,
        telescope_length=third.d,
        gravity=g,
    )


Entry = TypeVar("Entry")


class ByJoint(dict[str, Entry]):
    """Entries by joint; `RangeError` names the joints that there are where one is not."""

    def __init__(self, machine: str, what: str, entries: Mapping[str, Entry | None]):
        """`what` the entries are, for the message."""
        super().__init__({joint: entry for joint, entry in entries.items() if entry is not None})
        self._told = f"{machine}: {{}} has no {what}; there are those of {', '.join(self)}"

    def __missing__(self, joint: str) -> Entry:
        raise RangeError(self._told.format(f"'{joint}'"))


class Coupling(Schema):
    """The actuators of k `joints` see `matrix` q, (k, k), in the place of q.

    By virtual work, their torques act on the joints by the transpose.
    """

    joints: tuple[str, ...]
    matrix: tuple[tuple[float, ...], ...]

    @model_validator(mode="after")
    def _square(self) -> Self:
        k = len(self.joints)
        if len(self.matrix) != k or any(len(row) != k for row in self.matrix):
            raise ValueError(f"matrix: must have {k} rows of {k} numbers, as many as joints")
        if abs(np.linalg.det(np.array(self.matrix))) < 1e-9:
            raise ValueError("matrix: must not be singular; some motion moves no actuator")
        return self


Gravity = Annotated[
    Annotated[Positive, Tag("<number>")] | Annotated[Vector, Tag("<vector>")],
    Discriminator(lambda given: "<vector>" if isinstance(given, (list, tuple)) else "<number>"),
]
"""Straight down [m/s2], or (3,) in the base's frame where the base is tilted."""


class LoadSensing(Schema):
    """A pump that keeps its pressure a margin above the highest load of the functions that move.

    Valves that compensate behind their metering edges (flow sharing) then have the same drop at all
    edges that feed: the margin, or less where the pump is at its limit of flow or power.
    """

    margin: Positive  # Pa
    power: Positive  # W, most that the pump takes

    @property
    def largest_drop(self) -> float:
        """The largest drop that a pump which is too slow leaves at edges that feed [Pa]."""
        return LARGEST_DROP_MARGINS * self.margin


class HydraulicSupply(Schema):
    """Supply of all hydraulic actuators [Pa gauge, m3/s]."""

    supply_pressure: Positive
    relief_pressure: Positive
    tank_pressure: Annotated[float, Field(ge=0)]
    transducer_range: Positive = USUAL_RANGE  # largest pressure that transducers show
    pump_flow: Positive
    load_sensing: LoadSensing | None = None


class Machine(Schema):
    """Everything about the machine that is known before anything is identified.

    Joints stand from the base to the tip, which `tool` places in the frame of the last one. Those
    that follow another belong to the chain, but not to `joint_names`.
    """

    name: str
    gravity_given: Gravity = Field(alias="gravity")
    base: Origin = Origin()
    joints: tuple[MachineJoint, ...] = Field(min_length=1)
    tool: Origin = Origin()
    couplings: tuple[Coupling, ...] = ()
    supply: HydraulicSupply | None = Field(None, alias="hydraulics")
    plausible: dict[str, tuple[float, float]] = {}
    """[least, most] of masses [kg] and moments [kg m] without a load, to check recordings."""

    def __hash__(self) -> int:
        return hash((self.name, *self.joint_names))

    @model_validator(mode="after")
    def _names(self) -> Self:
        names, known = [joint.name for joint in self.joints], ", ".join(self.joint_names)
        if twice := sorted({name for name in names if names.count(name) > 1}):
            raise ValueError(f"joint '{twice[0]}' is listed twice; give each its own name")
        for joint in self.joints:
            if joint.follows and joint.follows.joint not in self.joint_names:
                raise ValueError(
                    f"joint '{joint.name}': follows '{joint.follows.joint}'; there are {known}"
                )
        coupled = [name for coupling in self.couplings for name in coupling.joints]
        for name in coupled:
            if name not in self.joint_names or coupled.count(name) > 1:
                raise ValueError(f"couplings: '{name}' must be one of {known}, and in one coupling")
        return self

    @model_validator(mode="after")
    def _supplied(self) -> Self:
        if self.supply is None and self.cylinders:
            raise ValueError(
                f"hydraulics: required, for {', '.join(self.cylinders)} have hydraulic actuators"
            )
        return self

    @model_validator(mode="after")
    def _plausible_ranges(self) -> Self:
        if unknown := self.plausible.keys() - set(WEIGHED):
            raise ValueError(
                f"plausible {', '.join(sorted(unknown))}: must be of {', '.join(WEIGHED)}"
            )
        for name, (low, high) in self.plausible.items():
            if not 0.0 < low < high:
                raise ValueError(f"plausible {name}: must be 0 < least < most, got [{low}, {high}]")
        return self

    @cached_property
    def joint_names(self) -> tuple[str, ...]:
        """The joints from the base to the tip."""
        return tuple(joint.name for joint in self.joints if joint.follows is None)

    @cached_property
    def units(self) -> Mapping[str, str]:
        """Unit of each joint's coordinate: rad or m."""
        units = {joint.name: joint.unit for joint in self.joints if joint.follows is None}
        return ByJoint(self.name, "coordinate", units)

    @cached_property
    def limits(self) -> Mapping[str, JointLimits]:
        """Table 2: range of position and velocity of each joint."""
        return ByJoint(self.name, "limits", {joint.name: joint.limits for joint in self.joints})

    def ranges(self, joints: Sequence[str] | None = None) -> JointRanges:
        """Limits of some joints, by default of all, as arrays."""
        named = self.joint_names if joints is None else joints
        rows = [self.limits[joint] for joint in named]
        names = ("position_min", "position_max", *JointRanges._fields[2:])
        return JointRanges(*(np.array([getattr(row, name) for row in rows]) for name in names))

    def latency(self, joints: Sequence[str]) -> Array:
        """(j,) by which the readings of joints are older than their stamps [s]."""
        known = {joint.name: joint.latency for joint in self.joints}
        return np.array([known[joint] for joint in joints])

    @cached_property
    def actuators(self) -> Mapping[str, Actuator]:
        """Actuator of each joint."""
        every = {joint.name: joint.actuator for joint in self.joints}
        return ByJoint(self.name, "actuator", every)

    @cached_property
    def cylinders(self) -> Mapping[str, HydraulicActuator]:
        """Those of the actuators that have two chambers."""
        hydraulic = {
            joint: actuator
            for joint, actuator in self.actuators.items()
            if isinstance(actuator, HydraulicActuator)
        }
        return ByJoint(self.name, "hydraulic actuator", hydraulic)

    @cached_property
    def rotors(self) -> tuple[str, ...]:
        """The joints that a motor turns."""
        return tuple(joint for joint, actuator in self.actuators.items() if actuator.has_rotor)

    def seen_by(self, joint: str) -> Mapping[str, float]:
        """The joints that move the actuator of `joint`, with its share of each coordinate."""
        for coupling in self.couplings:
            if joint in coupling.joints:
                row = coupling.matrix[coupling.joints.index(joint)]
                return {mover: c for mover, c in zip(coupling.joints, row, strict=True) if c}
        return {joint: 1.0}

    def index(self, joint: str) -> int:
        """Place of a joint in `joint_names`; `RangeError` if there is no such joint."""
        if joint not in self.joint_names:
            raise RangeError(
                f"{self.name}: no joint '{joint}'; the joints are {', '.join(self.joint_names)}"
            )
        return self.joint_names.index(joint)

    @property
    def hydraulics(self) -> HydraulicSupply:
        """The supply; `ConfigurationError` of a machine without one."""
        if self.supply is None:
            raise ConfigurationError(f"{self.name}: has no hydraulics; add the key to its file")
        return self.supply

    def led_by(self, joint: MachineJoint) -> tuple[int, float]:
        """Place of the coordinate that moves a joint of the chain, and its share of it."""
        if joint.follows is None:
            return self.index(joint.name), 1.0
        return self.index(joint.follows.joint), joint.follows.ratio

    def cylinder(self, joint: str, q: Array) -> Array:
        """(n,) coordinates of `joint` to (n, 3): x of its actuator, dx/dq, d2x/dq2."""
        return self.actuators[joint].motion(np.ascontiguousarray(q, dtype=float))

    @cached_property
    def gravity_vector(self) -> Array:
        """(3,) in the base's frame [m/s2]."""
        if isinstance(self.gravity_given, tuple):
            return np.array(self.gravity_given)
        return np.array([0.0, 0.0, -self.gravity_given])

    @cached_property
    def gravity(self) -> float:
        """How strong it is [m/s2]."""
        return float(np.linalg.norm(self.gravity_vector))

    @cached_property
    def chain(self) -> SerialChain:
        """Positions and motion of the joints, for compiled code."""
        ends = [self.base.matrix, *(joint.after for joint in self.joints)]
        placed = np.array([e @ j.before for e, j in zip(ends, self.joints, strict=False)])
        tip, led = ends[-1] @ self.tool.matrix, [self.led_by(joint) for joint in self.joints]
        return SerialChain(
            rotation=np.ascontiguousarray(placed[:, :3, :3]),
            translation=np.ascontiguousarray(placed[:, :3, 3]),
            axis=np.array([joint.direction for joint in self.joints]),
            slides=np.array([joint.kind == "prismatic" for joint in self.joints]),
            leader=np.array([leader for leader, _ in led]),
            ratio=np.array([ratio for _, ratio in led]),
            gravity=self.gravity_vector,
            tip_rotation=np.ascontiguousarray(tip[:3, :3]),
            tip_translation=np.ascontiguousarray(tip[:3, 3]),
        )

    @cached_property
    def planar(self) -> PlanarCrane | None:
        """The constants of (2)-(9) where it is a crane as of the report, else None."""
        return planar_crane(self.joints, self.base, self.tool, self.gravity_vector)

    def as_planar(self) -> PlanarCrane:
        """The same; `ConfigurationError` where it is another machine."""
        if self.planar is None:
            raise ConfigurationError(
                f"{self.name}: needs two booms that turn in one upright plane and a telescope in "
                "it, each with its `dh`, as the last three joints"
            )
        return self.planar


def load_machine(machine: Path | str | None = None) -> Machine:
    """Read a machine file.

    Parameters
    ----------
    machine
        Name of a shipped machine, folder or machine file; the laboratory crane by default.

    Returns
    -------
    The validated machine.

    Raises
    ------
    ConfigurationError
        If there is no such machine, or its file is wrong: each wrong key with file, line and value.

    Examples
    --------
    >>> load_machine().limits["telescope"].position_max  # m
    1.55
    """
    return load(machine_file("machine.yaml", machine), Machine)


def parse_pose(words: Sequence[str], machine: Machine, rest: np.ndarray) -> np.ndarray:
    """(j,) coordinates [rad, m] from words JOINT=VALUE; joints that are not named are at `rest`.

    `RangeError` where a word is none of these.
    """
    q = rest.copy()
    for word in words:
        joint, _, value = word.partition("=")
        if joint not in machine.joint_names:
            raise RangeError(
                f"pose '{word}': no joint '{joint}'; write JOINT=VALUE with a joint of "
                f"{', '.join(machine.joint_names)} and its position in rad or m"
            )
        try:
            q[machine.index(joint)] = float(value)
        except ValueError:
            raise RangeError(
                f"pose '{word}': '{value}' is not a number; write {joint}=0.5"
            ) from None
    return q


__all__ = [
    "WEIGHED",
    "DenavitHartenberg",
    "HydraulicSupply",
    "JointLimits",
    "Machine",
    "MachineJoint",
    "Origin",
    "PlanarCrane",
    "load_machine",
    "parse_pose",
]
