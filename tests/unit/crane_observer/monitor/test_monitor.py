"""A machine at work whose sensors begin to lie: what the monitor says, and when."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np
import pytest

from crane_model.cli import CraneError
from crane_model.errors import ConfigurationError
from crane_model.hydraulics.values import (
    ChamberValues,
    HydraulicValues,
    JointHydraulics,
    Measured,
    SupplyValues,
    ValveValues,
)
from crane_model.machine import load_machine
from crane_model.machine_files import machine_file
from crane_model.model_file import Model, load_model
from crane_observer.monitor.finding import SensorFinding
from crane_observer.monitor.history import Sums, of_block
from crane_observer.monitor.signatures import Part, Wrong
from crane_observer.monitor.tolerance import Tolerance, learn
from crane_observer.monitor.watching import Heed, SensorWatch
from crane_sim.parts.parameters import StandIn, load_stand_in
from crane_sim.plant.closed_loop import record
from crane_sim.plant.plant import Plant
from crane_sim.plant.sampled import Sensors
from crane_trajectory.control.controller import load_gains
from crane_trajectory.motion.check import load_clearance
from crane_trajectory.motion.motion import plan
from crane_trajectory.motion.periodic import load_trajectory

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


def as_built(stand_in: StandIn) -> HydraulicValues:
    """What an identification would find of it, to the digit."""

    def values(schema: type, numbers: dict[str, float]) -> object:
        units = schema.units  # type: ignore[attr-defined]
        return schema(**{k: Measured(value=v, unit=units[k]) for k, v in numbers.items()})

    joints = {}
    for joint, valve in stand_in.valves.items():
        inside = stand_in.cylinders[joint]
        gain = valve.rated_flow / np.sqrt(valve.rated_drop)
        frequency = 2.0 * np.pi * valve.natural_frequency
        edges = dict.fromkeys(("supply_a", "a_tank", "supply_b", "b_tank"), gain)
        spool = values(ValveValues, {
            "dead_zone_a": valve.dead_zone, "dead_zone_b": valve.dead_zone, "hysteresis": 0.0,
            "lag": 2.0 * valve.damping_ratio / frequency, "natural_frequency": frequency,
            "damping_ratio": valve.damping_ratio, **edges,
        })  # fmt: skip
        chambers = values(ChamberValues, {
            "bulk_modulus": stand_in.oil.bulk_modulus, "leakage": inside.leakage,
            "dead_volume_a": inside.dead_volume_a, "dead_volume_b": inside.dead_volume_b,
        })  # fmt: skip
        joints[joint] = JointHydraulics(valve=spool, chambers=chambers, unexplained=0.0)
    machine = load_machine().hydraulics
    droop = stand_in.supply.pump_droop / machine.pump_flow
    supply = values(SupplyValues, {"pressure": machine.supply_pressure, "droop": droop})
    return HydraulicValues(provenance="as built", joints=joints, supply=supply)


@pytest.fixture(scope="module")
def model() -> Model:
    stand_in, machine = load_stand_in(), load_machine()
    bare = load_model(machine_file("model.yaml"))
    known = as_built(stand_in)
    joints = {joint: known.joints[joint] for joint in bare.joints}
    assert bare.machine is not None and bare.machine.name == machine.name
    return replace(bare, hydraulics=known.model_copy(update={"joints": joints}))


@pytest.fixture(scope="module")
def days(model: Model) -> tuple[Heard, Heard]:
    """Half a minute of work, as the same sensors show it on two days: noise alone differs."""
    machine, stand_in = load_machine(), load_stand_in()
    motion = plan(
        machine,
        load_trajectory(machine_file("excitation_20s.yaml")),
        stand_in.start,
        1,
        load_clearance(machine_file("clearance.yaml")),
    )
    gains = load_gains(machine_file("controller.yaml"), machine)
    sensors = Sensors(stand_in.sensors, machine, 3)
    seen = record(motion, Plant(stand_in, machine, motion.start), sensors, gains)
    own, true = [machine.index(joint) for joint in model.joints], seen.truth
    tank = machine.hydraulics.tank_pressure
    supply = seen.pressures.supply
    again = Sensors(stand_in.sensors, machine, 4).pressures(
        true.pressure_a, true.pressure_b, supply, tank
    )
    first, second = (
        Heard(seen.time, seen.position[:, own], one.chamber_a, one.chamber_b, supply,
              seen.command[:, own])
        for one in (seen.pressures, again)
    )  # fmt: skip
    return first, second


@pytest.fixture(scope="module")
def healthy(days: tuple[Heard, Heard]) -> Heard:
    return days[1]


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


NOISE = np.random.default_rng(4).standard_normal(10_000)
LIES: dict[str, tuple[Lie, Part, set[Wrong], float]] = {
    "encoder stuck": (changed("q", lambda x, t: 0 * x + x[0]), Part.ENCODER, {Wrong.STUCK}, 0.3),
    "encoder jumps": (
        changed("q", lambda x, t: x + 3e-3), Part.ENCODER, {Wrong.JUMP, Wrong.SCALE}, 0.3),
    "encoder drifts": (changed("q", lambda x, t: x + 1e-3 * t), Part.ENCODER, {Wrong.DRIFT}, 10.0),
    "encoder scale": (
        changed("q", lambda x, t: x[0] + 1.03 * (x - x[0])), Part.ENCODER, {Wrong.SCALE}, 10.0),
    "encoder noise": (
        changed("q", lambda x, t: x + 1e-3 * NOISE[: len(x)]), Part.ENCODER, {Wrong.NOISE}, 1.0),
    "1 bar too much in A": (
        changed("p_a", lambda x, t: x + 1e5), Part.PRESSURE_A, {Wrong.OFFSET, Wrong.DRIFT}, 60.0),
    "3 bar too little in B": (
        changed("p_b", lambda x, t: x - 3e5), Part.PRESSURE_B, {Wrong.OFFSET, Wrong.DRIFT}, 5.0),
    "A stuck": (changed("p_a", lambda x, t: 0 * x + x[0]), Part.PRESSURE_A, {Wrong.STUCK}, 1.0),
    "noise in B": (
        changed("p_b", lambda x, t: x + 1e5 * NOISE[: len(x)]),
        Part.PRESSURE_B, {Wrong.NOISE}, 1.0),
    "A and B exchanged": (exchanged, Part.PRESSURES, {Wrong.SWAPPED}, 1.0),
    "supply 3 bar too much": (
        changed("supply", lambda x, t: x + 3e5), Part.SUPPLY, {Wrong.OFFSET}, 5.0),
}  # fmt: skip


@pytest.fixture(scope="module")
def tolerance(model: Model, days: tuple[Heard, Heard]) -> Tolerance:
    watched = SensorWatch(model)
    taken = [watched.monitor.take_block() for _ in days[0].into(watched)]
    blocks = [block for block in taken if block is not None]
    added = zip(*(of_block(one) for one in blocks), strict=True)
    sums = Sums(np.array([one.time for one in blocks]), *(np.cumsum(one, axis=0) for one in added))
    return learn(model.joints, [sums] * 2, "the day before")


def first_after(watched: SensorWatch) -> SensorFinding:
    assert watched.monitor.findings, "nothing was found"
    return watched.monitor.findings[0]


def test_nothing_is_found_where_nothing_lies(
    model: Model, healthy: Heard, tolerance: Tolerance
) -> None:
    watched = healthy.to(model, tolerance)
    assert watched.condition is Heed.WATCHING
    assert watched.refused == 0
    assert watched.monitor.findings == []


@pytest.mark.parametrize("name", LIES)
def test_a_sensor_that_lies_is_named(
    model: Model, healthy: Heard, tolerance: Tolerance, name: str
) -> None:
    lie, part, kinds, within = LIES[name]
    finding = first_after(lie(healthy, 0).to(model, tolerance))
    assert (finding.part, finding.joint) == (
        part,
        "supply" if part is Part.SUPPLY else "inner_boom",
    )
    assert 0.0 < finding.found - ONSET < within
    assert finding.kind in kinds
    assert "do not identify" in finding.what_to_do


def test_how_large_a_zero_error_is(model: Model, healthy: Heard, tolerance: Tolerance) -> None:
    lie = changed("supply", lambda x, t: x + 5e5)
    finding = first_after(lie(healthy, 0).to(model, tolerance))
    assert finding.size == pytest.approx(5e5, rel=0.2)
    assert finding.low < finding.size < finding.high


def test_a_valve_that_stays_shut_is_no_encoder(
    model: Model, healthy: Heard, tolerance: Tolerance
) -> None:
    """Nothing moves, whatever it is told."""
    count, rng = 2000, np.random.default_rng(1)
    command = np.zeros((count, 3))
    command[1500:, 0] = 0.2
    p_a, p_b = (np.array([6e6, 7e6, 8e6]) + 1e4 * rng.standard_normal((count, 3)) for _ in range(2))
    supply = 1.75e7 + 1e4 * rng.standard_normal(count)
    q = np.tile(healthy.q[0], (count, 1))
    heard = Heard(0.005 * np.arange(count), q, p_a, p_b, supply, command)
    finding = first_after(heard.to(model, tolerance))
    assert (finding.part, finding.joint) == (Part.VALVE, "inner_boom")


def test_readings_that_are_lost_are_said_and_recovered_from(
    model: Model, healthy: Heard, tolerance: Tolerance
) -> None:
    kept = (healthy.time < 8.0) | (healthy.time > 9.0)
    gap = Heard(*(np.array(part)[kept] for part in vars(healthy).values()))
    gap.p_a[3000, 0] = np.nan
    watched = gap.to(model, tolerance)
    assert watched.refused > 0
    assert watched.condition is Heed.WATCHING
    assert watched.monitor.findings == []


def test_a_model_without_hydraulics_is_refused(model: Model) -> None:
    with pytest.raises(ConfigurationError, match="holds no hydraulics"):
        SensorWatch(replace(model, hydraulics=None))
    assert issubclass(ConfigurationError, CraneError)


def late(true: Heard, seconds: float) -> Heard:
    """Commands reach the valves that much sooner or later than their stamps say."""
    steps = round(seconds / 0.005)
    shown = np.empty_like(true.command)
    for k in range(len(shown)):
        shown[k] = true.command[min(max(k + steps, 0), len(shown) - 1)]
    return replace(true, command=shown)


@pytest.mark.parametrize("seconds", [-0.005, 0.005])
def test_stamps_of_commands_that_are_off_are_no_fault(
    model: Model, healthy: Heard, seconds: float
) -> None:
    """Between processes stamps are off by some milliseconds, more at one time than at another."""
    watched = late(healthy, seconds).to(model, None)
    assert watched.monitor.findings == []


def test_a_supply_that_was_never_identified_is_no_fault(model: Model, healthy: Heard) -> None:
    assert model.hydraulics is not None
    unknown = replace(model, hydraulics=model.hydraulics.model_copy(update={"supply": None}))
    watched = healthy.to(unknown, None)
    assert watched.condition is Heed.WATCHING
    assert watched.monitor.findings == []


def test_an_alarm_is_told_though_its_encoder_is_lost_meanwhile(
    model: Model, healthy: Heard, tolerance: Tolerance
) -> None:
    """As where the driver does not believe it any more either."""

    def stops(x: np.ndarray, t: np.ndarray) -> np.ndarray:
        return np.where(t < 0.15, x[0], np.nan)

    lie = changed("q", stops)
    finding = first_after(lie(healthy, 0).to(model, tolerance))
    assert (finding.part, finding.joint) == (Part.ENCODER, "inner_boom")
    assert finding.found - ONSET < 0.2
