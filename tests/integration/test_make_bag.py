"""Bags of the simulated crane, made by the executable."""

import json
import subprocess
from pathlib import Path

import numpy as np
import pytest
from ament_index_python.packages import get_package_prefix
from known_crane import write_known_model
from laboratory_crane import JOINTS, PLANAR_JOINTS

from crane_bags import TopicData, read_topics
from crane_bags.types import (
    CYLINDER_PRESSURES,
    JOINT_REFERENCE,
    JOINT_STATES,
    VALVE_COMMAND,
)
from crane_model import generalized_forces, load_machine
from crane_model.machine_files import machine_file
from crane_sim.make_bag import main as make_bag
from crane_trajectory import load_trajectory

TOPICS = (JOINT_STATES, CYLINDER_PRESSURES, VALVE_COMMAND, JOINT_REFERENCE)
TRAJECTORY = machine_file("excitation_20s.yaml")


def _run(executable: str, *arguments: object) -> subprocess.CompletedProcess[str]:
    path = Path(get_package_prefix("crane_sim")) / "lib" / "crane_sim" / executable
    return subprocess.run([str(path), *map(str, arguments)], capture_output=True, text=True)


def _make(out: Path, seed: int) -> Path:
    done = _run(
        "make_bag", "--trajectory", TRAJECTORY, "--periods", 1, "--seed", seed, "--out", out
    )
    assert done.returncode == 0, done.stderr
    return out


@pytest.fixture(scope="module")
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """One period."""
    return _make(tmp_path_factory.mktemp("bags") / "one", 1)


@pytest.fixture(scope="module")
def topics(bag: Path) -> dict[str, TopicData]:
    """What it holds."""
    return dict(read_topics(bag, TOPICS))


def test_topics_are_sampled_together_at_200_hz(topics: dict[str, TopicData]) -> None:
    """Every sample of every topic, stamped alike; jitter as the sensors have it."""
    states = topics[JOINT_STATES.name]
    for data in topics.values():
        np.testing.assert_array_equal(data.stamp, states.stamp)
    interval = np.diff(states.stamp) / 1e9
    assert np.median(interval) == pytest.approx(0.005, rel=0.01)
    assert interval.min() > 0.0


def test_crane_follows_the_reference(topics: dict[str, TopicData]) -> None:
    """The reference is the trajectory, and the joints stay near it; slew is held."""
    position = topics[JOINT_STATES.name].select(JOINTS).fields["position"]
    reference = topics[JOINT_REFERENCE.name].select(JOINTS).fields["position"]
    trajectory = load_trajectory(TRAJECTORY)
    planar = reference[:, 1:]
    wanted = trajectory.evaluate(np.linspace(0.0, trajectory.period, 400))[0]
    for point in wanted[::40]:
        assert np.abs(planar - point).max(axis=1).min() < 0.01
    assert np.abs(position - reference).max(axis=0)[1:] == pytest.approx(0.0, abs=0.15)
    assert np.ptp(position[:, 0]) < 0.01


def test_effort_is_the_generalized_force_of_the_recorded_pressures(
    topics: dict[str, TopicData],
) -> None:
    """(27), and NaN for slew, which has no transducer."""
    states = topics[JOINT_STATES.name].select(PLANAR_JOINTS).fields
    pressures = topics[CYLINDER_PRESSURES.name].select(PLANAR_JOINTS).fields
    tau = generalized_forces(
        load_machine(),
        states["position"],
        pressures["chamber_a"],
        pressures["chamber_b"],
        PLANAR_JOINTS,
    )
    np.testing.assert_allclose(states["effort"], tau, rtol=1e-9, atol=1e-6)
    slew = topics[JOINT_STATES.name].select(["slew"]).fields["effort"]
    assert np.isnan(slew).all()


def test_forces_are_as_hard_as_those_of_the_report(topics: dict[str, TopicData]) -> None:
    """F4 peaks near 3000 N, with telescope and gripper under 200 kg."""
    effort = topics[JOINT_STATES.name].select(["telescope"]).fields["effort"]
    assert 2000.0 < np.nanmax(np.abs(effort)) < 4000.0
    true_values = json.loads(_run("true_values", "--json").stdout)
    assert true_values["m_TL"] < 200.0


def test_same_seed_same_bag_and_another_seed_other_noise(bag: Path, tmp_path: Path) -> None:
    """Values and stamps are repeated to the last bit."""
    first, again, other = (
        read_topics(path, (CYLINDER_PRESSURES,))[CYLINDER_PRESSURES.name]
        for path in (bag, _make(tmp_path / "again", 1), _make(tmp_path / "other", 2))
    )
    np.testing.assert_array_equal(first.stamp, again.stamp)
    np.testing.assert_array_equal(first.fields["chamber_a"], again.fields["chamber_a"])
    assert not np.array_equal(first.fields["chamber_a"], other.fields["chamber_a"])


def test_an_existing_folder_is_not_overwritten(bag: Path) -> None:
    """Refused by name, with the remedy; the bag stays."""
    before = sorted(path.stat().st_mtime_ns for path in bag.iterdir())
    done = _run("make_bag", "--trajectory", TRAJECTORY, "--periods", 1, "--out", bag)
    assert done.returncode == 1
    assert str(bag) in done.stderr
    assert sorted(path.stat().st_mtime_ns for path in bag.iterdir()) == before


def test_a_law_of_the_model_leads_it_ten_times_better(bag: Path, tmp_path: Path) -> None:
    model = write_known_model(tmp_path / "model.yaml")
    led = tmp_path / "led"
    law = "--law", "flow_and_pressures", "--model", model
    done = _run("make_bag", "--trajectory", TRAJECTORY, "--periods", 1, "--out", led, *law)
    assert done.returncode == 0, done.stderr
    before, after = (_errors(dict(read_topics(one, TOPICS))) for one in (bag, led))
    assert (after[1:] < 0.02 * before[1:]).all(), (before, after)


@pytest.mark.parametrize("words", [["--law", "adaptive_flow"], ["--model", "model.yaml"]])
def test_a_law_and_its_model_belong_together(
    words: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit):
        make_bag(["--trajectory", "a", "--periods", "1", "--out", str(tmp_path / "b"), *words])
    assert "every law but pd_dead_band needs a model" in capsys.readouterr().err


def _errors(topics: dict[str, TopicData]) -> np.ndarray:
    reference = topics[JOINT_REFERENCE.name].select(JOINTS).fields["position"]
    position = topics[JOINT_STATES.name].select(JOINTS).fields["position"]
    return np.sqrt(np.mean((reference - position) ** 2, axis=0))
