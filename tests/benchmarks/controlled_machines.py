"""Stand-in machines to be controlled, each with what its controller knows of it."""

from typing import NamedTuple

import numpy as np

from crane_model.cylinders import lever_arm
from crane_model.machine import Machine, load_machine
from crane_model.machine_files import machine_file
from crane_model.model_file import Model, load_model
from crane_sim.effects.form import Planted
from crane_sim.effects.forms import FORMS
from crane_sim.parts.parameters import Edges, StandIn, load_stand_in
from crane_sim.planted import planted
from crane_trajectory.control.valves_and_oil import ValvesAndOil

MACHINE: Machine = load_machine()
JOINTS = MACHINE.joint_names
STAND_IN = load_stand_in()
MEASURED = tuple(joint for joint in JOINTS if MACHINE.cylinders[joint].pressure_sensors)
LAG = 0.010  # s, from a reading until its command is in force, on average


class Known(NamedTuple):
    """What a controller knows."""

    model: Model
    hydraulics: ValvesAndOil

    def wrong_by(self, share: float, seed: int) -> "Known":
        """Every value off by up to a share of it, evenly drawn."""
        rng = np.random.default_rng(seed)
        fixed = {"sense", "area_a", "area_b", "length_min", "length_max", "play"}
        fixed |= {"supply_pressure", "tank_pressure"}

        def off(values: np.ndarray) -> np.ndarray:
            return values * rng.uniform(1.0 - share, 1.0 + share, len(values))

        changed = {
            name: off(values)
            for name, values in self.hydraulics._asdict().items()
            if name not in fixed
        }
        model = self.model
        return Known(
            model.with_estimate(off(model.theta), np.zeros(len(model.theta)), "drawn"),
            self.hydraulics._replace(**changed),
        )


class Controlled(NamedTuple):
    """A machine and what is known of it."""

    stand_in: StandIn
    known: Known
    hidden: tuple[Planted, ...] = ()


def truth(stand_in: StandIn, play: float = 0.0) -> Known:
    """What the file of a stand-in machine says of it."""
    model = load_model(machine_file("model.yaml"))
    theta = np.array([one.value for one in planted(stand_in, MACHINE)])
    model = model.with_estimate(theta, np.zeros(len(theta)), "the file of the stand-in machine")
    valves = [stand_in.valves[joint] for joint in JOINTS]
    actuators = [MACHINE.cylinders[joint] for joint in JOINTS]
    inside = [stand_in.cylinders[joint] for joint in JOINTS]
    arms = [
        lever_arm(MACHINE, joint, np.array([q]))[0]
        for joint, q in zip(JOINTS, stand_in.start, strict=True)
    ]

    def of(rows: list, name: str) -> np.ndarray:
        return np.array([getattr(row, name) for row in rows])

    gain = of(valves, "rated_flow") / np.sqrt(of(valves, "rated_drop"))
    edges = [valve.edges for valve in valves]
    sense, same = np.sign(arms), np.ones(len(JOINTS))
    null = sense * of(valves, "null_bias")
    spool = 2.0 * of(valves, "damping_ratio") / (2.0 * np.pi * of(valves, "natural_frequency"))
    hydraulics = ValvesAndOil(
        sense=sense,
        **{name: of(actuators, name) for name in ("area_a", "area_b", "length_min", "length_max")},
        **{name: of(inside, name) for name in ("dead_volume_a", "dead_volume_b", "leakage")},
        bulk_modulus=stand_in.oil.bulk_modulus * same,
        **{name: gain * of(edges, name) for name in Edges.model_fields},
        dead_zone_extend=of(valves, "dead_zone") + null,
        dead_zone_retract=of(valves, "dead_zone") - null,
        play=play * np.array([joint in MEASURED for joint in JOINTS]),
        lag=spool + LAG,
        supply_pressure=MACHINE.hydraulics.supply_pressure * same,
        tank_pressure=MACHINE.hydraulics.tank_pressure * same,
    )
    return Known(model, hydraulics)


def stock() -> Controlled:
    """As its file has it."""
    return Controlled(STAND_IN, truth(STAND_IN))


def loaded(mass: float) -> Controlled:
    """With a mass [kg] in the gripper, of which its controller is not told."""
    gripper = STAND_IN.bodies["gripper"]
    heavy = gripper.model_copy(update={"mass": gripper.mass + mass})
    bodies = {**STAND_IN.bodies, "gripper": heavy}
    return Controlled(STAND_IN.model_copy(update={"bodies": bodies}), truth(STAND_IN))


def hard(frequency: float, play: float, spread: float, seed: int = 3) -> Controlled:
    """Dynamic friction, slow valves [Hz] with play, the gains of their edges unequal by a share."""
    stand_in = load_stand_in(machine_file("stand_in_dynamic_friction.yaml"))
    rng = np.random.default_rng(seed)

    def edges() -> Edges:
        return Edges(**{name: rng.uniform(1 - spread, 1 + spread) for name in Edges.model_fields})

    valves = {
        joint: stand_in.valves[joint].model_copy(
            update={"natural_frequency": frequency, "edges": edges()}
        )
        for joint in JOINTS
    }
    stand_in = stand_in.model_copy(update={"valves": valves})
    form = FORMS["valve_hysteresis"][0]
    hidden = tuple(Planted(form, joint, (play,)) for joint in MEASURED)
    return Controlled(stand_in, truth(stand_in, play), hidden)


def bending(share: float = 0.3, frequency: float = 3.0, damping: float = 0.05) -> Controlled:
    """Booms of which a share rides on springs."""
    form = FORMS["boom_flexibility"][0]
    values = (share, frequency, damping)
    hidden = tuple(Planted(form, joint, values) for joint in ("inner_boom", "outer_boom"))
    return Controlled(STAND_IN, truth(STAND_IN), hidden)
