"""Simulated cranes to be controlled."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from crane_model import Machine, load_machine
from crane_model.machine_files import DEFAULT_MACHINE, machine_file
from crane_sim import SimulatedCrane, load_simulated_crane
from crane_sim.effects.form import InjectedForm
from crane_sim.effects.kernel import FORMS
from crane_sim.parts.parameters import Edges


class Controlled(NamedTuple):
    """A machine, its simulated crane and injected effects; its files are in the folder `name`."""

    machine: Machine
    simulated: SimulatedCrane
    hidden: tuple[InjectedForm, ...] = ()
    name: str = DEFAULT_MACHINE

    @property
    def joints(self) -> tuple[str, ...]:
        """From the base to the tip."""
        return self.machine.joint_names

    @property
    def measured(self) -> tuple[str, ...]:
        """The joints whose cylinders have pressure transducers."""
        actuators = self.machine.cylinders
        return tuple(joint for joint in self.joints if actuators[joint].pressure_sensors)

    def hiding(
        self, effect: str, values: Sequence[float], joints: Sequence[str] | None = None
    ) -> "Controlled":
        """With an effect more, on all joints with transducers or on `joints`."""
        form = FORMS[effect][0]
        more = tuple(InjectedForm(form, one, tuple(values)) for one in joints or self.measured)
        return self._replace(hidden=(*self.hidden, *more))


def stock(name: str = DEFAULT_MACHINE, simulated: str = "simulated_crane.yaml") -> Controlled:
    """As its files have it."""
    machine = load_machine(name)
    return Controlled(
        machine, load_simulated_crane(machine_file(simulated, name), machine), name=name
    )


def loaded(mass: float) -> Controlled:
    """With a mass [kg] in the gripper."""
    machine = stock()
    gripper = machine.simulated.bodies["gripper"]
    heavy = gripper.model_copy(update={"mass": gripper.mass + mass})
    bodies = {**machine.simulated.bodies, "gripper": heavy}
    return machine._replace(simulated=machine.simulated.model_copy(update={"bodies": bodies}))


def hard(frequency: float, play: float, spread: float, seed: int = 3) -> Controlled:
    """Dynamic friction, slow valves [Hz] with play, the gains of their edges unequal by a share."""
    machine = stock(simulated="simulated_crane_dynamic_friction.yaml")
    rng = np.random.default_rng(seed)

    def edges() -> Edges:
        return Edges(**{name: rng.uniform(1 - spread, 1 + spread) for name in Edges.model_fields})

    valves = {
        joint: valve.model_copy(update={"natural_frequency": frequency, "edges": edges()})
        for joint, valve in machine.simulated.valves.items()
    }
    simulated = machine.simulated.model_copy(update={"valves": valves})
    return machine._replace(simulated=simulated).hiding("valve_hysteresis", [play])


def bending(share: float = 0.3, frequency: float = 3.0, damping: float = 0.05) -> Controlled:
    """Booms of which a share rides on springs."""
    values = (share, frequency, damping)
    return stock().hiding("boom_flexibility", values, ["inner_boom", "outer_boom"])


def other_laws(
    laminar: float = 3.0e6, band: float = 0.01, leak: float = 4.0e-9, air: float = 0.01
) -> Controlled:
    """Valves and oil whose laws are not those of the controllers.

    Flow that is in proportion to drops well below `laminar` [Pa] and to their root only well above
    it, edges that open gradually over a `band` of the stroke, leaks past the pistons that grow with
    the root of the drop [m3/s/sqrt(Pa)], and a share of air that makes the oil softer at low
    pressure.
    """
    machine = stock()
    oil = machine.simulated.oil.model_copy(update={"laminar_drop": laminar})
    machine = machine._replace(simulated=machine.simulated.model_copy(update={"oil": oil}))
    machine = machine.hiding("valve_dead_band", [band, 0.5 * band])
    return machine.hiding("internal_leakage", [leak]).hiding("air_in_oil", [air])
