"""The executable `design`, and the trajectories that ship with the package."""

import numpy as np
import pytest
from PIL import Image

from crane_model import load_machine, load_model
from crane_model.machine_files import machine_file
from crane_trajectory import load_clearance, load_design_settings, load_trajectory, plan
from crane_trajectory.design import main
from crane_trajectory.excitation.criterion import figures_of_merit
from crane_trajectory.motion.check import trajectory_violations

MACHINE = load_machine()
JOINTS = MACHINE.joint_names
PLANAR_JOINTS = JOINTS[1:]
MODEL = load_model(machine_file("model.yaml"))
SETTINGS = load_design_settings(machine_file("design.yaml"))
SHIPPED = {"excitation_20s": 20.0, "excitation_66s": 66.0, "validation_20s": 20.0}


@pytest.fixture(params=SHIPPED)
def shipped(request):
    return load_trajectory(machine_file(f"{request.param}.yaml"))


def test_shipped_trajectory_is_within_all_limits(shipped):
    assert shipped.joint_names == PLANAR_JOINTS
    assert shipped.period == SHIPPED[shipped.name]
    assert (
        trajectory_violations(MACHINE, shipped, load_clearance(machine_file("clearance.yaml")))
        == []
    )


def test_shipped_trajectory_can_be_run_from_a_usual_pose(shipped):
    motion = plan(
        MACHINE,
        shipped,
        np.array([0.0, 0.35, -1.5, 0.4]),
        5,
        load_clearance(machine_file("clearance.yaml")),
    )
    assert motion.duration < 5 * shipped.period + 30.0


def test_shipped_figures_of_merit_are_those_of_its_coefficients(shipped):
    merit = figures_of_merit(
        MODEL, shipped, SETTINGS.search.samples, SETTINGS.experiment, SETTINGS.plausible
    )
    assert list(merit) == list(shipped.figures_of_merit)
    for name, value in merit.items():
        assert shipped.figures_of_merit[name] == pytest.approx(value, rel=1e-3), name


def test_shipped_trajectory_determines_every_parameter(shipped):
    merit = shipped.figures_of_merit
    assert merit["condition_number"] < 620  # that of the report
    predicted = [merit[f"relative_std_dev.{p.name}"] for p in MODEL.parameters]
    assert max(predicted) < 0.05


def test_shipped_provenance_names_the_command_and_the_columns(shipped):
    assert f"design --period {shipped.period:g} " in shipped.provenance
    assert f"--out {shipped.name}.yaml" in shipped.provenance
    for parameter in MODEL.parameters:
        assert parameter.name in shipped.provenance


def test_training_and_validation_differ():
    first, second = (
        load_trajectory(machine_file(f"{name}.yaml")).evaluate(np.linspace(0.0, 20.0, 400)).position
        for name in ("excitation_20s", "validation_20s")
    )
    distance = np.linalg.norm(first[:, None] - second[None], axis=2).min(axis=0)
    assert distance.mean() > 0.1  # rad, m: how far the one stays from the other's path


def drawn(path):
    """Colours of a picture, of which there are many where curves have been drawn."""
    with Image.open(path) as picture:
        return len(picture.convert("RGB").getcolors(maxcolors=1 << 20)), picture.size


def test_campaign_writes_trajectories_with_figures_of_merit_and_pictures(tmp_path, capsys):
    out = tmp_path / "two"
    earlier = machine_file("excitation_20s.yaml")
    command = ["--period", "30", "--harmonics", "2", "--starts", "2", "--count", "2"]
    command += ["--criterion", "d-optimality", "--acceleration", "telescope=0.2"]
    command += ["--after", str(earlier), "--out", str(out)]
    assert main(command) == 0
    printed = capsys.readouterr().out
    found = [load_trajectory(out / f"two_{number}.yaml") for number in (1, 2)]
    assert found[0].coefficients.tolist() != found[1].coefficients.tolist()
    for trajectory in found:
        file = out / f"{trajectory.name}.yaml"
        assert (trajectory.period, trajectory.harmonics) == (30.0, 2)
        assert (
            trajectory_violations(
                MACHINE, trajectory, load_clearance(machine_file("clearance.yaml"))
            )
            == []
        )
        assert trajectory.figures_of_merit["peak_acceleration.telescope"] <= 0.2
        assert trajectory.figures_of_merit["condition_number_report_normalised"] > 1.0
        assert "--count 2 --criterion d-optimality" in trajectory.provenance
        assert "--after excitation_20s.yaml --out two." in trajectory.provenance
        assert str(tmp_path) not in trajectory.provenance
        assert f"written: {file}" in printed
        assert "5 periods of 30 s for each trajectory: the crane moves for 2.6 min" in printed
        colours, size = drawn(file.with_suffix(".png"))
        assert colours > 100
        assert size == (1320, 900)
    assert main(command) == 1
    assert "two: exists; a campaign is written to a new folder" in capsys.readouterr().err


def test_sweeps_are_written_with_a_picture(tmp_path, capsys):
    out = tmp_path / "sweeps.yaml"
    assert main(["--sweeps", "0.3", "0.9", "--dwell", "1", "--out", str(out)]) == 0
    sweeps = load_trajectory(out)
    assert (
        trajectory_violations(MACHINE, sweeps, load_clearance(machine_file("clearance.yaml"))) == []
    )
    assert "design --sweeps 0.3 0.9 --dwell 1 --out sweeps.yaml" in sweeps.provenance
    told = capsys.readouterr().out
    minutes = (sweeps.period + 8.0) / 60.0
    assert f"one period of {sweeps.period:.1f} s: the crane moves for {minutes:.1f} min" in told
    assert main(["--sweeps", "0.3", "--out", str(out)]) == 1
    assert "sweeps.yaml: exists; name another place, or --replace" in capsys.readouterr().err
    assert load_trajectory(out) == sweeps
    assert drawn(out.with_suffix(".png"))[0] > 100
    assert main(["--period", "20", "--after", str(out), "--out", str(tmp_path / "t.yaml")]) == 1
    assert "--after takes Fourier trajectories" in capsys.readouterr().err


@pytest.mark.parametrize(
    "wrong",
    [
        ["--period", "0"],
        ["--period", "nan"],
        ["--harmonics", "0"],
        ["--starts", "-1"],
        ["--criterion", "best"],
        ["--columns", "all"],
        ["--acceleration", "slew"],
        ["--sweeps", "1.5"],
    ],
)
def test_wrong_arguments_are_refused(wrong, tmp_path, capsys):
    command = ["--period", "20", "--out", str(tmp_path / "t.yaml"), *wrong]
    with pytest.raises(SystemExit) as caught:
        main(command)
    assert caught.value.code == 2
    assert wrong[0] in capsys.readouterr().err


@pytest.mark.parametrize("option", [["--load", "5"], ["--duration", "90"], ["--terms", "mine.py"]])
@pytest.mark.parametrize("what", [["--period", "20"], ["--sweeps", "0.1"]])
def test_what_means_nothing_without_discriminate_is_refused(what, option, tmp_path, capsys):
    assert main([*what, *option, "--out", str(tmp_path / "t.yaml")]) == 1
    assert f"{option[0]}: of --discriminate alone" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


def test_a_bound_of_no_joint_of_the_model_is_refused(tmp_path, capsys):
    out = tmp_path / "t.yaml"
    assert main(["--period", "20", "--out", str(out), "--acceleration", "elbow=1"]) == 1
    told = capsys.readouterr().err
    assert "no joint elbow; model" in told
    assert "has inner_boom, outer_boom, telescope" in told


def test_a_model_file_that_is_not_there_is_one_line(tmp_path, capsys):
    model = tmp_path / "absent.yaml"
    command = ["--period", "20", "--model", str(model), "--out", str(tmp_path / "t.yaml")]
    assert main(command) == 1
    assert f"error: {model}: no such file" in capsys.readouterr().err


def test_the_slew_is_held_by_every_shipped_trajectory(shipped):
    start = np.array([0.3, 0.35, -1.5, 0.4])
    motion = plan(MACHINE, shipped, start, 1, load_clearance(machine_file("clearance.yaml")))
    reference = motion.reference(np.linspace(0.0, motion.duration, 300))
    assert (reference.position[:, JOINTS.index("slew")] == 0.3).all()
