"""A plant that is put into a state, to see what hidden effects do there."""

from typing import NamedTuple

import numpy as np

from crane_model.machine import JOINTS, Machine
from crane_sim.effects.form import Planted
from crane_sim.effects.forms import FORMS
from crane_sim.effects.kernel import act, settle
from crane_sim.effects.working import Hidden, packed
from crane_sim.parts.constants import Constants, pack
from crane_sim.parts.cylinders import set_lengths_and_levers
from crane_sim.parts.parameters import StandIn
from crane_sim.parts.rigid_bodies import mass_and_bias
from crane_sim.parts.state import ACTUATOR, Scratch, State

STEP = 2e-4  # s


def planted(effect: str, joint: str | None, *values: float, form: str | None = None) -> Planted:
    """An effect with all its parameters."""
    forms = FORMS[effect]
    law = next((entry for entry in forms if entry.name == form), forms[0])
    assert len(values) == 1 + len(law.draws)
    return Planted(law, joint, values)


class Rig(NamedTuple):
    """One instant of a machine with hidden effects."""

    constants: Constants
    hidden: Hidden
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
        act(self.hidden, self.constants, self.state, self.scratch, STEP)

    def settle(self, v: np.ndarray | None = None) -> np.ndarray:
        """(k, 4) forces of the effects once the velocities have become `v` (4,)."""
        if v is not None:
            self.state.v[:] = v
        settle(self.hidden, self.constants, self.state, self.scratch, STEP)
        return self.hidden.force.copy()


def rig(stand_in: StandIn, machine: Machine, *effects: Planted) -> Rig:
    """At rest in its rest pose."""
    constants = pack(stand_in, machine)
    actuators = np.zeros(len(JOINTS), np.dtype([(name, float) for name in ACTUATOR]))
    actuators["p_a"], actuators["p_b"] = [4e6, 6e6, 5e6, 3e6], [3e6, 2e6, 4e6, 5e6]
    state = State(
        q=np.zeros(4),
        v=np.zeros(4),
        mode=np.zeros(4, dtype=np.int64),
        bristle=np.zeros(4),
        actuators=actuators,
        supply=np.array([17e6]),
    )
    scratch = Scratch(
        mass=np.zeros((4, 4)),
        bias=np.zeros(4),
        force=np.zeros(4),
        impulse=np.zeros(4),
        friction=np.zeros((5, 4)),
        growth=np.zeros(4),
        before=np.zeros(4),
        law=constants.friction.copy(),
    )
    hidden = packed(effects, machine)
    assert hidden is not None
    made = Rig(constants, hidden, state, scratch)
    made.put(stand_in.start, np.zeros(4))
    return made
