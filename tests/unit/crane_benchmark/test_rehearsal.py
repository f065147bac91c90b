"""The parts of a rehearsal that need no processes, and its page."""

from pathlib import Path

import numpy as np
import pytest

from crane_benchmark.rehearsal.outcome import LostEncoder, Rehearsal, RehearsedParameter
from crane_benchmark.rehearsal.page import render, verdict
from crane_benchmark.rehearsal.rehearse import main
from crane_benchmark.rehearsal.tried import (
    RehearsedFault,
    RehearsedMargin,
    StoppingDistance,
    check_faults,
    every_kind,
    stopping_distances,
)
from crane_driver import load_safety
from crane_identification.report.summary import ParameterSummary
from crane_model import ConfigurationError, load_machine
from crane_model.machine_files import machine_file
from crane_sim.parts.parameters import load_both

MACHINE = load_machine("single_axis")


def parameter(value: float | None, std_dev: float | None, true: float) -> RehearsedParameter:
    found = ParameterSummary(name="f_c.boom", unit="N m", value=value, std_dev=std_dev)
    return RehearsedParameter.of(found, true)


def outcome(**changes: object) -> Rehearsal:
    content: dict[str, object] = {
        "machine": MACHINE.name,
        "date": "2026-11-28 12:00 UTC",
        "digest": "ab12",
        "failed": {},
        "seed": 1,
        "wall_seconds": 90.0,
        "parameters": [parameter(150.0, 1.0, 151.0), parameter(150.0, 1.0, 170.0)],
        "tracking": {"pd_dead_band": {"boom": 0.01}, "flow_and_pressures": {"boom": 0.001}},
        "margins": [
            RehearsedMargin(
                controller=name,
                joint="boom",
                delay=0.02,
                error=0.001,
                gain_margin=margin,
                gain_margin_twice=1.0,
            )
            for name, margin in (("pd_dead_band", 1.0), ("flow_and_pressures", 3.0))
        ],
        "stopping": [
            StoppingDistance(joint="boom", direction=1, speed=0.3, distance=0.05, allowed=0.1)
        ],
        "lost_encoder": LostEncoder(
            joint="boom", named_by="driver", seconds_to_name=0.4, seconds_to_neutral=0.6
        ),
        "faults": [
            RehearsedFault(
                fault="boom.encoder.stuck",
                off=0.05,
                usual=0.001,
                named="boom encoder: stuck",
                right=True,
                seconds=0.3,
            )
        ],
    }
    return Rehearsal.model_validate(content | changes)


@pytest.mark.parametrize(
    ("value", "std_dev", "true", "recovered"),
    [
        (150.0, 1.0, 152.9, True),
        (150.0, 1.0, 153.1, False),
        (1500.0, 1.0, 1525.0, True),  # 2 %
        (None, None, 152.0, False),
        (1.0, 1e6, 1.0, False),  # not determined
    ],
)
def test_recovered(
    value: float | None, std_dev: float | None, true: float, recovered: bool
) -> None:
    assert parameter(value, std_dev, true).recovered is recovered


def test_verdict() -> None:
    assert "1 of 2 parameters of the mechanics" in " ".join(verdict(outcome(), MACHINE))
    assert "named 1 of 1 injected faults" in " ".join(verdict(outcome(), MACHINE))
    far = StoppingDistance(joint="boom", direction=1, speed=0.3, distance=0.2, allowed=0.1)
    assert "lower the deceleration" in " ".join(verdict(outcome(stopping=[far]), MACHINE))
    failed = verdict(outcome(failed={"control": "it swings"}), MACHINE)
    assert failed == ["Not complete: control failed."]


def test_page() -> None:
    page = render(outcome(), MACHINE, "single_axis", Path())
    for text in ("<h2>Stopping distances</h2>", "SHA-256", "ab12", "flow_and_pressures"):
        assert text in page
    assert "Steps that failed" not in page
    assert "driver named it after 0.40 s" in page
    failed = render(outcome(failed={"control": "it <swings>"}), MACHINE, "single_axis", Path())
    assert "it &lt;swings&gt;" in failed


def test_stopping_distances_grow_with_the_ramp() -> None:
    machine, simulated = load_both("single_axis", None)
    safety = load_safety(machine_file("safety.yaml", "single_axis"), machine)
    slower = safety.model_copy(update={"ramp_time": 4.0 * safety.ramp_time})
    fast, slow = (
        stopping_distances(machine, simulated, settings, ["boom"]) for settings in (safety, slower)
    )
    for quick, late in zip(fast, slow, strict=True):
        assert quick.speed == late.speed > 0.0
        assert 0.0 < quick.distance < late.distance
        braking = quick.speed**2 / (2.0 * safety.deceleration["boom"])
        assert quick.allowed == pytest.approx(
            braking + quick.speed * safety.reaction_time + 0.002, rel=1e-9
        )
    assert np.sign([found.direction for found in fast]).tolist() == [1, -1]


def test_faults_are_those_of_the_machine() -> None:
    faults = every_kind(MACHINE, "boom")
    assert {"boom.encoder.stuck", "boom.valve.slow", "boom.pressures.swapped"} <= set(faults)
    check_faults(faults, MACHINE)
    with pytest.raises(ConfigurationError, match="leave out @SECONDS"):
        check_faults(["boom.encoder.stuck@3"], MACHINE)


def test_a_folder_of_something_else_is_never_deleted(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "precious").touch()
    words = ["--machine", "single_axis", "--out", str(tmp_path), "--replace"]
    assert main(words) == 1
    assert "name another folder" in capsys.readouterr().err
    assert (tmp_path / "precious").exists()
