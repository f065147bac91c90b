"""What can be refused without a recording is refused before one is read: these do not exist."""

from collections.abc import Callable
from pathlib import Path

import pytest

from crane_identification import diagnose, identify
from crane_model.machine_files import machine_file

MODEL = str(machine_file("model.yaml"))
COMMANDS = pytest.mark.parametrize("main", [identify.main, diagnose.main])
Main = Callable[[list[str]], int]


def words(out: Path, *more: str) -> list[str]:
    recordings = ["--train", "nowhere_1", "--validate", "nowhere_2"]
    return ["--model", MODEL, *recordings, "--out", str(out), *more]


@COMMANDS
def test_results_that_exist(main: Main, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """They stay as they are, whoever wrote them; --replace is asked for."""
    (tmp_path / "model.yaml").write_text("mine")
    assert main(words(tmp_path)) == 1
    assert "model.yaml: exists; name another place, or --replace" in capsys.readouterr().err
    assert main(words(tmp_path, "--replace")) == 1
    assert "nowhere_1" in capsys.readouterr().err  # nothing is in the way of reading
    assert (tmp_path / "model.yaml").read_text() == "mine"


@COMMANDS
def test_a_place_that_cannot_be_written_to(
    main: Main, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "file").write_text("")
    assert main(words(tmp_path / "file" / "fit")) == 1
    assert "file cannot be written to" in capsys.readouterr().err


def test_effects_that_are_in_no_catalogue(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert diagnose.main(words(tmp_path, "--without", "stribek")) == 1
    told = capsys.readouterr().err
    assert "stribek: no effect that shows in the force; there are actuator_inertia, " in told
    assert "stribeck" in told


def test_reference_values_of_parameters_that_there_are_not(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """They would be shown nowhere."""
    file = tmp_path / "true_values.json"
    file.write_text('{"J_FL": 480.0, "f_c.inner": 300.0}')
    assert identify.main(words(tmp_path / "fit", "--reference-values", str(file))) == 1
    told = capsys.readouterr().err
    assert "true_values.json: f_c.inner: no parameter of model" in told
    assert "it has J_FL, S_FL_along, " in told and "f_c.inner_boom" in told
    file.write_text('{"J_FL": 480.0, "lag.inner": 0.01}')
    assert identify.main(words(tmp_path / "fit", "--reference-values", str(file))) == 1
    told = capsys.readouterr().err
    assert "true_values.json: lag.inner: no parameter of model" in told
    assert "and the hydraulics of each joint, as lag.JOINT" in told
    file.write_text('{"J_FL": 480.0, "lag.inner_boom": 0.01}')
    identify.main(words(tmp_path / "fit", "--reference-values", str(file)))
    assert "nowhere_1" in capsys.readouterr().err


def test_an_estimator_that_there_is_not(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        identify.main(words(tmp_path, "--estimator", "best"))
    assert "there is no 'best'; there are least_squares, weighted, " in capsys.readouterr().err
