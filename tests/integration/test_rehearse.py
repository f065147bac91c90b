"""A rehearsal of the machine with one axis, with real processes in simulated time."""

import shutil
import subprocess
from pathlib import Path

import pytest
import yaml
from ament_index_python.packages import get_package_prefix

from crane_benchmark.rehearsal.outcome import Rehearsal
from crane_driver.operator.bringup.rehearsed import why_not_rehearsed
from crane_model.machine_files import machine_file

REHEARSE = Path(get_package_prefix("crane_benchmark")) / "lib" / "crane_benchmark" / "rehearse"
FAULTS = ("boom.encoder.stuck", "boom.pressure_a.offset")
PERIOD, HARMONICS, SHARE = 10.0, 2, 0.75  # s, -, -: of shorter motions, within the joint's speed


@pytest.fixture(scope="module")
def machine(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A user's machine folder, with motions of half the time of the shipped ones."""
    folder = tmp_path_factory.mktemp("machine") / "own_axis"
    shutil.copytree(machine_file("machine.yaml", "single_axis").parent, folder)
    for name in ("excitation_20s.yaml", "validation_20s.yaml"):
        motion = yaml.safe_load((folder / name).read_text(encoding="utf-8"))
        boom = motion["joints"]["boom"]
        for part in ("sine", "cosine"):
            boom[part] = [SHARE * value for value in boom[part][:HARMONICS]]
        short = {"name": motion["name"], "period": PERIOD, "joints": {"boom": boom}}
        (folder / name).write_text(yaml.safe_dump(short), encoding="utf-8")
    return folder


@pytest.fixture(scope="module")
def folder(machine: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("rehearsal") / "single_axis"
    words = ["--machine", machine, "--out", out, "--periods", "2"]
    for fault in FAULTS:
        words += ["--fault", fault]
    done = subprocess.run([REHEARSE, *words], capture_output=True, text=True, cwd=out.parent)
    assert done.returncode == 0, done.stdout + done.stderr
    return out


def test_everything_is_rehearsed(folder: Path) -> None:
    found = Rehearsal.read(folder / "rehearsal.json")
    assert not found.failed
    (valve,) = found.valves
    assert valve.sign_stays
    assert valve.dead_band == pytest.approx(valve.true_dead_band, abs=0.005)
    assert sum(one.recovered for one in found.parameters) >= 0.7 * len(found.parameters)
    assert set(found.tracking) == {"pd_dead_band", "flow_and_pressures"}
    for margin in found.margins:
        assert margin.delay > 0.0
        assert margin.gain_margin >= margin.gain_margin_twice
    assert all(stop.distance > 0.0 for stop in found.stopping)
    lost = found.lost_encoder
    assert lost is not None
    assert 0.0 < lost.seconds_to_name < 2.0 and lost.seconds_to_neutral < 3.0
    assert [fault.fault for fault in found.faults] == list(FAULTS)
    stuck = found.faults[0]
    assert stuck.right and stuck.off > 3.0 * stuck.usual


def test_the_page_tells_it(folder: Path) -> None:
    page = (folder / "rehearsal.html").read_text(encoding="utf-8")
    assert "Complete." in page
    for heading in ("Bring-up", "Parameters", "Control and margins", "Sensor faults"):
        assert f"<h2>{heading}</h2>" in page


def test_bring_up_takes_it_for_the_same_files_only(folder: Path, machine: Path) -> None:
    assert why_not_rehearsed(folder, str(machine)) == ""
    assert "have changed" in why_not_rehearsed(folder, "excavator")
