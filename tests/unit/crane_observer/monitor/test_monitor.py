"""A machine at work whose sensors begin to lie: what the monitor says, and when."""

from dataclasses import replace

import numpy as np
import pytest
from unit.crane_observer.monitor.at_work import ONSET, Heard, Lie, changed, exchanged

from crane_model import ConfigurationError, Model
from crane_observer import Part, SensorFinding, SensorWatch, Wrong
from crane_observer.monitor.replay import Heed
from crane_observer.monitor.tolerance import Tolerance

NOISE = np.random.default_rng(4).standard_normal(10_000)
LIES: dict[str, tuple[Lie, Part, set[Wrong], float]] = {
    "encoder stuck": (changed("q", lambda x, t: 0 * x + x[0]), Part.ENCODER, {Wrong.STUCK}, 0.3),
    "encoder jumps": (
        changed("q", lambda x, t: x + 3e-3), Part.ENCODER, {Wrong.JUMP}, 0.1),
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


@pytest.mark.parametrize("error", [-3e5, 3e5])
def test_the_second_look_at_a_transducer_reaches_back_to_its_onset(
    model: Model, healthy: Heard, tolerance: Tolerance, error: float
) -> None:
    """Before it was found, though what feeds it is not compared since."""
    lie = changed("p_b", lambda x, t: x + error)
    finding = first_after(lie(healthy, 0).to(model, tolerance))
    assert finding.onset == pytest.approx(ONSET, abs=0.15)
    assert finding.size == pytest.approx(error, rel=0.1)


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


ALONE = {
    "encoder jumps": Part.ENCODER,
    "encoder noise": Part.ENCODER,
    "A stuck": Part.PRESSURE_A,
    "noise in B": Part.PRESSURE_B,
}


@pytest.mark.parametrize("name", ALONE)
def test_without_hydraulics_each_sensor_is_watched_by_itself(
    model: Model, healthy: Heard, name: str
) -> None:
    lie, part, kinds, within = LIES[name]
    finding = first_after(lie(healthy, 0).to(replace(model, hydraulics=None), None))
    assert (finding.part, finding.joint) == (part, "inner_boom")
    assert 0.0 < finding.found - ONSET < within
    assert finding.kind in kinds


def standing(**lies: np.ndarray | float) -> Heard:
    """The inner boom is told to go, its chambers pass oil, and its encoder stands still."""
    count = 400
    on, pressure = np.arange(count) >= 200, np.full((count, 3), 6e6)
    command = np.zeros((count, 3))
    command[on, 0] = lies.get("command", -0.4)
    p_b = np.where(on[:, None], lies.get("p_b", 8e6), 6e6) * np.ones(3)
    q = np.tile(np.array([0.3, -1.0, 0.2]), (count, 1)) + lies.get("flicker", 0.0) * (
        np.arange(count)[:, None] % 20 == 0
    )
    supply = np.full(count, lies.get("supply", 1.75e7))
    return Heard(0.005 * np.arange(count), q, pressure, p_b, supply, command)


def test_without_hydraulics_a_joint_that_stands_while_oil_must_flow_is_a_danger(
    model: Model,
) -> None:
    watched = standing().to(replace(model, hydraulics=None), None)
    finding = first_after(watched)
    assert (finding.part, finding.joint, finding.kind) == (Part.VALVE, "inner_boom", Wrong.STUCK)
    assert finding.dangerous and finding.rival is not None
    assert (finding.rival.joint, finding.rival.kind) == ("inner_boom", Wrong.STUCK)
    assert finding.onset == pytest.approx(1.0, abs=0.011)
    assert finding.found - 1.0 < 0.4
    assert len(watched.monitor.findings) == 1


@pytest.mark.parametrize(
    "why_not",
    [
        {"command": 0.25},  # it may be in the dead band
        {"p_b": 1.72e7},  # against a stop, or a load that is too heavy
        {"supply": 5e6},  # the pump is off
        {"supply": np.nan},  # nobody knows
        {"flicker": 1e-4},  # it goes, slowly
    ],
)
def test_without_hydraulics_a_joint_may_stand_for_a_reason(
    model: Model, why_not: dict[str, float]
) -> None:
    watched = standing(**why_not).to(replace(model, hydraulics=None), None)
    assert watched.monitor.findings == []


@pytest.mark.parametrize("supply", [True, False])
def test_without_hydraulics_nothing_is_found_where_nothing_lies(
    model: Model, healthy: Heard, supply: bool
) -> None:
    """Nor where there is no transducer of the supply."""
    shown = healthy if supply else replace(healthy, supply=np.full_like(healthy.supply, np.nan))
    watched = shown.to(replace(model, hydraulics=None), None)
    assert watched.condition is Heed.ALONE
    assert (watched.refused, watched.monitor.findings) == (0, [])


def test_no_supply_transducer_hides_no_other(model: Model, healthy: Heard) -> None:
    lie, part, _, within = LIES["noise in B"]
    shown = replace(lie(healthy, 0), supply=np.full_like(healthy.supply, np.nan))
    finding = first_after(shown.to(replace(model, hydraulics=None), None))
    assert (finding.part, finding.kind) == (part, Wrong.NOISE)
    assert 0.0 < finding.found - ONSET < within


def test_a_tolerance_without_hydraulics_is_refused(model: Model, tolerance: Tolerance) -> None:
    with pytest.raises(ConfigurationError, match="holds no hydraulics, and no comparison"):
        SensorWatch(replace(model, hydraulics=None), tolerance)


def test_what_is_forgotten_is_watched_again(model: Model, healthy: Heard) -> None:
    lie, *_ = LIES["encoder jumps"]
    watched = lie(healthy, 0).to(replace(model, hydraulics=None), None)
    watched.monitor.forget()
    assert watched.monitor.findings == []


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


@pytest.mark.parametrize(
    ("lie", "named"),
    [
        (changed("p_a", lambda x, t: x + 5e5), Part.PRESSURE_A),
        (changed("p_b", lambda x, t: 0 * x + x[0]), Part.PRESSURE_B),
        (exchanged, Part.PRESSURES),
        (changed("supply", lambda x, t: x + 5e5), Part.SUPPLY),
    ],
)
def test_an_encoder_is_watched_by_what_is_left(
    model: Model, healthy: Heard, tolerance: Tolerance, lie: Lie, named: Part
) -> None:
    """Its joint's transducer lies, or the supply's; the encoder first does not, then it does."""
    lying = lie(healthy, 0)
    watched = SensorWatch(model, tolerance)
    for _ in lying.into(watched):
        pass
    assert [finding.part for finding in watched.monitor.findings] == [named]
    drifts = changed("q", lambda x, t: x + 5e-3 * np.clip(t - 5.0, 0.0, None))
    watched = SensorWatch(model, tolerance)
    for _ in drifts(lying, 0).into(watched):
        pass
    first, *later = watched.monitor.findings
    assert first.part is named
    danger = next(finding for finding in later if finding.dangerous)
    assert 5.0 < danger.found - ONSET < 7.0
    if danger.part is not Part.ENCODER:  # of one chamber alone, its transducer may do the same
        assert danger.rival is not None
        assert danger.rival.joint == "inner_boom"
