"""A machine at work, as its sensors show it, and how they begin to lie."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from crane_model import Model, load_machine
from crane_model.hydraulics import (
    ChamberValues,
    HydraulicValues,
    JointHydraulics,
    Measured,
    SupplyValues,
    ValveValues,
)
from crane_observer import SensorWatch
from crane_observer.monitor.tolerance import Tolerance
from crane_sim import SimulatedCrane

ONSET = 14.0  # s, when all joints move
REFINED = 2.2  # s after which kind and size of a finding have been looked at again


@dataclass(frozen=True)
class Heard:
    """What sensors showed, of the joints of the model; commands too."""

    time: np.ndarray
    q: np.ndarray
    p_a: np.ndarray
    p_b: np.ndarray
    supply: np.ndarray
    command: np.ndarray

    def into(self, watched: SensorWatch) -> Iterator[None]:
        for k, time in enumerate(self.time.tolist()):
            watched.add_encoders(time, self.q[k])
            watched.add_pressures(time, self.p_a[k], self.p_b[k], float(self.supply[k]))
            watched.add_command(time, self.command[k])
            yield

    def to(self, model: Model, tolerance: Tolerance | None) -> SensorWatch:
        watched = SensorWatch(model, tolerance)
        for _, time in zip(self.into(watched), self.time, strict=True):
            if watched.monitor.findings and time > watched.monitor.findings[0].found + REFINED:
                break
        return watched


def as_built(simulated: SimulatedCrane) -> HydraulicValues:
    """What an identification would find of it, to the digit."""

    def values(schema: type, numbers: dict[str, float]) -> object:
        units = schema.units  # type: ignore[attr-defined]
        return schema(**{k: Measured(value=v, unit=units[k]) for k, v in numbers.items()})

    joints = {}
    for joint, valve in simulated.valves.items():
        inside = simulated.cylinders[joint]
        gain = valve.rated_flow / np.sqrt(valve.rated_drop)
        frequency = 2.0 * np.pi * valve.natural_frequency
        edges = dict.fromkeys(("supply_a", "a_tank", "supply_b", "b_tank"), gain)
        spool = values(ValveValues, {
            "dead_band_a": valve.dead_band, "dead_band_b": valve.dead_band, "hysteresis": 0.0,
            "lag": 2.0 * valve.damping_ratio / frequency, "natural_frequency": frequency,
            "damping_ratio": valve.damping_ratio, **edges,
        })  # fmt: skip
        chambers = values(ChamberValues, {
            "bulk_modulus": simulated.oil.bulk_modulus, "leakage": inside.leakage,
            "dead_volume_a": inside.dead_volume_a, "dead_volume_b": inside.dead_volume_b,
        })  # fmt: skip
        joints[joint] = JointHydraulics(valve=spool, chambers=chambers, unexplained=0.0)
    machine = load_machine().hydraulics
    droop = simulated.supply.pump_droop / machine.pump_flow
    supply = values(SupplyValues, {"pressure": machine.supply_pressure, "droop": droop})
    return HydraulicValues(provenance="as built", joints=joints, supply=supply)


Lie = Callable[[Heard, int], Heard]


def changed(name: str, wrong: Callable[[np.ndarray, np.ndarray], np.ndarray]) -> Lie:
    """From ONSET on, the column of a signal is what `wrong` makes of it and the time since then."""

    def lie(true: Heard, column: int) -> Heard:
        values = np.array(getattr(true, name))
        on = true.time >= ONSET
        part = values[on] if values.ndim == 1 else values[on, column]
        shown = wrong(part, true.time[on] - ONSET)
        if values.ndim == 1:
            values[on] = shown
        else:
            values[on, column] = shown
        return replace(true, **{name: values})

    return lie


def exchanged(true: Heard, column: int) -> Heard:
    on = true.time >= ONSET
    p_a, p_b = true.p_a.copy(), true.p_b.copy()
    p_a[on, column], p_b[on, column] = true.p_b[on, column], true.p_a[on, column]
    return replace(true, p_a=p_a, p_b=p_b)
