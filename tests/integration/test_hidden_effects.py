"""Bags of a machine that hides effects, made by the executable: nothing in them tells."""

import json
import subprocess
from pathlib import Path

import numpy as np
import pytest
from ament_index_python.packages import get_package_prefix

from crane_driver.bags.reader import read_topics
from crane_driver.bags.types import CYLINDER_PRESSURES, JOINT_REFERENCE, JOINT_STATES
from crane_model.configuration import packaged
from crane_model.machine import PLANAR_JOINTS

SPEC = """
seed: 5
effects:
  - {effect: hose_stiffness, joint: telescope, strength: 0.05}
  - {effect: pressure_offset, joint: outer_boom, strength: 0.03}
"""


def run(*arguments: object) -> subprocess.CompletedProcess[str]:
    """`make_bag`."""
    path = Path(get_package_prefix("crane_sim")) / "lib" / "crane_sim" / "make_bag"
    trajectory = packaged("crane_trajectory", "excitation_20s.yaml")
    command = [path, "--trajectory", trajectory, "--periods", 1, "--seed", 3, *arguments]
    return subprocess.run([str(part) for part in command], capture_output=True, text=True)


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the bags plain/bag and hiding/bag, alike but for what is hidden."""
    folder = tmp_path_factory.mktemp("hidden")
    (folder / "spec.yaml").write_text(SPEC, encoding="utf-8")
    hide = ["--hide", folder / "spec.yaml", "--label", folder / "label.json"]
    for name, options in (("plain", []), ("hiding", hide)):
        (folder / name).mkdir()
        done = run("--out", folder / name / "bag", *options)
        assert done.returncode == 0, done.stderr
        assert "hose" not in done.stdout + done.stderr
    return folder


def test_bag_tells_nothing(made: Path) -> None:
    """Same files of the same size, metadata to the byte, stamps, reference; other readings only."""
    plain, hiding = made / "plain" / "bag", made / "hiding" / "bag"
    files = [{path.name: path.stat().st_size for path in bag.iterdir()} for bag in (plain, hiding)]
    assert files[0] == files[1]
    metadata = [(bag / "metadata.yaml").read_bytes() for bag in (plain, hiding)]
    assert metadata[0] == metadata[1]
    content = (hiding / "bag.mcap").read_bytes() + metadata[1]
    for word in (b"hose", b"stiff", b"hide", b"hidden", b"label", b"offset_", b"spec"):
        assert word not in content
    topics = (JOINT_STATES, CYLINDER_PRESSURES, JOINT_REFERENCE)
    read = [read_topics(bag, topics) for bag in (plain, hiding)]
    for topic in topics:
        np.testing.assert_array_equal(read[0][topic.name].stamp, read[1][topic.name].stamp)
    for name in read[0][JOINT_REFERENCE.name].fields:
        np.testing.assert_array_equal(*(part[JOINT_REFERENCE.name].fields[name] for part in read))
    pressures = [part[CYLINDER_PRESSURES.name].fields["chamber_a"] for part in read]
    assert not np.array_equal(*pressures)


def test_label_tells_all(made: Path) -> None:
    """Effects, parameters and strengths; the arrays beside it are those of the bag, less noise."""
    label = json.loads((made / "label.json").read_text(encoding="utf-8"))
    assert (label["bag"], label["seed"], label["clean"]) == ("bag", 3, "label.npz")
    assert [entry["effect"] for entry in label["effects"]] == ["hose_stiffness", "pressure_offset"]
    for entry, wanted in zip(label["effects"], (0.05, 0.03), strict=True):
        assert entry["strength_requested"] == wanted
        assert entry["strength"] == pytest.approx(wanted, rel=0.15)
        assert entry["strength"] == entry["strength_by_joint"][entry["joint"]]
    clean = np.load(made / "label.npz")
    bag = made / "hiding" / "bag"
    states = read_topics(bag, (JOINT_STATES,))[JOINT_STATES.name].select(PLANAR_JOINTS).fields
    seen = clean["seen_drive"][:, 1:]
    noise = np.sqrt(np.mean((states["effort"] - seen) ** 2, axis=0) / np.mean(seen**2, axis=0))
    assert (noise < 0.02).all()
    np.testing.assert_allclose(states["position"], clean["seen_position"][:, 1:], atol=1e-4)
    whole = np.mean(clean["drive"][:, 1:] ** 2, axis=0)
    shares = np.sqrt(np.mean(clean["force"][:, :, 1:] ** 2, axis=1) / whole)
    for entry, share in zip(label["effects"], shares, strict=True):
        assert entry["strength"] == pytest.approx(share[PLANAR_JOINTS.index(entry["joint"])])


def test_a_label_in_the_bag_is_refused(made: Path, tmp_path: Path) -> None:
    """By name, before anything is made; and a hidden effect without a label is refused too."""
    spec, bag = made / "spec.yaml", tmp_path / "bag"
    done = run("--out", bag, "--hide", spec, "--label", bag / "label.json")
    assert done.returncode == 1
    assert "must not tell what is hidden" in done.stderr
    done = run("--out", bag, "--hide", spec)
    assert done.returncode == 2
    assert "give both or none" in done.stderr
    assert not bag.exists()
