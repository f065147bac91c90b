"""The parameters of a simulated crane, from one YAML file, and cranes drawn about it."""

import argparse
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal, Self

import numpy as np
import yaml
from pydantic import Field, model_validator

from crane_model.actuators import CylinderActuator
from crane_model.cli import between
from crane_model.configuration import NonNegative, Positive, Schema, load, read_yaml, validate
from crane_model.errors import ConfigurationError
from crane_model.machine import Machine, MachineJoint, load_machine
from crane_model.machine_files import machine_file, of_every_joint
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
    """LuGre parameters of one joint, in addition to (13)."""

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


class SimulatedValve(Schema):
    """A valve: dead time, second-order spool, overlap, four metering edges.

    The dead time falls from `dead_time + cold_dead_time` to `dead_time` as the machine warms up.
    """

    rated_flow: Positive  # m3/s, fully open
    rated_drop: Positive  # Pa over one metering edge
    natural_frequency: Positive  # Hz
    damping_ratio: Positive
    rate_limit: Positive  # strokes per s
    dead_band: Fraction  # of the stroke, to either side of the null
    null_bias: float = 0.0  # of the stroke, positive moves the joint up: where the null lies
    dead_time: NonNegative = 0.0  # s, of a warm machine, from a command to the spool
    cold_dead_time: NonNegative = 0.0  # s, that a cold one has more
    edges: Edges = Edges()

    @model_validator(mode="after")
    def _closed_at_rest(self) -> Self:
        if abs(self.null_bias) > self.dead_band:
            raise ValueError(
                f"null_bias is {self.null_bias}, at most dead_band, {self.dead_band}, to either "
                "side: the valve of a centred spool would be open"
            )
        return self


class CylinderInside(Schema):
    """Internal parameters of a cylinder."""

    dead_volume_a: Positive  # m3, with hose
    dead_volume_b: Positive
    leakage: NonNegative  # m3/s/Pa past the piston
    stop_stiffness: Positive  # N/m at the end of the stroke
    stop_damping: NonNegative  # s/m, Hunt and Crossley


class SimulatedOil(Schema):
    """How stiff the oil is, where its flow is laminar, and how long it takes to warm up."""

    bulk_modulus: Positive  # Pa, with hoses and air
    laminar_drop: Positive  # Pa, below it an orifice is laminar
    warming: Positive = 1200.0  # s, time constant


class Supply(Schema):
    """Pump, supply line and relief valve, beside what the machine file says of them."""

    volume: Positive  # m3
    pump_droop: Positive  # Pa from no delivery to all of it
    relief_gain: Positive  # m3/s/Pa
    check_valve_gain: NonNegative  # m3/s/sqrt(Pa), make-up flow into a chamber below tank pressure
    port_relief: Positive = (
        1e12  # Pa, where relief valves of the chambers open; 1e12: there are none
    )


class SimulatedCrane(Schema):
    """The simulated crane; geometry, linkages, areas and pump are in the machine file."""

    name: str
    rest_pose: Mapping[str, float]  # rad, m
    bodies: Mapping[str, Body]
    friction: Mapping[str, CoulombViscous]
    dynamic_friction: Mapping[str, Bristles] | None = None
    valves: Mapping[str, SimulatedValve]
    cylinders: Mapping[str, CylinderInside]
    oil: SimulatedOil
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
                    f"{source}: a simulated crane has hydraulic actuators only, but {joint} of "
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


def load_simulated_crane(
    path: Path | str | None = None, machine: Machine | None = None, joints: Path | None = None
) -> SimulatedCrane:
    """Read the parameters of a simulated crane.

    A file with the key `base` (another file, relative to this one) holds only what differs from
    that file, which may not have a base itself. The density of the jerk, if it is not in there, is
    that of the notes on the joints.

    Parameters
    ----------
    path
        YAML file; by default that of the laboratory crane.
    machine
        Machine that it belongs to; by default the laboratory crane.
    joints
        Notes on the joints of the machine; by default those beside the complete file.

    Returns
    -------
    The parameters, with all that is said of joints in the order of the machine.

    Raises
    ------
    ConfigurationError
        If a file is wrong, or is that of another machine.
    """
    path = Path(path or machine_file("simulated_crane.yaml"))
    content, complete = read_yaml(path), path
    if isinstance(content, dict) and "base" in content:
        difference = {key: value for key, value in content.items() if key != "base"}
        complete = path.parent / str(content["base"])
        base = read_yaml(complete)
        if not isinstance(base, dict) or "base" in base:
            raise ConfigurationError(
                f"{path}: key 'base': must name a complete file, one without a base; "
                f"got {content['base']!r}"
            )
        content = _merged(base, difference)
    if isinstance(content, dict) and "jerk_density" not in content:
        notes = load(joints or complete.with_name(JOINTS_FILE), JointNotes).root
        densities = {joint: note.jerk_density for joint, note in notes.items()}
        content = content | {"jerk_density": densities}
    return validate(content, SimulatedCrane, path).of(machine or load_machine(), path)


def add_plant(parser: argparse.ArgumentParser) -> None:
    """`--plant`, the file of the simulated crane."""
    parser.add_argument(
        "--plant",
        type=Path,
        help="file of the simulated crane (default: simulated_crane.yaml of the machine)",
    )


MAX_RUNNING_S = 1e7  # four months


def add_running(parser: argparse.ArgumentParser) -> None:
    """`--running`, for how long the simulated crane has been on."""
    parser.add_argument(
        "--running",
        type=between(0.0, MAX_RUNNING_S),
        default=0.0,
        metavar="SECONDS",
        help="time since the start of the machine [s] (default: 0, a cold machine)",
    )


def load_both(machine: str | None, plant: Path | None) -> tuple[Machine, SimulatedCrane]:
    """Machine and simulated crane of `--machine` and `--plant`; `ConfigurationError` if wrong."""
    known = load_machine(machine)
    joints = machine_file("machine.yaml", machine).with_name(JOINTS_FILE)
    return known, load_simulated_crane(
        machine_file("simulated_crane.yaml", machine, plant), known, joints
    )


def save_simulated_crane(path: Path | str, simulated: SimulatedCrane) -> None:
    """Write a complete file that `load_simulated_crane` reads back.

    Parameters
    ----------
    path
        YAML file to write, or to write over.
    simulated
        Parameters of the simulated crane.
    """
    text = yaml.safe_dump(simulated.model_dump(mode="json", exclude_none=True), sort_keys=False)
    Path(path).write_text(text, encoding="utf-8")


def _merged(base: dict[str, Any], difference: dict[str, Any]) -> dict[str, Any]:
    """`base` with the values of `difference` in the place of its own, at any depth."""
    merged = dict(base)
    for key, value in difference.items():
        nested = isinstance(value, dict) and isinstance(merged.get(key), dict)
        merged[key] = _merged(merged[key], value) if nested else value
    return merged


# Other cranes of the same make: with parameters drawn about those of one.

LESS_OVERLAP = 0.15
"""Of a dead band, at most: how far a drawn one falls short of it. None is larger, so that what a
controller compensates, and a data sheet calls usual, holds for every drawn machine."""


def vary(simulated: SimulatedCrane, seed: int, spread: float = 0.15) -> SimulatedCrane:
    """Bodies, friction, leakage and oil each within +-spread of those of `simulated`, evenly drawn.

    Inertia follows the mass of its body; centres of mass move along the x axis of the body only, so
    that the base parameters of `true_parameters` stay defined. Friction keeps dissipating; valves
    (see `vary_valves`), sensors and geometry stay. The same seed gives the same machine.
    """
    rng = np.random.default_rng(seed)

    def factor() -> float:
        return float(rng.uniform(1.0 - spread, 1.0 + spread))

    def body(given: Body) -> Body:
        heavier, (along, *across) = factor(), given.centre_of_mass
        return given.model_copy(
            update={
                "mass": given.mass * heavier,
                "centre_of_mass": (along * factor(), *across),
                "inertia": tuple(moment * heavier for moment in given.inertia),
                "products": tuple(product * heavier for product in given.products),
            }
        )

    friction = {
        joint: given.model_copy(
            update={
                "f_c": given.f_c * (dry := factor()),
                "df_c": given.df_c * dry * factor(),
                "f_v": given.f_v * (wet := factor()),
                "df_v": given.df_v * wet * factor(),
            }
        )
        for joint, given in simulated.friction.items()
    }
    cylinders = {
        joint: given.model_copy(update={"leakage": given.leakage * factor()})
        for joint, given in simulated.cylinders.items()
    }
    oil = simulated.oil
    return simulated.model_copy(
        update={
            "name": f"{simulated.name}, drawn with seed {seed}",
            "bodies": {name: body(given) for name, given in simulated.bodies.items()},
            "friction": friction,
            "cylinders": cylinders,
            "oil": oil.model_copy(update={"bulk_modulus": oil.bulk_modulus * factor()}),
        }
    )


def vary_valves(
    simulated: SimulatedCrane, machine: Machine, seed: int, scatter: float = 0.05
) -> SimulatedCrane:
    """Valves made for differential cylinders, drawn: unequal edges, unequal dead bands.

    The gain of an edge is proportional to the area of its chamber, and within +-scatter of that,
    evenly drawn; the cylinder moves as fast as with equal edges. The dead bands of the two
    directions lie up to `LESS_OVERLAP` below the one of `simulated`. The same seed gives the same
    valves.
    """
    rng = np.random.default_rng([seed, 4])  # not the draws of `vary`

    def valve(joint: str) -> SimulatedValve:
        given, cylinder = simulated.valves[joint], machine.cylinders[joint]
        area_a, area_b = cylinder.area_a, cylinder.area_b
        mean = float(np.hypot(area_a, area_b)) / np.sqrt(2.0)

        def share(area: float) -> float:
            return float(area / mean * rng.uniform(1.0 - scatter, 1.0 + scatter))

        edges = Edges(
            supply_a=share(area_a),
            a_tank=share(area_a),
            supply_b=share(area_b),
            b_tank=share(area_b),
        )
        up, down = given.dead_band * rng.uniform(1.0 - LESS_OVERLAP, 1.0, 2)
        return given.model_copy(
            update={
                "edges": edges,
                "dead_band": float(up + down) / 2.0,
                "null_bias": float(up - down) / 2.0,
            }
        )

    return simulated.model_copy(
        update={"valves": {joint: valve(joint) for joint in simulated.valves}}
    )


def vary_geometry(machine: Machine, seed: int, spread: float) -> Machine:
    """The machine as it was built: not of quite the lengths that its file says.

    The linkage of each cylinder that turns a joint is larger or smaller as a whole, and so is each
    link (a, d of its row of Table 1): factors within +-spread, evenly drawn. Pins that err one by
    one are left out: a four-bar linkage would often not assemble. Piston areas stay, and so does
    what bounds the joints. The same seed gives the same machine.
    """
    rng = np.random.default_rng([seed, 8])  # not the draws of `vary`

    def built(joint: MachineJoint) -> MachineJoint:
        of_linkage, of_link = rng.uniform(1.0 - spread, 1.0 + spread, 2)
        given, row = joint.actuator, joint.dh
        update: dict[str, object] = {}
        if isinstance(given, CylinderActuator) and given.bounded_by_pins:
            update["actuator"] = type(given).model_validate(
                given.model_dump(by_alias=True)
                | {name: of_linkage * getattr(given, name) for name in _lengths(given)}
            )
        if row is not None:
            update["dh"] = row.model_copy(update={"a": row.a * of_link, "d": row.d * of_link})
        return joint.model_copy(update=update)

    return Machine.model_validate(
        machine.model_dump(by_alias=True)
        | {"joints": [built(joint).model_dump(by_alias=True) for joint in machine.joints]}
    )


def _lengths(actuator: CylinderActuator) -> list[str]:
    """The fields that are lengths of the linkage or of the cylinder [m]."""
    angles = ("phi_3", "phi_4", "beta_1", "gamma_25", "pin_rise")
    fixed = ("count", "mirrored", "type", "pressure_sensors", "area_a_of_one", "area_b_of_one")
    return [name for name in type(actuator).model_fields if name not in (*angles, *fixed)]


def vary_hydraulics(simulated: SimulatedCrane, seed: int, spread: float) -> SimulatedCrane:
    """Valves as quick and as large as others of their make, other hoses and another supply line.

    Spools and rated flows, dead volumes and the supply line each within +-spread, evenly drawn. The
    same seed gives the same ones.
    """
    rng = np.random.default_rng([seed, 9])

    def factor() -> float:
        return float(rng.uniform(1.0 - spread, 1.0 + spread))

    def scaled(given: Schema, *names: str) -> Any:
        return given.model_copy(update={name: getattr(given, name) * factor() for name in names})

    valves, cylinders = simulated.valves.items(), simulated.cylinders.items()
    return simulated.model_copy(
        update={
            "valves": {
                joint: scaled(valve, "natural_frequency", "damping_ratio", "rated_flow")
                for joint, valve in valves
            },
            "cylinders": {
                joint: scaled(cylinder, "dead_volume_a", "dead_volume_b")
                for joint, cylinder in cylinders
            },
            "supply": scaled(simulated.supply, "volume", "pump_droop"),
        }
    )


def vary_sensors(simulated: SimulatedCrane, seed: int, spread: float) -> SimulatedCrane:
    """Transducers that are more or less noisy, and a clock that jitters more or less: within
    +-spread, evenly drawn. Encoders, range and converter are those of the data sheet.
    """
    noisier, later = np.random.default_rng([seed, 10]).uniform(1.0 - spread, 1.0 + spread, 2)
    chain = simulated.sensors
    update = {
        "pressure_noise": chain.pressure_noise * float(noisier),
        "jitter": chain.jitter * float(later),
    }
    return simulated.model_copy(update={"sensors": chain.model_copy(update=update)})
