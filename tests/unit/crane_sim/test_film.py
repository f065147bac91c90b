"""A film of a bag: its pictures show the crane where the bag has it, and how far it has come."""

from pathlib import Path

import numpy as np
import pytest
from PIL import Image, ImageChops

from crane_bags import BagWriter
from crane_bags.types import JOINT_REFERENCE, JOINT_STATES
from crane_model import DataError, Machine
from crane_sim.drawing import film
from crane_sim.drawing.film import LEFT, RIGHT, Shot, Strip, shot

SIZE = (240, 200)
SECONDS, STEP = 4.0, 0.01
BEHIND = 0.05  # rad, of the measured inner boom


def test_a_shot_holds_what_the_bag_has_at_each_picture(bag: Path, machine: Machine) -> None:
    shown = shot(bag, machine, begin=1.0, length=2.0, rate=12.5)
    assert shown.time.tolist() == pytest.approx(np.arange(25) / 12.5)
    wanted = raised(1.0 + shown.time)
    np.testing.assert_allclose(shown.reference[:, 1], wanted, atol=1e-6)
    np.testing.assert_allclose(shown.position[:, 1], wanted - BEHIND, atol=1e-6)
    assert np.isnan(shown.reference[:, 0]).all()
    assert shown.moved == [1]


def test_a_shot_ends_with_the_bag(bag: Path, machine: Machine) -> None:
    assert shot(bag, machine, 3.0, 20.0, 10.0).time.size == 10


@pytest.mark.parametrize("begin", [-0.1, SECONDS, 1e6])
def test_a_film_that_begins_outside_of_the_bag_is_refused(
    begin: float, bag: Path, machine: Machine
) -> None:
    with pytest.raises(DataError, match=r"last 4\.0 s"):
        shot(bag, machine, begin, 1.0, 10.0)


def test_a_joint_that_was_not_measured_is_named(tmp_path: Path, machine: Machine) -> None:
    path = recorded(tmp_path / "bag", machine, lost="telescope")
    with pytest.raises(DataError, match="telescope was not measured"):
        shot(path, machine, 0.0, 1.0, 10.0)


def test_a_reading_beyond_its_limit_is_drawn_at_it(tmp_path: Path, machine: Machine) -> None:
    path = recorded(tmp_path / "bag", machine, telescope=9.0)
    shown = shot(path, machine, 0.0, 1.0, 10.0)
    assert (shown.position[:, 3] == machine.limits["telescope"].position_max).all()


def test_the_strip_fades_what_is_still_to_come(machine: Machine) -> None:
    time = np.linspace(0.0, 4.0, 50)
    position = np.zeros((50, 4))
    position[:, 1] = raised(time)
    strip = Strip(Shot(time, position, position + BEHIND), machine, 400, 120)
    begun, half, over = (strip.at(share) for share in (0.0, 0.5, 1.0))
    assert begun.size == half.size == over.size == (400, 120)
    middle = round((LEFT + RIGHT) / 2 * 400)
    left, right = (0, 0, middle - 1, 120), (middle + 2, 0, 400, 120)
    assert not ImageChops.difference(half.crop(left), over.crop(left)).getbbox()
    # but for the mark of now at either end
    inner = (right[0], 0, round(RIGHT * 400) - 2, 120)
    assert not ImageChops.difference(half.crop(inner), begun.crop(inner)).getbbox()
    assert contrast(over.crop(inner)) > 2 * contrast(begun.crop(inner))


def test_the_command_writes_a_film_in_which_the_crane_moves(
    opengl: None, bag: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "crane.webp"
    words = ["--bag", str(bag), "--out", str(out), "--length", "0.4", "--size", *map(str, SIZE)]
    assert film.main(words) == 0
    assert "0.4 s" in capsys.readouterr().out
    with Image.open(out) as moving:
        assert (moving.format, moving.size, moving.n_frames) == ("WEBP", SIZE, 5)
        pictures = []
        for number in range(moving.n_frames):
            moving.seek(number)
            pictures.append(orange(moving.convert("RGB")))
            assert moving.info["duration"] == 80  # ms
    assert all(one.mean() > 0.005 for one in pictures)
    assert (pictures[0] != pictures[-1]).sum() > 0.02 * pictures[0].sum()
    assert film.main(words) == 1
    assert "exists" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--out", "crane.gif"], "name it *.webp"),
        (["--out", "crane.webp", "--size", "10", "100"], "--size 10 100"),
        (["--out", "crane.webp", "--bag", "nowhere"], "nowhere"),
    ],
)
def test_wrong_requests_are_explained(
    words: list[str],
    message: str,
    opengl: None,
    bag: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    assert film.main(["--bag", str(bag), *words]) == 1
    assert message in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


@pytest.fixture(scope="module")
def bag(tmp_path_factory: pytest.TempPathFactory, machine: Machine) -> Path:
    return recorded(tmp_path_factory.mktemp("film") / "bag", machine)


def raised(time: np.ndarray) -> np.ndarray:
    """The reference of the inner boom [rad]; straight, so that interpolation is exact."""
    return np.asarray(0.2 + 0.2 * time)


def recorded(path: Path, machine: Machine, lost: str = "", telescope: float = 0.4) -> Path:
    """A bag of the inner boom that rises behind its reference."""
    times = STEP * np.arange(round(SECONDS / STEP) + 1)
    with BagWriter(path) as bag:
        states = bag.add_arrays(JOINT_STATES, machine.joint_names)
        reference = bag.add_arrays(JOINT_REFERENCE, ["inner_boom"])
        for time, wanted in zip(times, raised(times), strict=True):
            stamp = 10**9 + round(time * 1e9)
            q = {"slew": 0.0, "inner_boom": wanted - BEHIND, "outer_boom": -1.5}
            q["telescope"] = telescope
            position = [np.nan if joint == lost else q[joint] for joint in machine.joint_names]
            states.write(stamp, stamp, position, [0.0] * 4, [0.0] * 4)
            reference.write(stamp, stamp, [wanted], [0.2], [0.0])
    return path


def orange(image: Image.Image) -> np.ndarray:
    """(height, width) where the crane's paint is."""
    red, green, blue = np.moveaxis(np.asarray(image).astype(int), 2, 0)
    return (red > 1.5 * green) & (green > blue)


def contrast(image: Image.Image) -> float:
    return float(np.asarray(image.convert("L")).std())
