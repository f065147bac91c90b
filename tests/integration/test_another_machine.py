"""The excavator live: simulated on its bus, with its driver and a trajectory of its joints."""

from collections.abc import Iterator

import numpy as np
import pytest
import yaml
from integration.driver_stage import Stage
from integration.experiments import PERIOD, Experiments

from crane_model import load_machine
from crane_trajectory import Outcome

NAME = "excavator"
DIG = {
    "name": "dig",
    "period": PERIOD,
    "joints": {
        "swing": {"offset": 0.0, "sine": [0.15], "cosine": [0.05]},
        "boom": {"offset": 0.8, "sine": [0.06], "cosine": [0.02]},
        "stick": {"offset": -1.5, "sine": [0.0, 0.06], "cosine": [0.1, 0.0]},
        "bucket": {"offset": -0.6, "sine": [0.12], "cosine": [-0.05]},
    },
}


@pytest.fixture(scope="module")
def excavator(ros_domain: int, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Experiments]:
    folder = tmp_path_factory.mktemp("excavator")
    stage = Stage(folder, [], machine=NAME)
    one = Experiments(stage, folder, "-p", f"machine:={NAME}", trajectory=DIG)
    yield one
    stage.end(one.process)
    stage.close()


def test_it_follows_a_trajectory_of_its_joints(excavator: Experiments) -> None:
    machine, stage = load_machine(NAME), excavator.stage
    assert tuple(stage.states[-1].name) == machine.joint_names
    assert tuple(stage.pressures[-1].name) == machine.joint_names  # the motor's, too
    begun = len(stage.states)
    result = excavator.ended(Outcome.COMPLETED)
    states = stage.states[begun:]
    assert tuple(result.name) == machine.joint_names
    assert (np.array(result.rms_tracking_error) < 0.1).all()
    positions = np.array([one.position for one in states])
    assert (np.ptp(positions, axis=0) > 0.1).all(), "every joint has moved"
    forces = np.array([one.effort for one in states])
    assert np.isfinite(forces).all() and (np.ptp(forces, axis=0) > 50.0).all()


def test_a_trajectory_of_another_machine_is_refused_by_its_joints(excavator: Experiments) -> None:
    foreign = excavator.folder / "foreign.yaml"
    joints = {"telescope": {"offset": 0.4, "sine": [0.1], "cosine": [0.05]}}
    foreign.write_text(yaml.safe_dump(DIG | {"joints": joints}))
    excavator.stage.enabled()
    result = excavator.refused(foreign)
    assert result.outcome == Outcome.TRAJECTORY_REFUSED
    assert "telescope" in result.message and "swing, boom, stick, bucket" in result.message
