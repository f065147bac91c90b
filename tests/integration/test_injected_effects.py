"""Bags with injected effects, made by the executable: nothing in them tells."""

import json
import subprocess
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest
from ament_index_python.packages import get_package_prefix
from laboratory_crane import PLANAR_JOINTS

from crane_bags import read_topics
from crane_bags.types import CYLINDER_PRESSURES, JOINT_REFERENCE, JOINT_STATES
from crane_model.machine_files import machine_file
from crane_sim import make_bag

SPEC = """
seed: 5
effects:
  - {effect: hose_stiffness, joint: telescope, relative_magnitude: 0.05}
  - {effect: pressure_offset, joint: outer_boom, relative_magnitude: 0.03}
"""


def run(*arguments: object) -> subprocess.CompletedProcess[str]:
    """`make_bag`."""
    path = Path(get_package_prefix("crane_sim")) / "lib" / "crane_sim" / "make_bag"
    trajectory = machine_file("excitation_20s.yaml")
    command = [path, "--trajectory", trajectory, "--periods", 1, "--seed", 3, *arguments]
    return subprocess.run([str(part) for part in command], capture_output=True, text=True)


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the bags plain/bag and injected/bag, alike but for what is injected."""
    folder = tmp_path_factory.mktemp("injected")
    (folder / "spec.yaml").write_text(SPEC, encoding="utf-8")
    inject = ["--inject", folder / "spec.yaml", "--ground-truth", folder / "label.json"]
    for name, options in (("plain", []), ("injected", inject)):
        (folder / name).mkdir()
        done = run("--out", folder / name / "bag", *options)
        assert done.returncode == 0, done.stderr
        assert "hose" not in done.stdout + done.stderr
    return folder


def test_bag_tells_nothing(made: Path) -> None:
    """Same files of the same size, metadata to the byte, stamps, reference; other readings only."""
    plain, injected_bag = made / "plain" / "bag", made / "injected" / "bag"
    files = [
        {path.name: path.stat().st_size for path in bag.iterdir()} for bag in (plain, injected_bag)
    ]
    assert files[0] == files[1]
    metadata = [(bag / "metadata.yaml").read_bytes() for bag in (plain, injected_bag)]
    assert metadata[0] == metadata[1]
    content = (injected_bag / "bag.mcap").read_bytes() + metadata[1]
    for word in (b"hose", b"stiff", b"inject", b"truth", b"offset_", b"spec"):
        assert word not in content
    topics = (JOINT_STATES, CYLINDER_PRESSURES, JOINT_REFERENCE)
    read = [read_topics(bag, topics) for bag in (plain, injected_bag)]
    for topic in topics:
        np.testing.assert_array_equal(read[0][topic.name].stamp, read[1][topic.name].stamp)
    for name in read[0][JOINT_REFERENCE.name].fields:
        np.testing.assert_array_equal(*(part[JOINT_REFERENCE.name].fields[name] for part in read))
    pressures = [part[CYLINDER_PRESSURES.name].fields["chamber_a"] for part in read]
    assert not np.array_equal(*pressures)


def test_label_tells_all(made: Path) -> None:
    """Effects, parameters and relative magnitudes; the arrays are those of the bag, less noise."""
    label = json.loads((made / "label.json").read_text(encoding="utf-8"))
    assert (label["bag"], label["seed"], label["clean"]) == ("bag", 3, "label.npz")
    assert [entry["effect"] for entry in label["effects"]] == ["hose_stiffness", "pressure_offset"]
    for entry, wanted in zip(label["effects"], (0.05, 0.03), strict=True):
        assert entry["relative_magnitude_requested"] == wanted
        assert entry["relative_magnitude"] == pytest.approx(wanted, rel=0.15)
        assert entry["relative_magnitude"] == entry["relative_magnitude_by_joint"][entry["joint"]]
    clean = np.load(made / "label.npz")
    bag = made / "injected" / "bag"
    states = read_topics(bag, (JOINT_STATES,))[JOINT_STATES.name].select(PLANAR_JOINTS).fields
    seen = clean["seen_drive"][:, 1:]
    noise = np.sqrt(np.mean((states["effort"] - seen) ** 2, axis=0) / np.mean(seen**2, axis=0))
    assert (noise < 0.02).all()
    np.testing.assert_allclose(states["position"], clean["seen_position"][:, 1:], atol=1e-4)
    speed = np.abs(clean["velocity"][:, 1:])
    sliding = speed > 0.02 * speed.max(axis=0)
    whole = (sliding * clean["drive"][:, 1:] ** 2).sum(axis=0)
    shares = np.sqrt((sliding * clean["force"][:, :, 1:] ** 2).sum(axis=1) / whole)
    for entry, share in zip(label["effects"], shares, strict=True):
        assert entry["relative_magnitude"] == pytest.approx(
            share[PLANAR_JOINTS.index(entry["joint"])]
        )


def injected(label: Path) -> list[tuple[str, str, dict[str, float]]]:
    """Effects, joints and parameters by a label."""
    effects = json.loads(label.read_text(encoding="utf-8"))["effects"]
    return [
        (one["name"], one["joint"], {p["name"]: p["value"] for p in one["parameters"]})
        for one in effects
    ]


def test_one_spec_is_one_machine_whatever_is_recorded(made: Path, tmp_path: Path) -> None:
    """Also later in the session, which the stamps tell."""
    other = machine_file("validation_20s.yaml")
    begun = ["--started", "2025-03-14T08:00:00", "--running", 600]
    inject = ["--inject", made / "spec.yaml", "--ground-truth", tmp_path / "label.json"]
    done = run("--out", tmp_path / "bag", "--trajectory", other, *begun, *inject)
    assert done.returncode == 0, done.stderr
    assert injected(tmp_path / "label.json") == injected(made / "label.json")
    stamp = read_topics(tmp_path / "bag", (JOINT_STATES,))[JOINT_STATES.name].stamp[0]
    start = datetime(2025, 3, 14, 8, 10, tzinfo=UTC).timestamp()
    assert start < stamp / 1e9 < start + 0.01


def test_a_label_makes_its_machine_again(made: Path, tmp_path: Path) -> None:
    """To the byte, where the motion and the noise are those of its bag."""
    label = tmp_path / "label.json"
    done = run("--out", tmp_path / "bag", "--inject", made / "label.json", "--ground-truth", label)
    assert done.returncode == 0, done.stderr
    assert injected(label) == injected(made / "label.json")
    bags = [(folder / "bag" / "bag.mcap").read_bytes() for folder in (tmp_path, made / "injected")]
    assert bags[0] == bags[1]


def test_labels_of_other_machines_and_other_files_are_refused(
    made: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """By name, before anything is made."""
    (tmp_path / "other.json").write_text('{"effects": [3]}', encoding="utf-8")
    plant = machine_file("simulated_crane_dynamic_friction.yaml")
    trajectory = machine_file("excitation_20s.yaml")
    for words, arguments in (
        ("ground truth of another machine", ("--inject", made / "label.json", "--plant", plant)),
        (
            "give a ground truth that --ground-truth has written",
            ("--inject", tmp_path / "other.json"),
        ),
        ("no such file", ("--inject", tmp_path / "none.json")),
    ):
        where = ("--out", tmp_path / "bag", "--ground-truth", tmp_path / "label.json")
        motion = ("--trajectory", trajectory, "--periods", 1)
        assert make_bag.main([str(word) for word in (*where, *motion, *arguments)]) == 1
        assert words in capsys.readouterr().err
    assert not (tmp_path / "bag").exists()


def test_a_label_in_the_bag_is_refused(made: Path, tmp_path: Path) -> None:
    """Before anything is made; so is an injected effect without a ground truth."""
    spec, bag = made / "spec.yaml", tmp_path / "bag"
    done = run("--out", bag, "--inject", spec, "--ground-truth", bag / "label.json")
    assert done.returncode == 1
    assert "must not reveal what was injected" in done.stderr
    done = run("--out", bag, "--inject", spec)
    assert done.returncode == 2
    assert "give both or none" in done.stderr
    assert not bag.exists()
