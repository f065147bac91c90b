"""Pictures and the viewer: drawn without a display, refused with a remedy where that cannot be."""

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from crane_model import ConfigurationError, Machine, load_machine
from crane_sim import SimulatedCrane
from crane_sim.drawing import picture, view
from crane_sim.drawing.picture import LIBRARIES, find_backend
from crane_sim.drawing.scene import FINENESS, Scene, draw, gl_context, take_picture
from crane_trajectory import FourierTrajectory

JOINTS = load_machine().joint_names

SIZE = (320, 200)


@pytest.fixture(scope="module")
def scene(opengl: None, simulated: SimulatedCrane, machine: Machine) -> Scene:
    return Scene(simulated, machine, *(FINENESS * side for side in SIZE))


def painted(image: Image.Image) -> np.ndarray:
    """(height, width) where the crane's orange is."""
    red, green, blue = np.moveaxis(np.asarray(image.convert("RGB")).astype(int), 2, 0)
    return (red > 1.5 * green) & (green > blue)


def test_crane_is_in_the_picture(scene: Scene) -> None:
    image = take_picture(scene, *SIZE)
    assert image.size == SIZE
    assert len(np.unique(np.asarray(image).reshape(-1, 3), axis=0)) > 500
    orange = painted(image)
    assert 0.02 < orange.mean() < 0.4
    border = np.ones_like(orange)
    border[2:-2, 2:-2] = False
    assert not (orange & border).any()  # all of it, with room around


def test_picture_follows_the_pose(scene: Scene, machine: Machine) -> None:
    q = np.array([0.0, 0.3, -1.5, 0.2])
    scene.set_pose(q)
    camera = scene.camera(SIZE[0] / SIZE[1])
    before = painted(Image.fromarray(draw(scene, camera, *SIZE)))
    scene.set_pose(q + [0.0, 0.2, 0.0, 0.0])
    after = painted(Image.fromarray(draw(scene, camera, *SIZE)))
    assert (before != after).sum() > 0.1 * before.sum()
    top = [np.flatnonzero(image.any(axis=1))[0] for image in (before, after)]
    assert top[1] < top[0]  # positive raises


def test_command_line_writes_a_png(opengl: None, tmp_path: Path) -> None:
    out = tmp_path / "crane.png"
    words = ["--out", str(out), "--size", *map(str, SIZE), "--pose", "inner_boom=0.6", "slew=-0.3"]
    assert picture.main(words) == 0
    with Image.open(out) as image:
        assert (image.format, image.size) == ("PNG", SIZE)
        assert painted(image).any()


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--out", "crane.jpg"], "name it *.png"),
        (["--out", "crane.png", "--pose", "inner_boom=3"], "outside its limits [-0.45, 1.37]"),
        (["--out", "nowhere/crane.png"], "no folder nowhere"),
        (["--out", "crane.png", "--size", "0", "100"], "--size 0 100"),
    ],
)
def test_wrong_requests_are_explained(
    words: list[str],
    message: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    assert picture.main(words) == 1
    assert message in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("backend", list(LIBRARIES))
def test_missing_library_names_its_package(backend: str, monkeypatch: pytest.MonkeyPatch) -> None:
    package = LIBRARIES[backend][1]
    monkeypatch.setitem(LIBRARIES, backend, ("libnot_there.so.0", package))
    monkeypatch.setenv("MUJOCO_GL", backend)
    with pytest.raises(ConfigurationError, match=f"needs libnot_there.*sudo apt install {package}"):
        gl_context(*SIZE)


def test_broken_driver_names_its_package(opengl: None, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuses(width: int, height: int) -> None:
        raise RuntimeError(f"no {width} by {height}")

    backend = find_backend()
    monkeypatch.setattr(f"mujoco.{backend}.GLContext", refuses)
    with pytest.raises(ConfigurationError, match=r"no 320 by 200.*sudo apt install lib"):
        gl_context(*SIZE)


def test_viewer_without_a_display_says_so(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    assert view.main([]) == 1
    assert "neither DISPLAY nor WAYLAND_DISPLAY is set" in capsys.readouterr().err


def test_viewer_replays_a_trajectory_and_holds_the_other_joints() -> None:
    coefficients = np.array([[0.5, -1.2], [0.2, 0.0], [0.0, 0.3]])  # offset, sine, cosine
    moved = ("inner_boom", "outer_boom")
    trajectory = FourierTrajectory.from_coefficients("two joints", 8.0, moved, coefficients)
    rest = np.array([0.4, 0.0, -1.0, 0.7])
    motion = view.replayed(trajectory, load_machine(), rest)
    for t in (0.0, 1.7, 8.0, 30.3):
        position = dict(zip(JOINTS, motion(t), strict=True))
        expected = trajectory.evaluate(np.array([t])).position[0]
        assert (position["slew"], position["telescope"]) == (0.4, 0.7)
        np.testing.assert_array_equal([position[joint] for joint in moved], expected)
