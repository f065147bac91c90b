"""Everything that the stand-in machine hides from the identification, from one YAML file."""

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal, Self

import numpy as np
import yaml
from pydantic import Field, model_validator

from crane_model.configuration import NonNegative, Positive, Schema, load, read_yaml, validate
from crane_model.errors import ConfigurationError
from crane_model.joint_tables import of_every_joint
from crane_model.machine import Machine, load_machine
from crane_model.machine_files import machine_file
from crane_model.sensors import SensorChain
from crane_nodes.joint_notes import JointNotes

JOINTS_FILE = "joints.yaml"
Fraction = Annotated[float, Field(ge=0, lt=1)]


class Body(Schema):
    """A rigid body, fixed to a link, in axes of its own.

    They are at `origin` in the frame of the link [m], and point along its axes as `axes` says:
    zxy has x along that of z, y along x and z along y.
    """

    link: str  # the joint that moves it first
    origin: tuple[float, float, float] = (0.0, 0.0, 0.0)
    axes: Literal["xyz", "yzx", "zxy"] = "xyz"
    mass: Positive  # kg
    centre_of_mass: tuple[float, float, float]  # m
    inertia: tuple[Positive, Positive, Positive]  # kg m2 about it: xx, yy, zz
    products: tuple[float, float, float] = (0.0, 0.0, 0.0)  # xy, xz, yz of the same tensor

    @property
    def tensor(self) -> np.ndarray:
        """(3, 3) inertia about the centre of mass [kg m2]."""
        (xx, yy, zz), (xy, xz, yz) = self.inertia, self.products
        return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])

    @property
    def rotation(self) -> np.ndarray:
        """(3, 3) whose columns are the axes in the frame of the link."""
        return np.eye(3)[:, ["xyz".index(axis) for axis in self.axes]]

    @model_validator(mode="after")
    def _realizable(self) -> Self:
        smallest, middle, largest = np.linalg.eigvalsh(self.tensor)
        if smallest <= 0.0 or largest > (smallest + middle) * (1.0 + 1e-12):
            raise ValueError(
                f"inertia {self.inertia}: the largest principal moment, {largest:.6g}, may not "
                f"exceed the sum of the other two, {smallest:.6g} and {middle:.6g}, all positive; "
                "no mass distribution has these values"
            )
        return self


class CoulombViscous(Schema):
    """Parameters of (13) of one joint [N m, N m s/rad; telescope N, N s/m]."""

    f_c: Positive
    df_c: float
    f_v: Positive
    df_v: float

    @model_validator(mode="after")
    def _dissipates(self) -> Self:
        for mean, difference in (("f_c", "df_c"), ("f_v", "df_v")):
            if abs(getattr(self, difference)) >= getattr(self, mean):
                raise ValueError(
                    f"{difference} = {getattr(self, difference)} must be smaller than "
                    f"{mean} = {getattr(self, mean)}: friction must brake in both directions"
                )
        return self


class Bristles(Schema):
    """What LuGre adds to (13) for one joint."""

    stiffness: Positive  # N m/rad or N/m
    damping: NonNegative  # N m s/rad or N s/m
    breakaway_ratio: Annotated[float, Field(ge=1)]  # breakaway over Coulomb friction
    stribeck_velocity: Positive  # rad/s or m/s


class Edges(Schema):
    """Flow through each metering edge of a valve, over the rated flow, by what the edge joins."""

    supply_a: Positive = 1.0
    a_tank: Positive = 1.0
    supply_b: Positive = 1.0
    b_tank: Positive = 1.0


class StandInValve(Schema):
    """A servo valve: second-order spool, overlap, four metering edges."""

    rated_flow: Positive  # m3/s, fully open
    rated_drop: Positive  # Pa over one metering edge
    natural_frequency: Positive  # Hz
    damping_ratio: Positive
    rate_limit: Positive  # strokes per s
    dead_zone: Fraction  # of the stroke, to either side of the null
    null_bias: float = 0.0  # of the stroke, positive moves the joint up: where the null lies
    edges: Edges = Edges()

    @model_validator(mode="after")
    def _closed_at_rest(self) -> Self:
        if abs(self.null_bias) > self.dead_zone:
            raise ValueError(
                f"null_bias is {self.null_bias}, at most dead_zone, {self.dead_zone}, to either "
                "side: the valve of a centred spool would be open"
            )
        return self


class CylinderInside(Schema):
    """What does not show outside of a cylinder."""

    dead_volume_a: Positive  # m3, with hose
    dead_volume_b: Positive
    leakage: NonNegative  # m3/s/Pa past the piston
    stop_stiffness: Positive  # N/m at the end of the stroke
    stop_damping: NonNegative  # s/m, Hunt and Crossley


class StandInOil(Schema):
    """How stiff the oil is, and below which pressure drop its flow is laminar."""

    bulk_modulus: Positive  # Pa, with hoses and air
    laminar_drop: Positive  # Pa, below it an orifice is laminar


class Supply(Schema):
    """Pump, supply line and relief valve, beside what the machine file says of them."""

    volume: Positive  # m3
    pump_droop: Positive  # Pa from no delivery to all of it
    relief_gain: Positive  # m3/s/Pa
    check_valve_gain: NonNegative  # m3/s/sqrt(Pa), make-up flow into a chamber below tank pressure


class StandIn(Schema):
    """The stand-in machine; geometry, linkages, areas and pump are in the machine file."""

    name: str
    rest_pose: Mapping[str, float]  # rad, m
    bodies: Mapping[str, Body]
    friction: Mapping[str, CoulombViscous]
    dynamic_friction: Mapping[str, Bristles] | None = None
    valves: Mapping[str, StandInValve]
    cylinders: Mapping[str, CylinderInside]
    oil: StandInOil
    supply: Supply
    sensors: SensorChain
    jerk_density: Mapping[str, Positive] = {}  # (rad or m)^2/s^5; of joints.yaml where absent
    step: Annotated[float, Field(gt=0, le=5e-4)]  # s

    @property
    def start(self) -> np.ndarray:
        """(j,) the pose in which the machine rests before an experiment [rad, m]."""
        return np.array(list(self.rest_pose.values()))

    def of(self, machine: Machine, source: Path | str) -> Self:
        """Itself, with all that is said of joints in the order of the machine.

        `ConfigurationError` names the keys of `source` where joints are missing or unknown, and
        the joints that it cannot move.
        """
        for joint, actuator in machine.actuators.items():
            if not actuator.has_chambers:
                raise ConfigurationError(
                    f"{source}: a stand-in moves hydraulic actuators only, but {joint} of "
                    f"{machine.name} has one of type {actuator.type}"
                )
        links = [joint.name for joint in machine.joints]
        for name, body in self.bodies.items():
            if body.link not in links:
                raise ConfigurationError(
                    f"{source}: key 'bodies.{name}.link': no joint '{body.link}'; "
                    f"{machine.name} has {', '.join(links)}"
                )
        joints, resolution = machine.joint_names, self.sensors.encoder_resolution
        of_every_joint(resolution, joints, f"{source}: key 'sensors.encoder_resolution'")
        tables = {key: getattr(self, key) for key in OF_JOINTS}
        ordered = {
            key: of_every_joint(table, joints, f"{source}: key '{key}'")
            for key, table in tables.items()
            if table is not None
        }
        return self.model_copy(update=ordered)


OF_JOINTS = ("rest_pose", "friction", "dynamic_friction", "valves", "cylinders", "jerk_density")


def column(table: Mapping[str, Schema], key: str) -> np.ndarray:
    """(j,) the value `key` of every entry of a table with one for each joint."""
    return np.array([getattr(entry, key) for entry in table.values()], dtype=float)


def load_stand_in(
    path: Path | str | None = None,
    machine: Machine | None = None,
    joints: Path | None = None,
) -> StandIn:
    """The stand-in in `path` for a machine, by default that of the laboratory crane.

    `ConfigurationError` if it is wrong, or that of another machine. A file with the key `base`
    (another file, relative to this one) holds only what differs from that file; it may not have a
    base itself. The density of the jerk, if it is not in there, is that of the machine's notes on
    its `joints`, by default those beside the complete file.
    """
    path = Path(path or machine_file("stand_in.yaml"))
    content, complete = read_yaml(path), path
    if isinstance(content, dict) and "base" in content:
        difference = {key: value for key, value in content.items() if key != "base"}
        complete = path.parent / str(content["base"])
        base = read_yaml(complete)
        if not isinstance(base, dict) or "base" in base:
            raise ConfigurationError(
                f"{path}: key 'base': must name a complete stand-in file, one without a base; "
                f"got {content['base']!r}"
            )
        content = _merged(base, difference)
    if isinstance(content, dict) and "jerk_density" not in content:
        notes = load(joints or complete.with_name(JOINTS_FILE), JointNotes).root
        densities = {joint: note.jerk_density for joint, note in notes.items()}
        content = content | {"jerk_density": densities}
    return validate(content, StandIn, path).of(machine or load_machine(), path)


def save_stand_in(path: Path | str, stand_in: StandIn) -> None:
    """As a complete file that `load_stand_in` reads."""
    text = yaml.safe_dump(stand_in.model_dump(mode="json", exclude_none=True), sort_keys=False)
    Path(path).write_text(text, encoding="utf-8")


def _merged(base: dict[str, Any], difference: dict[str, Any]) -> dict[str, Any]:
    """`base` with the values of `difference` in the place of its own, at any depth."""
    merged = dict(base)
    for key, value in difference.items():
        nested = isinstance(value, dict) and isinstance(merged.get(key), dict)
        merged[key] = _merged(merged[key], value) if nested else value
    return merged
