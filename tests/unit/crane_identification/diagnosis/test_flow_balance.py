"""The hydraulics of a simulated cylinder, found again and compared with what is usual."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from unit.crane_model.test_flow import BANDS, BETA, GAINS, JOINT, LEAK, PLAY, moved

from crane_identification.diagnosis.candidates import Candidate
from crane_identification.diagnosis.evidence import Evidence, Run
from crane_identification.diagnosis.flow import Flow, Usual, examine
from crane_identification.thresholds import load_thresholds
from crane_model import Record, load_model
from crane_model.flow import EDGES
from crane_model.hydraulics import (
    ChamberValues,
    HydraulicValues,
    JointHydraulics,
    Measured,
    ValveValues,
)
from crane_model.machine_files import machine_file
from crane_model.terms.sensing import EncoderOffset

USUAL = Usual(
    dead_band={JOINT: 0.09},
    hysteresis=0.01,
    asymmetry=0.03,
    leakage=1e-13,
    bulk_modulus=0.9e9,
)
GATES = {"smallest_flow_share": 0.001, "unexplained_flow": 0.006}
PACKAGED = load_thresholds()
THRESHOLDS = PACKAGED.model_copy(update={"gates": PACKAGED.gates.model_copy(update=GATES)})


@pytest.fixture(scope="module")
def evidence() -> Evidence:
    model = load_model(machine_file("model.yaml"))
    assert model.machine is not None
    record = moved(model.machine)
    run = Run("cylinder", 0, record, np.ones((len(record), 1)), 10)
    nothing = np.zeros((1, 1))
    return Evidence(
        model, 4 * (run,), nothing[0], nothing[0], nothing[0], nothing, nothing, nothing > 0
    )


def moving(evidence: Evidence, record: Record) -> Evidence:
    """The same with another record."""
    return replace(evidence, runs=4 * (replace(evidence.runs[0], record=record),))


def simulated(evidence: Evidence, **flaws: float) -> Evidence:
    """The same of a cylinder with flaws."""
    assert evidence.model.machine is not None
    return moving(evidence, moved(evidence.model.machine, **flaws))


def examined(*given: Any) -> tuple[tuple[Flow, ...], dict[tuple[str, str], str]]:
    """What is found, and why effects are not observable."""
    flows = examine(*given)
    return flows.found, flows.unobservable


@pytest.fixture(scope="module")
def flow(evidence: Evidence) -> Flow:
    found, absent = examined(evidence, evidence, USUAL, THRESHOLDS)
    assert {joint for _, joint in absent} == {"inner_boom", "outer_boom"}  # not in this record
    return found[0]


def test_values_come_back(flow: Flow) -> None:
    values = {one.type: one.value for one in flow.quantities}
    assert flow.unexplained < 0.003
    np.testing.assert_allclose([one.value for one in flow.gains], GAINS, rtol=0.01)
    assert not flow.undetermined
    assert values["valve_dead_band"] == pytest.approx(max(BANDS), abs=0.001)
    assert values["valve_asymmetry"] == pytest.approx((8 / 72 + 4 / 48) / 2, rel=0.02)
    assert values["internal_leakage"] == pytest.approx(LEAK, rel=0.1)
    assert values["oil_compressibility"] == pytest.approx(1.0 / BETA, rel=0.1)
    assert values["valve_hysteresis"] == pytest.approx(PLAY, rel=0.05)


def test_a_command_that_begins_late_costs_only_what_is_before(
    evidence: Evidence, flow: Flow
) -> None:
    """As in live bags; and where it is lost in between, play begins anew."""
    record = evidence.runs[0].record
    assert record.command is not None
    command = record.command.copy()
    command[:900] = np.nan  # 1.8 s
    command[2500:2600] = np.nan
    live = moving(evidence, replace(record, command=command))
    found, absent = examined(live, live, USUAL, THRESHOLDS)
    assert {joint for _, joint in absent} == {"inner_boom", "outer_boom"}
    assert found[0].recorded == flow.recorded == pytest.approx(32.0, abs=0.01)
    assert found[0].known == pytest.approx(4 * (8.0 - 1.8 - 0.2), abs=0.02)
    np.testing.assert_allclose([one.value for one in found[0].gains], GAINS, rtol=0.01)
    assert {one.type for one in found[0].missing} == {one.type for one in flow.missing}


def test_a_recording_without_commands_is_left_out(evidence: Evidence, flow: Flow) -> None:
    run = evidence.runs[0]
    blind = replace(run, record=replace(run.record, command=None))
    found, _ = examined(
        replace(evidence, runs=(blind, *evidence.runs)), evidence, USUAL, THRESHOLDS
    )
    assert found[0].quantities == flow.quantities
    assert found[0].recorded - found[0].known == pytest.approx(8.0, abs=0.01)


def test_too_little_of_the_command_is_refused_by_name(evidence: Evidence) -> None:
    record = evidence.runs[0].record
    assert record.command is not None
    late = np.where(record.time[:, np.newaxis] < 6.9, np.nan, record.command)
    found, absent = examined(
        moving(evidence, replace(record, command=late)), evidence, USUAL, THRESHOLDS
    )
    assert not found
    assert "command, pressure_a" in absent["valve_dead_band", JOINT]
    assert "known together for 4.4 s of 32.0 s: log them" in absent["valve_dead_band", JOINT]


def test_noise_asks_for_faster_motion(evidence: Evidence) -> None:
    """A little of it, and values drown that say little; much, and nothing is told."""
    record = evidence.runs[0].record
    white = np.random.default_rng(1).normal(size=record.velocity.shape)
    white *= np.sqrt((record.velocity**2).mean())

    def noisy(size: float) -> Evidence:
        return moving(evidence, replace(record, velocity=record.velocity + size * white))

    stiff = USUAL.model_copy(update={"bulk_modulus": 2e9})
    found, _ = examined(noisy(0.3), evidence, stiff, THRESHOLDS)
    assert not found[0].unknown  # though more than usual is left: it is no law
    assert found[0].unexplained > THRESHOLDS.gates.unexplained_flow
    assert found[0].undetermined == ("compressibility of the oil",)
    found, absent = examined(noisy(1.0), evidence, USUAL, THRESHOLDS)
    assert not found
    assert "is noise, at most 10% allowed; move faster" in absent["valve_dead_band", JOINT]


def test_the_gain_of_an_edge_that_never_opens_is_not_determined(evidence: Evidence) -> None:
    record = evidence.runs[0].record
    assert record.command is not None
    one_way = moving(evidence, replace(record, command=np.maximum(record.command, 0.0)))
    found, _ = examined(one_way, one_way, USUAL, THRESHOLDS)
    edges = "gain of the edge a_tank", "gain of the edge supply_b"
    assert found[0].undetermined == edges
    assert found[0].unknown  # it moves the other way all the same


def test_a_command_of_the_wrong_sign_is_said_to_be_wrong(evidence: Evidence) -> None:
    record = evidence.runs[0].record
    assert record.command is not None
    turned = moving(evidence, replace(record, command=-record.command))
    found, absent = examined(turned, turned, USUAL, THRESHOLDS)
    assert not found
    assert "check sign and log of its command" in absent["valve_dead_band", JOINT]


def test_what_is_beyond_the_usual_is_missing(flow: Flow) -> None:
    beyond = {"valve_asymmetry", "internal_leakage", "valve_hysteresis"}
    assert {one.type for one in flow.missing} == beyond


def test_a_dead_band_beyond_the_usual_is_missing_in_proportion(evidence: Evidence) -> None:
    """Of one direction alone; what more is left without it is what that width lets through."""
    narrow = USUAL.model_copy(update={"dead_band": {JOINT: BANDS[0] - 0.01}})
    wide = USUAL.model_copy(update={"dead_band": {JOINT: BANDS[0] - 0.005}})
    shares = []
    for usual in (narrow, wide):
        found, _ = examined(evidence, evidence, usual, THRESHOLDS)
        (quantity,) = (one for one in found[0].missing if one.type == "valve_dead_band")
        shares.append(quantity.share)
    assert shares[0] == pytest.approx(2.0 * shares[1], rel=0.1)
    assert shares[0] > 0.005


def test_without_supply_pressure_it_is_not_observable(evidence: Evidence) -> None:
    run = evidence.runs[0]
    blind = replace(run, record=replace(run.record, supply_pressure=None))
    found, absent = examined(replace(evidence, runs=4 * (blind,)), evidence, USUAL, THRESHOLDS)
    assert not found
    assert "supply pressure" in absent["valve_dead_band", JOINT]


@pytest.mark.parametrize("source", ["tank_pressure", "supply_pressure"])
def test_a_chamber_close_to_tank_or_supply_is_not_asked(
    evidence: Evidence, flow: Flow, source: str
) -> None:
    """There it draws oil past the valve, or its flow says more of the transducers."""
    run = evidence.runs[0]
    record = run.record
    j = record.column(JOINT)
    assert record.pressure_a is not None and record.pressure_b is not None
    assert record.velocity is not None
    starved = np.arange(len(record)) % 1000 < 150
    pressure, speed = record.pressure_b.copy(), record.velocity.copy()
    close = record.needed(source, "the test")
    pressure[starved, j] = close[starved] + 2.5e5 * np.sign(pressure.mean() - close[starved])
    speed[starved, j] *= 1.5  # more than the valve lets in
    torn = replace(run, record=replace(record, pressure_b=pressure, velocity=speed))
    found, _ = examined(replace(evidence, runs=4 * (torn,)), evidence, USUAL, THRESHOLDS)
    names, torn_names = ({one.type for one in one.missing} for one in (flow, found[0]))
    assert {"valve_asymmetry", "internal_leakage"} <= torn_names <= names


def identified(undetermined: tuple[str, ...] = (), **changed: float) -> HydraulicValues:
    """What was identified of the cylinder, but for what has `changed` since."""
    zone_a, zone_b = BANDS
    strokes = 1.0 - np.array([zone_a, zone_b, zone_b, zone_a])
    values = {
        "dead_band_a": zone_a,
        "dead_band_b": zone_b,
        "hysteresis": PLAY,
        "leakage": LEAK,
        "lag": 0.01,
        "natural_frequency": 200.0,
        "damping_ratio": 0.8,
        "bulk_modulus": BETA,
        "dead_volume_a": 1e-4,
        "dead_volume_b": 1e-4,
        **dict(zip(EDGES, (GAINS * strokes).tolist(), strict=True)),
    } | changed
    parts = [
        part(**{name: Measured(value=values[name], unit=unit) for name, unit in part.units.items()})
        for part in (ValveValues, ChamberValues)
    ]
    one = JointHydraulics(
        valve=parts[0],
        chambers=parts[1],
        undetermined=dict.fromkeys(undetermined, "another experiment"),
        unexplained=0.0,
    )
    return HydraulicValues(provenance="made", joints={JOINT: one})


def judged_by(evidence: Evidence, own: HydraulicValues, usual: Usual = USUAL) -> Flow:
    model = replace(evidence.model, hydraulics=own)
    found, _ = examined(replace(evidence, model=model), evidence, usual, THRESHOLDS)
    return found[0]


def test_own_values_are_usual_whatever_the_data_sheet_says(evidence: Evidence) -> None:
    found = judged_by(evidence, identified(), USUAL.model_copy(update={"dead_band": {}}))
    assert all(one.own for one in found.quantities)
    assert not found.missing


@pytest.mark.parametrize(
    ("changed", "effect"),
    [
        ({"dead_band_b": BANDS[1] - 0.01}, "valve_dead_band"),  # still below that of the other way
        ({"hysteresis": 0.5 * PLAY}, "valve_hysteresis"),
        ({"leakage": 0.5 * LEAK}, "internal_leakage"),
        ({"bulk_modulus": 1.4 * BETA}, "oil_compressibility"),
        ({"supply_a": 0.9 * GAINS[0] * (1.0 - BANDS[0])}, "valve_asymmetry"),
    ],
)
def test_what_has_changed_since_is_missing(
    evidence: Evidence, changed: dict[str, float], effect: str
) -> None:
    """Though the data sheet allows it."""
    sheet = Usual(
        dead_band={JOINT: 0.2}, hysteresis=0.1, asymmetry=0.5, leakage=1e-11, bulk_modulus=1e8
    )
    assert not judged_by(evidence, HydraulicValues(provenance="none", joints={}), sheet).missing
    first = judged_by(evidence, identified(**changed), sheet).missing[0]
    assert first.type == effect
    assert first.limit == "what was identified of it"


def test_an_own_value_that_is_not_determined_is_no_measure(evidence: Evidence) -> None:
    found = judged_by(evidence, identified(("leakage",)))
    assert [one.type for one in found.missing] == ["internal_leakage"]
    assert found.missing[0].limit == "what is usual"


def test_without_a_usual_dead_band_nothing_is_said(evidence: Evidence) -> None:
    other = USUAL.model_copy(update={"dead_band": {"slew": 0.05}})
    found, absent = examined(evidence, evidence, other, THRESHOLDS)
    assert not found
    assert "not known" in absent["valve_dead_band", JOINT]


def test_a_law_of_no_valve_and_no_oil_is_unknown(evidence: Evidence, flow: Flow) -> None:
    run = evidence.runs[0]
    record = run.record
    assert not flow.unknown and record.velocity is not None
    for size, values in ((0.1, 5), (0.4, 0)):  # above a tenth, no value is any good
        eccentric = replace(
            record, velocity=record.velocity * (1.0 + size * np.sin(9.0 * record.position))
        )
        found, _ = examined(moving(evidence, eccentric), evidence, USUAL, THRESHOLDS)
        assert found[0].unknown and not found[0].missing
        assert len(found[0].quantities) == values


@pytest.mark.parametrize("air", [0.0, 0.5])
def test_air_in_the_oil_is_told_by_how_soft_it_is_at_low_pressure(
    evidence: Evidence, air: float
) -> None:
    airy = simulated(evidence, air=air)
    found, _ = examined(airy, airy, USUAL, THRESHOLDS)
    assert found[0].airy is (air > 0.0)


@pytest.mark.parametrize("wear", [0.0, 4.0])
def test_a_leakage_that_changes_along_the_stroke_is_a_leakage(
    evidence: Evidence, wear: float
) -> None:
    """Its piston is worn where it works most."""
    worn = simulated(evidence, wear=wear)
    gates = THRESHOLDS.gates.model_copy(update={"unexplained_flow": 0.003})
    thresholds = THRESHOLDS.model_copy(update={"gates": gates})
    found, _ = examined(worn, worn, USUAL.model_copy(update={"leakage": 2.0 * LEAK}), thresholds)
    names = {one.type for one in found[0].missing}
    assert any(one.along_stroke for one in found[0].quantities) is (wear > 0.0)
    assert ("internal_leakage" in names) is (wear > 0.0)
    assert not found[0].unknown


def test_joints_with_wrong_sensors_are_not_asked(evidence: Evidence) -> None:
    named = [Candidate(EncoderOffset, JOINT)]
    found, absent = examined(evidence, evidence, USUAL, THRESHOLDS, named)
    assert not found
    assert "sensors" in absent["internal_leakage", JOINT]


def test_a_short_motion_tells_nothing_of_the_flow(evidence: Evidence) -> None:
    found, absent = examined(replace(evidence, runs=evidence.runs[:1]), evidence, USUAL, THRESHOLDS)
    assert not found
    assert "record longer" in absent["internal_leakage", JOINT]
