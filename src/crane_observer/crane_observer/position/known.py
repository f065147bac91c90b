"""The model as the filter uses it."""

from dataclasses import dataclass

import numpy as np

from crane_model.array import Array
from crane_model.hydraulics.stepping import Circuit
from crane_model.model_file import Model
from crane_model.whole_crane import circuit_of
from crane_observer.position.balance import LoadedMechanics
from crane_observer.position.state import StateLayout, Trust

STANDING = 0.02  # of the fastest that a joint may move, below which it counts as standing
SMALLEST = 1e-12  # of any unit, where nothing may be 0


@dataclass(frozen=True)
class Known:
    """Of j joints."""

    mechanics: LoadedMechanics
    circuit: Circuit
    layout: StateLayout
    low: Array  # (j,) the ends of each joint
    high: Array  # (j,)
    fastest: Array  # (j,) that each may move
    resolution: Array  # (j,) standard deviation of an encoder
    trust: Trust

    @classmethod
    def of(cls, model: Model, resolution: Array, trust: Trust | None = None) -> "Known":
        """`ConfigurationError` names what the model lacks."""
        mechanics, circuit = LoadedMechanics.of(model), circuit_of(model)
        limits = [mechanics.machine.limits[joint] for joint in model.joints]
        return cls(
            mechanics,
            circuit,
            StateLayout(len(model.joints)),
            np.array([one.position_min for one in limits]),
            np.array([one.position_max for one in limits]),
            np.array([min(-one.velocity_min, one.velocity_max) for one in limits]),
            resolution,
            trust or Trust.of(model),
        )

    @property
    def standing(self) -> Array:
        """(j,) speed below which a joint stands."""
        return STANDING * self.fastest
