"""A bag with exchanged chambers: each command refuses it, and says why."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from unit.crane_identification.recording_check.recorded import packaged_motion, seen

from crane_identification.check_recording import main as check_recording
from crane_identification.diagnose import main as diagnose
from crane_identification.identify import main as identify
from crane_model import load_machine
from crane_model.machine_files import machine_file
from crane_sim import load_simulated_crane
from crane_sim.make_bag import write_bag

MODEL = str(machine_file("model.yaml"))
CAUSE = "telescope: chambers A and B are exchanged"


@pytest.fixture(scope="module")
def bags(tmp_path_factory: pytest.TempPathFactory) -> tuple[str, str]:
    """A good one and a bad one."""
    folder, machine, simulated = (
        tmp_path_factory.mktemp("bags"),
        load_machine(),
        load_simulated_crane(),
    )
    recording = seen(simulated, packaged_motion(machine, simulated.start))
    pressures, j = recording.pressures, recording.cylinders.index("telescope")
    a, b = np.copy(pressures.chamber_a), np.copy(pressures.chamber_b)
    a[:, j], b[:, j] = pressures.chamber_b[:, j], pressures.chamber_a[:, j]
    write_bag(folder / "good", machine, recording)
    exchanged = replace(recording, pressures=pressures._replace(chamber_a=a, chamber_b=b))
    write_bag(folder / "bad", machine, exchanged)
    return str(folder / "good"), str(folder / "bad")


def test_check_recording_tells_one_from_the_other(
    bags: tuple[str, str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    good, bad = bags
    assert check_recording([good]) == 0
    assert capsys.readouterr().out == f"{good}: looks right\n"
    absent = str(tmp_path / "absent")
    assert check_recording(["--model", MODEL, absent, good, bad]) == 1
    told = capsys.readouterr()
    assert f"{good}: looks right\n" in told.out
    assert absent in told.err
    assert f"{bad}: looks wrong\n  wrong: {CAUSE}" in told.out
    assert bad in told.err and good not in told.err


@pytest.mark.parametrize("command", [identify, diagnose])
def test_nothing_is_fitted_to_it(
    command, bags: tuple[str, str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    good, bad = bags
    given = ["--model", MODEL, "--train", good, "--validate", bad, "--out", str(tmp_path / "out")]
    assert command(given) == 1
    error = capsys.readouterr().err
    assert f"{bad}: {CAUSE}" in error and "--trust-recordings" in error
    assert not (tmp_path / "out").exists()


def test_what_fails_on_a_trusted_recording_fails_with_what_was_suspicious(
    bags: tuple[str, str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """It holds too little of anything: one period."""
    given = ["--model", MODEL, "--train", bags[1], "--period", "100", "--trust-recordings"]
    assert identify([*given, "--out", str(tmp_path / "out")]) == 1
    assert CAUSE in capsys.readouterr().err.partition("Suspicious before:")[2]
