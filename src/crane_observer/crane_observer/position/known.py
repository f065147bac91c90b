"""The model as the filter uses it."""

from dataclasses import dataclass

import numpy as np

from crane_model.array import Array, Flags
from crane_model.hydraulics.stepping import Circuit
from crane_model.model_file import Model
from crane_model.whole_crane import circuit_of
from crane_observer.position.assumed import GAIN_DOUBT, GAIN_STAYS, LOAD_DRIFT, STROKE_DOUBT, Served
from crane_observer.position.balance import LoadedMechanics
from crane_observer.position.state import (
    EXTENDING,
    NULL,
    RETRACTING,
    UNEVEN,
    StateLayout,
    Trust,
    flow_share,
    null_deviation,
)

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
    flow: Array  # (j,) share of the deviations of flow that its identification leaves
    null: Array  # (j,) of the stroke, standard deviation of the null of each valve
    assumed: Flags  # (j,) whose valve is not identified

    @classmethod
    def of(cls, model: Model, resolution: Array, trust: Trust | None = None) -> "Known":
        """`ConfigurationError` names what the model lacks."""
        model, assumed = Served.of(model)
        mechanics, circuit = LoadedMechanics.of(model), circuit_of(model)
        limits = [mechanics.machine.limits[joint] for joint in model.joints]
        trust, flow = trust or Trust.of(model), flow_share(model)
        return cls(
            mechanics,
            circuit,
            StateLayout(len(model.joints)),
            np.array([one.position_min for one in limits]),
            np.array([one.position_max for one in limits]),
            np.array([min(-one.velocity_min, one.velocity_max) for one in limits]),
            resolution,
            trust,
            flow,
            # what flow deviates by is mostly noise where it is little
            null_deviation(model, trust.null * flow**2),
            assumed,
        )

    @property
    def spread(self) -> Array:
        """(size,) standard deviations of states of which nothing is known, as `Trust.spread`."""
        found = self.trust.spread(self.layout)
        uneven = UNEVEN * self.trust.transducer / self.circuit.supply_pressure
        for kind in (EXTENDING, RETRACTING):
            gain = found[self.layout.of(kind)] * self.flow
            found[self.layout.of(kind)] = np.hypot(gain, uneven)
        found[self.layout.of(NULL)] = self.null
        for kind in (EXTENDING, RETRACTING):
            found[self.layout.of(kind)][self.assumed] = GAIN_DOUBT
        return found

    @property
    def stay(self) -> Array:
        """(size,) s that errors stay, as `Trust.stay`."""
        found = self.trust.stay(self.layout)
        for kind in (EXTENDING, RETRACTING):
            found[self.layout.of(kind)][self.assumed] = GAIN_STAYS
        return found

    @property
    def load_drift(self) -> float:
        """kg/sqrt(s): where a valve is not identified, no surprise tells that a load has come."""
        return LOAD_DRIFT if self.assumed.any() else self.trust.load_drift

    @property
    def stroke(self) -> Array:
        """(j,) of a window's stroke, standard deviation beside those of gains and nulls."""
        return np.where(self.assumed, STROKE_DOUBT, self.trust.stroke * self.flow)

    @property
    def standing(self) -> Array:
        """(j,) speed below which a joint stands."""
        return STANDING * self.fastest
