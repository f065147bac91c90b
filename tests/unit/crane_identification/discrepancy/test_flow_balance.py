"""The hydraulics of a simulated cylinder, found again and compared with what is usual."""

from dataclasses import replace

import numpy as np
import pytest
from unit.crane_model.test_flow import BAND, BETA, DK, JOINT, LEAK, K, moved

from crane_identification.discrepancy.evidence import Evidence, Run
from crane_identification.discrepancy.flow import examine
from crane_identification.discrepancy.hydraulics import Flow, Usual
from crane_model.configuration import packaged
from crane_model.model_file import load_model

USUAL = Usual(
    dead_zone={JOINT: 0.09},
    hysteresis=0.01,
    asymmetry=0.03,
    leakage=1e-13,
    bulk_modulus=0.9e9,
    smallest_share=0.001,
    unexplained=0.006,
)


@pytest.fixture(scope="module")
def evidence() -> Evidence:
    model = load_model(packaged("crane_model", "crane_model.yaml"))
    assert model.machine is not None
    record = moved(model.machine, BAND, DK)
    run = Run("cylinder", 0, record, np.ones((len(record), 1)), 10)
    nothing = np.zeros((1, 1))
    return Evidence(
        model, 4 * (run,), nothing[0], nothing[0], nothing[0], nothing, nothing, nothing > 0
    )


@pytest.fixture(scope="module")
def flow(evidence: Evidence) -> Flow:
    found, absent = examine(evidence, evidence, USUAL)
    assert {joint for _, joint in absent} == {"inner_boom", "outer_boom"}  # not in this record
    return found[0]


def test_values_come_back(flow: Flow) -> None:
    values = {one.type: one.value for one in flow.quantities}
    assert values["valve_dead_zone"] == pytest.approx(BAND, abs=0.002)
    assert values["valve_asymmetry"] == pytest.approx(DK / K, rel=0.05)
    assert values["internal_leakage"] == pytest.approx(LEAK, rel=0.1)
    assert values["oil_compressibility"] == pytest.approx(1.0 / BETA, rel=0.1)
    assert abs(values["valve_hysteresis"]) < 0.005


def test_what_is_beyond_the_usual_is_missing(flow: Flow) -> None:
    assert {one.type for one in flow.missing} == {"valve_asymmetry", "internal_leakage"}


def test_without_supply_pressure_it_is_not_observable(evidence: Evidence) -> None:
    run = evidence.runs[0]
    blind = replace(run, record=replace(run.record, supply_pressure=None))
    found, absent = examine(replace(evidence, runs=4 * (blind,)), evidence, USUAL)
    assert not found
    assert "supply pressure" in absent["valve_dead_zone", JOINT]


def test_a_chamber_that_draws_oil_past_the_valve_is_not_asked(
    evidence: Evidence, flow: Flow
) -> None:
    run = evidence.runs[0]
    record = run.record
    j = record.column(JOINT)
    assert record.pressure_a is not None and record.pressure_b is not None
    assert record.tank_pressure is not None and record.velocity is not None
    starved = np.arange(len(record)) % 1000 < 150
    pressure, speed = record.pressure_b.copy(), record.velocity.copy()
    pressure[starved, j] = record.tank_pressure[starved]
    speed[starved, j] *= 1.5  # more than the valve lets in
    torn = replace(run, record=replace(record, pressure_b=pressure, velocity=speed))
    found, _ = examine(replace(evidence, runs=4 * (torn,)), evidence, USUAL)
    assert [one.type for one in found[0].missing] == [one.type for one in flow.missing]


def test_without_a_usual_dead_zone_nothing_is_said(evidence: Evidence) -> None:
    other = USUAL.model_copy(update={"dead_zone": {"slew": 0.05}})
    found, absent = examine(evidence, evidence, other)
    assert not found
    assert "not known" in absent["valve_dead_zone", JOINT]


def test_a_law_of_no_valve_and_no_oil_is_unknown(evidence: Evidence, flow: Flow) -> None:
    run = evidence.runs[0]
    record = run.record
    assert not flow.unknown and record.velocity is not None
    eccentric = replace(
        record, velocity=record.velocity * (1.0 + 0.1 * np.sin(9.0 * record.position))
    )
    found, _ = examine(
        replace(evidence, runs=4 * (replace(run, record=eccentric),)), evidence, USUAL
    )
    assert found[0].unknown and not found[0].missing


def test_joints_with_wrong_sensors_are_not_asked(evidence: Evidence) -> None:
    found, absent = examine(evidence, evidence, USUAL, {JOINT})
    assert not found
    assert "sensors" in absent["internal_leakage", JOINT]


def test_a_short_motion_tells_nothing_of_the_flow(evidence: Evidence) -> None:
    found, absent = examine(replace(evidence, runs=evidence.runs[:1]), evidence, USUAL)
    assert not found
    assert "record longer" in absent["internal_leakage", JOINT]
