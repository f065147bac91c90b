"""A pseudo-random command on top of a motion: when, how large, and within all limits."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from unit.crane_trajectory.test_experiment import MOTION, TIMEOUT, TUNING, Crane

from crane_trajectory import Experiment, Motion, Outcome, load_trajectory
from crane_trajectory.design import main
from crane_trajectory.experiment import Stage
from crane_trajectory.motion.periodic import Probe

SIZE = 0.02


def probed(size: float = SIZE) -> Motion:
    update = {"probe": Probe(amplitude=size)}
    return replace(MOTION, trajectory=MOTION.trajectory.model_copy(update=update), periods=2)


def test_it_is_there_in_whole_periods_alone_and_repeats() -> None:
    motion = probed()
    time = np.arange(-1.0, motion.duration + 1.0, 0.005) + 0.001
    added = motion.probe(time)
    inside = (time >= motion.excitation_start) & (time < motion.excitation_end)
    assert not added[~inside].any()
    assert not added[:, 0].any()  # the slew is held
    assert (np.abs(added[inside][:, 1:]) == SIZE).all()
    first, second = (
        motion.probe(motion.excitation_start + k * 5.0 + np.arange(0.001, 5.0, 0.01))[:, 1:]
        for k in (0, 1)
    )
    np.testing.assert_array_equal(first, second)
    assert (np.abs(np.corrcoef(first.T) - np.eye(3)) < 0.3).all()
    assert (np.abs(first.mean(axis=0)) < 0.2 * SIZE).all()
    assert not MOTION.probe(time).any()


def test_an_experiment_adds_it_while_it_leads() -> None:
    plain, with_it = Crane(replace(MOTION, periods=2)), Crane(probed())
    stages = []
    for crane in (plain, with_it):
        while not crane.experiment.over:
            crane.cycle()
            if crane is with_it:
                stages.append(crane.experiment.stage)
        assert crane.experiment.outcome is Outcome.COMPLETED
    jumps = np.abs(np.diff(with_it.commands, axis=0)).max(axis=1)
    leads = np.array([stage is Stage.LEADING for stage in stages])[: len(with_it.commands)]
    usual = np.abs(np.diff(plain.commands, axis=0)).max()
    assert jumps[leads[1:]].max() > SIZE
    assert jumps.max() < usual + 3.0 * SIZE
    assert (with_it.commands[0] == 0.0).all() and (with_it.commands[-1] == 0.0).all()


def test_a_crane_that_brakes_has_none() -> None:
    crane = Crane(probed(0.05))
    while crane.experiment.elapsed < crane.experiment.motion.excitation_start + 2.0:
        crane.cycle()
    crane.experiment.stop(Outcome.CANCELED, "enough")
    before = len(crane.commands)
    while not crane.experiment.over:
        crane.cycle()
    steps = np.abs(np.diff(crane.commands[before + 1 :], axis=0)).max()
    assert steps < 0.05


def test_the_saturation_holds_for_both() -> None:
    crane = Crane(probed(0.05))
    narrow = replace(TUNING, saturation=0.1)
    crane.experiment = Experiment(crane.experiment.motion, narrow, TIMEOUT, crane.now)
    while not crane.experiment.over:
        crane.cycle()
    assert np.abs(crane.commands).max() <= 0.1 + 1e-12


def test_a_design_offers_it(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "probed.yaml"
    assert main(["--sweeps", "0.5", "--probe", "0.02", "--out", str(out)]) == 0
    assert load_trajectory(out).probe == Probe(amplitude=SIZE)
    with pytest.raises(SystemExit):
        main(["--sweeps", "0.5", "--probe", "0.2", "--out", str(out), "--replace"])
    assert "--probe: must be a number above 0 and at most 0.05" in capsys.readouterr().err
