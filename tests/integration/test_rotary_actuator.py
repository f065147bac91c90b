"""Measured rotary actuators in counts: what cannot be told apart is a class, with its remedy."""

import json
from pathlib import Path
from typing import Any

import pytest

from crane_identification.diagnose import main

MODEL = """
name: rotary actuator in counts
joints: {actuator: rad}
terms:
  - {type: inertia, joint: actuator}
  - {type: viscous, joint: actuator}
  - {type: coulomb, joint: actuator}
"""
COLUMNS = """
rate: 1000.0  # assumed: the recordings do not say
separator: "\\t"
joints:
  actuator:
    position: {column: Angle, unit: counts}
    force:
      sum:
        - {column: PG_1, unit: counts}
        - {column: PG_2, unit: counts, scale: -1}
    pressure_a: {column: PG_1, unit: counts}
    pressure_b: {column: PG_2, unit: counts}
"""


def diagnosed(folder: Path, recordings: Path) -> dict[str, Any]:
    """findings.json of all strokes of an actuator but the last, by the name of its file."""
    tables = sorted(recordings.glob("*.txt"))
    (folder / "model.yaml").write_text(MODEL, encoding="utf-8")
    (folder / "columns.yaml").write_text(COLUMNS, encoding="utf-8")
    files = ("--model", folder / "model.yaml", "--columns", folder / "columns.yaml")
    logs = ("--train", *tables[:-1], "--validate", tables[-1], "--out", folder / "out")
    assert main([str(one) for one in (*files, *logs)]) == 0
    return json.loads((folder / "out" / "findings.json").read_text(encoding="utf-8"))


@pytest.fixture(scope="module")
def unloaded(real_data: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    folder = real_data / "hydraulic_rotary_actuators" / "Act_5"
    return diagnosed(tmp_path_factory.mktemp("unloaded"), folder)


def test_gain_of_a_transducer_or_friction_of_a_direction(unloaded: dict[str, Any]) -> None:
    """Each stroke goes one way, at one speed, with all of its pressure behind it."""
    assert unloaded["verdict"] == "ambiguous"
    (finding,) = unloaded["findings"]
    members = {finding["effect"], *(one["effect"] for one in finding["ambiguity_group"])}
    assert members == {"chamber_gain", "coulomb_asymmetry", "viscous_asymmetry", "offset"}
    assert finding["score"] > 2.0 * finding["threshold"]
    assert "transducers" in finding["discriminated_by"]


def test_what_has_no_unit_is_said(unloaded: dict[str, Any]) -> None:
    assert [name.split()[0] for name in unloaded["needs_units"]] == ["position", "force"] + (
        ["pressure"] * 2
    )
    assert {one["unit"] for one in unloaded["findings"][0]["parameters"]} == {"counts"}


def test_what_was_not_recorded_is_said(unloaded: dict[str, Any]) -> None:
    reasons = {one["effect"]: one["reason"] for one in unloaded["not_observable"]}
    assert "machine" in reasons["internal_leakage"]
    assert "temperature" in reasons["temperature_viscosity"]


def test_with_a_load_at_one_speed_the_data_do_not_suffice(real_data: Path, tmp_path: Path) -> None:
    """With a valve on its shaft: what one speed does not determine is left out, and said.

    The force is friction and load alone, which friction in proportion to it explains by itself.
    """
    content = diagnosed(tmp_path, real_data / "hydraulic_rotary_actuators" / "Act_1")
    assert content["verdict"] == "insufficient_data"
    assert "f_v.actuator" in content["reason"]
    assert content["findings"] == []
    assert content["undetermined"] == ["f_v.actuator"]
    reasons = {one["effect"]: one["reason"] for one in content["not_testable"]}
    assert "force itself" in reasons["load_friction"]
