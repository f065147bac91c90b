"""A measured rotary actuator in counts: what cannot be told is not given a name."""

from pathlib import Path

import numpy as np
import pytest

from crane_identification.data.log import Log, Signal
from crane_identification.discrepancy.diagnosis import Diagnosis, diagnose
from crane_identification.discrepancy.thresholds import load_thresholds
from crane_identification.discrepancy.verdict import Verdict
from crane_identification.options import Options
from crane_model.model_file import load_model

RATE = 1000.0  # Hz, assumed: the recordings do not say
MODEL = """
name: rotary actuator in counts
joints: {actuator: rad}
terms:
  - {type: inertia, joint: actuator}
  - {type: viscous, joint: actuator}
  - {type: coulomb, joint: actuator}
"""


def stroke(path: Path) -> Log:
    angle, first, second = np.genfromtxt(path, skip_header=1, usecols=(4, 8, 9)).T[:, :, np.newaxis]
    time = np.arange(len(angle)) / RATE
    return Log(
        source=path.name,
        joints=("actuator",),
        start=0,
        position=Signal(time, angle, "Angle"),
        force=Signal(time, first - second, "PG_1 - PG_2"),
        pressure_a=Signal(time, first, "PG_1"),
        pressure_b=Signal(time, second, "PG_2"),
    )


@pytest.fixture(scope="module")
def diagnosis(real_data: Path, tmp_path_factory: pytest.TempPathFactory) -> Diagnosis:
    path = tmp_path_factory.mktemp("rotary") / "model.yaml"
    path.write_text(MODEL, encoding="utf-8")
    folder = real_data / "hydraulic_rotary_actuators" / "Act_5"
    logs = [stroke(one) for one in sorted(folder.glob("*.txt"))]
    return diagnose(load_model(path), logs[:-1], logs[-1:], Options(), load_thresholds())


def test_no_single_effect_is_named(diagnosis: Diagnosis) -> None:
    """One port is near zero in each stroke: gain of a transducer or friction of a direction?"""
    assert diagnosis.verdict in (Verdict.CLASS, Verdict.INSUFFICIENT)
    for finding in diagnosis.findings:
        assert finding.accepted.members


def test_what_was_not_recorded_is_said(diagnosis: Diagnosis) -> None:
    assert all("machine" in reason for reason in diagnosis.flow_unobservable.values())
    assert diagnosis.flow_unobservable
