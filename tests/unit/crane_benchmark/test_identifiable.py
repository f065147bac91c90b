"""What recordings of a kind can show at all: of friction with memory, and of valves and oil."""

from dataclasses import replace

import numpy as np
import pytest
from laboratory_crane import JOINTS, PLANAR_JOINTS

from crane_benchmark import Case, CaseKind
from crane_benchmark.cases.case import EffectToHide, HiddenInRecording
from crane_benchmark.cases.simulators import load_seen, save_clean
from crane_benchmark.scores.truth import CaseTruth, beyond_usual
from crane_identification.diagnosis.findings import FindingEntry, Findings, FoundParameter
from crane_identification.diagnosis.flow import load_usual
from crane_model import Record, load_model
from crane_model.machine_files import machine_file
from crane_sim import load_simulated_crane
from crane_sim.ground_truth import Clean, TrueEffect, TrueParameter
from crane_sim.parts.parameters import Edges

JOINT = "outer_boom"
FORCE = 4000.0  # N m
MODEL = load_model(machine_file("model.yaml"))
SIMULATED = load_simulated_crane()
COUNT = SIMULATED.sensors.encoder_resolution[JOINT]


def labelled(name: str, joint: str | None, form: str = "any", **values: float) -> TrueEffect:
    """An entry of a label."""
    return TrueEffect(
        effect=name,
        name=name,
        joint=joint,
        form=form,
        parameters=[
            TrueParameter(name=name, value=value, unit="1") for name, value in values.items()
        ],
        relative_magnitude_requested=None,
        relative_magnitude=0.0,
        relative_magnitude_by_joint={},
    )


def presliding(travel: float, tmp_path) -> CaseTruth:
    """A machine without noise whose friction needs `travel` [rad] after each reversal to settle."""
    time = np.arange(0.0, 60.0, 0.005)
    angle = np.outer(time, 2.0 * np.pi * np.array([0.05, 0.11, 0.13, 0.17]))
    size, rate = np.array([0.3, 0.2, 0.3, 0.2]), np.diff(angle, axis=0)[0] / 0.005
    position = size * np.sin(angle) + np.array([0.0, 0.4, -0.8, 0.5])
    velocity = size * rate * np.cos(angle)
    j, planar = JOINTS.index(JOINT), PLANAR_JOINTS.index(JOINT)
    turned = np.concatenate([[True], np.diff(np.sign(velocity[:, j])) != 0])
    last = np.maximum.accumulate(np.where(turned, np.arange(len(time)), 0))
    way = np.abs(position[:, j] - position[last, j])
    lost = np.zeros((1, len(time), 4))
    lost[0, :, j] = -2.0 * FORCE * np.sign(velocity[:, j]) * np.exp(-way / travel)
    pressure = np.full_like(position, 8e6)
    record = Record(
        joints=PLANAR_JOINTS,
        time=time,
        position=position[:, 1:],
        velocity=velocity[:, 1:],
        acceleration=(-size * rate**2 * np.sin(angle))[:, 1:],
        run=np.zeros(len(time), dtype=int),
        slew_position=position[:, 0],
        slew_velocity=velocity[:, 0],
        slew_acceleration=(-size * rate**2 * np.sin(angle))[:, 0],
    )
    drive = np.zeros_like(position)
    drive[:, 1:] = MODEL.regressor(record) @ np.linspace(50.0, 100.0, len(MODEL.parameters))
    drive += lost[0]
    clean = Clean(
        time=time,
        position=position,
        velocity=velocity,
        acceleration=-size * rate**2 * np.sin(angle),
        pressure_a=pressure,
        pressure_b=pressure,
        drive=drive,
        seen_position=position,
        seen_drive=drive,
        force=lost,
        flow=np.zeros_like(lost),
        relative_magnitude_by_joint=np.zeros((1, 4)),
    )
    save_clean(tmp_path / "train-0.npz", clean)
    seen = load_seen([tmp_path / "train-0.npz"], [[0]], 1)
    assert seen.used[:, planar].mean() > 0.9
    effect = EffectToHide(
        effect="presliding", joint=JOINT, form="bouc_wen", relative_magnitude=0.02
    )
    case = Case(name="presliding", kind=CaseKind.SINGLE, seed=(0, 0), effects=(effect,))
    return CaseTruth(case, SIMULATED, (), seen, seen)


def test_memory_within_two_counts_of_an_encoder_is_not_identifiable(tmp_path):
    (within,) = presliding(0.5 * COUNT, tmp_path).visibility(MODEL)
    assert within is not None and within < 0.05


def test_memory_over_many_counts_is_identifiable(tmp_path):
    (beyond,) = presliding(100.0 * COUNT, tmp_path).visibility(MODEL)
    assert beyond is not None and beyond > 0.5


def test_what_acts_on_held_out_recordings_alone_is_not_identifiable(tmp_path):
    made = presliding(100.0 * COUNT, tmp_path)
    quiet = replace(made, train=replace(made.train, hidden=np.zeros_like(made.train.hidden)))
    assert quiet.visibility(MODEL) == [0.0]


def test_an_error_counts_as_above_noise_where_transducers_do_not_explain_it(tmp_path):
    """What stays within two counts leaves nothing; over many counts it is an error."""
    assert not presliding(1e-3 * COUNT, tmp_path).above_noise(MODEL)
    assert presliding(100.0 * COUNT, tmp_path).above_noise(MODEL)


def still() -> Record:
    """At rest under 8 MPa."""
    n, j = 10, len(PLANAR_JOINTS)
    zeros, pressure = np.zeros((n, j)), np.full((n, j), 8e6)
    return Record(
        joints=PLANAR_JOINTS,
        time=np.arange(n) * 0.02,
        position=zeros,
        velocity=zeros,
        acceleration=zeros,
        pressure_a=pressure,
        pressure_b=pressure,
    )


@pytest.mark.parametrize(
    ("effect", "form", "values", "beyond"),
    [
        ("valve_hysteresis", "trailing_edges", {"width": 0.0005}, 0.0),
        ("valve_hysteresis", "trailing_edges", {"width": 0.004}, 0.75),
        ("valve_asymmetry", "two_gains", {"share": -0.04}, 0.0),
        ("valve_asymmetry", "two_gains", {"share": -0.101}, 0.5),
        ("oil_compressibility", "hose_wall", {"softness": 0.05, "stiffening": 1e7}, 0.0),
        # 1.3e9 / (1 + 2 / (1 + 1)) = 0.65e9 Pa beside the 1.05e9 Pa of the data sheet
        ("oil_compressibility", "hose_wall", {"softness": 2.0, "stiffening": 8e6}, 1 - 0.65 / 1.05),
        # 1e-12 m3/(s Pa) and the machine's own beside 3e-14
        ("internal_leakage", "orifice", {"conductance": 1e-12 * np.sqrt(5e5)}, 0.97),
        # at standstill, in the middle of nothing: 0 rad of a range of 2.6 about -1.4
        ("internal_leakage", "widening", {"conductance": 1e-12, "widening": 1e7}, 0.97),
        ("internal_leakage", "worn", {"conductance": 1e-12, "middle": 2.0}, 0.97),
        ("valve_hysteresis", "two_plays", {"width": 0.008, "inner": 0.0}, 0.75),
        ("valve_asymmetry", "one_way", {"share": 0.1127}, 0.5),  # 0.2254/2.2254
        ("oil_compressibility", "braid", {"softness": np.e, "stiffening": 8e6}, 1 - 0.65 / 1.05),
        ("oil_compressibility", "long_hose", {"softness": np.sqrt(2), "stiffening": 8e6},
         1 - 0.65 / 1.05),
        ("air_in_oil", "isothermal", {"share": 0.1}, None),
    ],
)  # fmt: skip
def test_valves_and_oil_count_beyond_what_is_usual(effect, form, values, beyond):
    found = beyond_usual(labelled(effect, JOINT, form, **values), SIMULATED, still(), load_usual())
    assert found == (None if beyond is None else pytest.approx(beyond, abs=0.02))


def test_what_is_hidden_in_a_valve_adds_to_what_the_machine_has():
    """Gains of the edges, and a dead band that is wider one way."""
    given = SIMULATED.valves[JOINT]
    uneven = Edges(supply_a=1.05, a_tank=0.95, supply_b=0.57, b_tank=0.63)  # 5 % by themselves
    valve = given.model_copy(update={"edges": uneven, "null_bias": 0.01})
    valves = {**SIMULATED.valves, JOINT: valve}
    usual = load_usual().model_copy(update={"asymmetry": 0.05, "dead_band": {JOINT: 0.05}})
    beyond = {}
    for name, parameter, size in (
        ("valve_asymmetry", "share", 0.05),
        ("valve_asymmetry", "share", -0.05),
        ("valve_dead_band", "band", 0.0),
    ):
        label = labelled(name, JOINT, **{parameter: size})
        simulated = SIMULATED.model_copy(update={"valves": valves})
        beyond[name, size] = beyond_usual(label, simulated, still(), usual)
    assert beyond["valve_asymmetry", 0.05] == pytest.approx(0.5, abs=0.01)
    assert beyond["valve_asymmetry", -0.05] == 0.0
    assert beyond["valve_dead_band", 0.0] == pytest.approx(1 - 0.05 / 0.06)


def test_loads_that_differ_are_each_compared_with_the_nearest(tmp_path):
    truth = presliding(0.1, tmp_path)
    labels = tuple(
        HiddenInRecording(effects=[labelled("payload", None, mass=mass)] if mass else [])
        for mass in (10.0, 0.0, 6.0)
    )
    masses = {"m_payload.0": 10.1, "m_payload.1": 5.7}
    finding = FindingEntry.model_construct(
        effect="payload",
        joint="all",
        parameters=[
            FoundParameter.model_construct(name=name, value=value) for name, value in masses.items()
        ],
    )
    found = Findings.model_construct(findings=[finding])
    errors = replace(truth, labels=labels).parameter_errors(found)
    assert errors == pytest.approx([0.01, 0.05])
