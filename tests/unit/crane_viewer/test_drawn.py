"""What is drawn of any machine, by itself: reach, cylinders, words."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from crane_bags import typestore
from crane_bags.types import DRIVER_STATE
from crane_model import load_machine, tip_position
from crane_model.inspection import placed_bars, poses
from crane_viewer import ground_arc, reached_places, side_outline
from crane_viewer.scene import along_z, round_bars
from crane_viewer.view import Diagnostics, driver_event, estimate_page, relative_deviations

MACHINES = ("laboratory_crane", "double_telescope_crane", "excavator", "single_axis")


@pytest.mark.parametrize("name", MACHINES)
def test_a_cylinder_is_as_long_as_its_linkage_says(name: str) -> None:
    machine = load_machine(name)
    for q in poses(machine):
        for bar in placed_bars(machine, q):
            if bar.is_cylinder:
                joint = machine.index(bar.joint)
                length = machine.cylinder(bar.joint, q[joint : joint + 1])[0, 0]
                assert np.linalg.norm(bar.end - bar.begin) == pytest.approx(length, abs=1e-9)


@pytest.mark.parametrize("name", MACHINES)
def test_as_many_bars_are_drawn_in_every_pose(name: str) -> None:
    machine = load_machine(name)
    assert len({len(round_bars(machine, q)) for q in poses(machine)}) == 1


@pytest.mark.parametrize("name", MACHINES)
def test_no_pose_within_the_limits_leaves_the_reach(name: str) -> None:
    """Poses of another generator than that of the outline."""
    machine = load_machine(name)
    low, _, high = poses(machine)
    q = low + np.random.default_rng(7).random((5000, len(low))) * (high - low)
    tips = tip_position(machine, q)
    places = reached_places(machine)
    outline, arc = side_outline(places), ground_arc(places)
    radius = np.hypot(tips[:, 0], tips[:, 1])
    assert radius.max() <= np.hypot(*arc.T).max() * 1.01
    band = np.ptp(outline[:, 1]) / 50
    assert outline[:, 1].min() - band <= tips[:, 2].min()
    assert tips[:, 2].max() <= outline[:, 1].max() + band


def test_bars_point_where_they_should() -> None:
    begin = np.array([0.1, -0.2, 0.3])
    for end in np.vstack([np.random.default_rng(1).normal(size=(20, 3)), begin - [0, 0, 1]]):
        turned = Rotation.from_quat(along_z(begin, end)).apply([0.0, 0.0, 1.0])
        assert turned == pytest.approx((end - begin) / np.linalg.norm(end - begin), abs=1e-9)


def test_a_fault_says_where_why_and_what_to_do() -> None:
    message = typestore().types[DRIVER_STATE.msgtype]
    state = SimpleNamespace(
        **{name: getattr(message, name) for name in dir(message) if name.startswith("STATE_")},
        state=5,
        text="fault",
        source="JointState",
        cause="late",
        remedy="reset",
        node="/driver",
    )
    event = driver_event(state)
    assert event.level == "ERROR"
    assert event.text == "/driver: fault (JointState); late; reset"


def test_a_status_is_told_when_it_changes_and_no_more() -> None:
    def array(level: int, message: str) -> SimpleNamespace:
        return SimpleNamespace(status=[SimpleNamespace(name="n", level=level, message=message)])

    diagnostics = Diagnostics()
    told = [
        [event.level for event in diagnostics.events(array(*one))]
        for one in ((0, "ok"), (2, "bad"), (2, "bad"), (0, "ok"), (0, "still"))
    ]
    assert told == [[], ["ERROR"], [], ["INFO"], []]


def test_what_is_not_determined_has_no_deviation() -> None:
    estimate = SimpleNamespace(
        model="m", name=["a", "b"], value=[-4.0, 1.0], std_dev=[0.2, np.inf], unit=["kg", ""],
        samples=7,
    )  # fmt: skip
    shares = relative_deviations(estimate)
    assert shares[0] == pytest.approx(5.0)
    assert np.isnan(shares[1])
    assert "| a | -4 | 0.2 | 5.0 % | kg |" in estimate_page(estimate)
    assert "| b | – | – | – | - |" in estimate_page(estimate)
