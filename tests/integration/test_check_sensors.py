"""Bags in which an encoder fails at a moment: the commands say so, and of others they do not."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from unit.crane_observer.observed import known

from crane_identification.identify import main as identify
from crane_identification.recording_check.check import faulty_sensors
from crane_model import save_model
from crane_model.configuration import load
from crane_model.machine_files import machine_file
from crane_observer.check_sensors import main as check_sensors
from crane_observer.monitor.tolerance import Tolerance
from crane_sim.make_bag import main as make_bag

AT = 30.0  # s
FAULT = f"inner_boom.encoder.drift=2e-3@{AT}"
NAMED = "inner_boom encoder: "


@pytest.fixture(scope="module")
def bags(tmp_path_factory: pytest.TempPathFactory) -> tuple[str, str]:
    """A good one and a bad one."""
    folder = tmp_path_factory.mktemp("bags")
    given = ["--trajectory", str(machine_file("excitation_20s.yaml"))]
    good, bad = str(folder / "good"), str(folder / "bad")
    assert make_bag([*given, "--periods", "3", "--seed", "7", "--out", good]) == 0
    faulty = ["--periods", "2", "--seed", "8", "--fault", FAULT]
    assert make_bag([*given, *faulty, "--out", bad]) == 0
    return good, bad


@pytest.fixture(scope="module")
def model(tmp_path_factory: pytest.TempPathFactory) -> str:
    path = tmp_path_factory.mktemp("model") / "model.yaml"
    save_model(path, known())
    return str(path)


def test_check_sensors_tells_one_from_the_other(
    bags: tuple[str, str], model: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    good, bad = bags
    picture = tmp_path / "sensors.png"
    assert check_sensors(["--model", model, "--bag", good, "--picture", str(picture)]) == 0
    told = capsys.readouterr().out
    assert f"{good}: fit for identification" in told
    assert picture.stat().st_size > 10_000
    assert check_sensors(["--model", model, "--bag", good, bad]) == 1
    told = capsys.readouterr()
    assert f"{bad}: not fit for identification\n  {NAMED}" in told.out
    assert bad in told.err and good not in told.err


def test_a_tolerance_that_was_learnt_sees_what_a_wide_one_misses(
    bags: tuple[str, str], model: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    good, _ = bags
    learnt, slow = tmp_path / "tolerance.yaml", str(tmp_path / "slow")
    given = ["--trajectory", str(machine_file("excitation_20s.yaml")), "--periods", "2"]
    small = f"inner_boom.pressure_a.offset=8e4@{AT}"  # of a minute, little can be learnt
    assert make_bag([*given, "--seed", "9", "--fault", small, "--out", slow]) == 0
    assert check_sensors(["--model", model, "--bag", good, "--learn", str(learnt)]) == 0
    assert set(load(learnt, Tolerance).joints) == set(known().joints)
    assert check_sensors(["--model", model, "--bag", slow]) == 0
    assert check_sensors(["--model", model, "--bag", slow, "--tolerance", str(learnt)]) == 1
    assert "inner_boom pressure A: " in capsys.readouterr().out
    assert check_sensors(["--model", model, "--bag", good, "--learn", str(learnt)]) == 1
    assert "is there already" in capsys.readouterr().err


def test_without_hydraulics_sensors_are_watched_alone(
    bags: tuple[str, str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bare, jumping = tmp_path / "bare.yaml", str(tmp_path / "jumping")
    save_model(bare, replace(known(), hydraulics=None))
    given = ["--trajectory", str(machine_file("excitation_20s.yaml")), "--periods", "2"]
    jump = f"inner_boom.encoder.jump=5e-3@{AT}"
    assert make_bag([*given, "--seed", "9", "--fault", jump, "--out", jumping]) == 0
    capsys.readouterr()
    assert check_sensors(["--model", str(bare), "--bag", bags[0]]) == 0
    told = capsys.readouterr().out
    assert told.startswith("hydraulics: none.") and f"{bags[0]}: fit for identification" in told
    assert check_sensors(["--model", str(bare), "--bag", jumping]) == 1
    found = re.search(
        rf"{NAMED}jump ([\d.]+) rad \(([\d.]+) to ([\d.]+)\)", capsys.readouterr().out
    )
    assert found
    size, least, most = map(float, found.groups())
    assert least < 5e-3 < most and size == pytest.approx(5e-3, rel=0.02)


def test_what_cannot_be_compared_is_refused(
    bags: tuple[str, str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bare = tmp_path / "bare.yaml"
    save_model(bare, replace(known(), hydraulics=None))
    for asked in (["--learn", str(tmp_path / "t.yaml")], ["--picture", str(tmp_path / "p.png")]):
        assert check_sensors(["--model", str(bare), "--bag", bags[0], *asked]) == 1
        assert "holds no hydraulics, so that nothing is compared" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == [bare]


def test_identify_warns_of_it_by_an_earlier_model(
    bags: tuple[str, str], model: str, tmp_path: Path
) -> None:
    good, bad = bags
    given = ["--train", bad, "--no-average", "--estimator", "least_squares"]
    assert identify(["--model", model, *given, "--out", str(tmp_path / "fit")]) == 0
    told = (tmp_path / "fit" / "summary.json").read_text(encoding="utf-8")
    assert f"{bad}: {NAMED}" in told
    assert faulty_sensors(known(), [Path(good)], np.inf) == ()
    assert (
        faulty_sensors(known(), [Path(bad)], AT - 5.0) == ()
    )  # with --to, what came later is left out
