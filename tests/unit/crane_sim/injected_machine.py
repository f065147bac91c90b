"""A plant that is put into a state, to see what injected effects do there."""

from typing import NamedTuple

import numpy as np

from crane_model import Machine
from crane_sim import SimulatedCrane
from crane_sim.effects.form import Injected, InjectedForm, packed
from crane_sim.effects.kernel import FORMS, act, settle
from crane_sim.parts.constants import Constants, Scratch, State, at_rest, pack, room
from crane_sim.parts.cylinders import set_lengths_and_levers
from crane_sim.parts.rigid_bodies import Chain, mass_and_bias

STEP = 2e-4  # s


def inverse_dynamics(chain: Chain, q: np.ndarray, v: np.ndarray, a: np.ndarray) -> np.ndarray:
    """Generalized forces (j,) of (6) that give the acceleration a (j,) at q, v (j,)."""
    mass, bias = np.empty((len(q), len(q))), np.empty(len(q))
    mass_and_bias(chain, q, v, mass, bias)
    return mass @ a + bias


def effect_of(
    effect: str, joint: str | None, *values: float, form: str | None = None
) -> InjectedForm:
    """An effect with all its parameters."""
    forms = FORMS[effect]
    law = next((entry for entry in forms if entry.name == form), forms[0])
    assert len(values) == 1 + len(law.draws)
    return InjectedForm(law, joint, values)


class Rig(NamedTuple):
    """One instant of a machine with injected effects."""

    constants: Constants
    injected: Injected
    state: State
    scratch: Scratch

    def put(self, q: np.ndarray, v: np.ndarray, drive: np.ndarray | None = None) -> None:
        """At a pose, with velocities and forces of the drives before any step."""
        self.state.q[:], self.state.v[:] = q, v
        self.scratch.before[:] = v
        set_lengths_and_levers(self.constants.linkages, self.state.q, self.state.actuators)
        mass_and_bias(self.constants.chain, q, v, self.scratch.mass, self.scratch.bias)
        self.scratch.force[:] = 0.0 if drive is None else drive

    def act(self) -> None:
        """What the effects do before the velocities are found."""
        act(self.injected, self.constants, self.state, self.scratch, STEP)

    def settle(self, v: np.ndarray | None = None) -> np.ndarray:
        """(k, 4) forces of the effects once the velocities have become `v` (4,)."""
        if v is not None:
            self.state.v[:] = v
        settle(self.injected, self.constants, self.state, self.scratch, STEP)
        return self.injected.force.copy()


def rig(simulated: SimulatedCrane, machine: Machine, *effects: InjectedForm) -> Rig:
    """At rest in its rest pose."""
    constants = pack(simulated, machine)
    state = at_rest(simulated.start, 17e6)
    state.actuators["p_a"], state.actuators["p_b"] = [4e6, 6e6, 5e6, 3e6], [3e6, 2e6, 4e6, 5e6]
    injected = packed(effects, machine)
    assert injected is not None
    made = Rig(constants, injected, state, room(constants.friction))
    made.put(simulated.start, np.zeros(4))
    return made
