"""The estimator fed from topics of any name and type: the same as from those of the suite."""

import numpy as np
import pytest
from laboratory_crane import PLANAR_JOINTS
from sensor_msgs.msg import FluidPressure, JointState
from std_msgs.msg import Float64MultiArray
from unit.crane_identification.online.online_crane import START, crane, record_log

from crane_bags.clocks import NANOSECONDS
from crane_identification import ColumnMap
from crane_identification.online.estimator import OnlineEstimator
from crane_identification.online.topics import Listener, mapped_listeners
from crane_model import CraneError

STATES, ARRAY, PRESSURE = (
    "sensor_msgs/msg/JointState",
    "std_msgs/msg/Float64MultiArray",
    "sensor_msgs/msg/FluidPressure",
)


def column_map(**changes: object) -> ColumnMap:
    """Side A in one array in bar, side B in a topic for each cylinder; the telescope in mm."""
    joints = {}
    for number, joint in enumerate(PLANAR_JOINTS):
        mm = {"unit": "mm"} if joint == "telescope" else {"unit": "rad", "scale": -1}
        joints[joint] = {
            "position": {"topic": "/q", "type": STATES, "field": "position", "index": joint} | mm,
            "pressure_a": {
                "topic": "/a", "type": ARRAY, "field": "data", "index": number, "unit": "bar"
            },
            "pressure_b": {
                "topic": f"/b/{joint}", "type": PRESSURE, "field": "fluid_pressure", "unit": "Pa"
            },
        }  # fmt: skip
    return ColumnMap.model_validate({"joints": joints} | changes)


def test_the_same_forces_as_from_the_topics_of_the_suite() -> None:
    log = record_log(3.0)
    assert log.pressure_a is not None
    assert log.pressure_b is not None
    usual, mapped = OnlineEstimator(crane()), OnlineEstimator(crane())
    listeners = {
        mapped_listener.topic: mapped_listener
        for mapped_listener in mapped_listeners(mapped, column_map(), "map.yaml")
    }
    assert {listener.msgtype for listener in listeners.values()} == {
        JointState, Float64MultiArray, FluidPressure
    }  # fmt: skip
    events = [(time, "q", row) for row, time in enumerate(log.position.time)]
    events += [(time, "p", row) for row, time in enumerate(log.pressure_a.time)]
    expected, found = [], []
    for time, kind, row in sorted(events):
        stamp = START + round(time * NANOSECONDS)
        if kind == "q":
            position = log.position.value[row]
            expected += usual.add_position(stamp, position)
            found += states(listeners["/q"], stamp, position)
        else:
            a, b = log.pressure_a.value[row], log.pressure_b.value[row]
            expected += usual.add_pressure(stamp, a, b)
            found += listeners["/a"].take(Float64MultiArray(data=(a / 1e5).tolist()), stamp)
            for joint, pressure in zip(PLANAR_JOINTS, b, strict=True):
                message = FluidPressure(fluid_pressure=pressure)
                set_stamp(message, stamp)
                found += listeners[f"/b/{joint}"].take(message, stamp + 5)
    assert len(found) == len(expected) > 10
    np.testing.assert_allclose([f.stamp for f in found], [f.stamp for f in expected])
    np.testing.assert_allclose(
        [f.measured for f in found], [f.measured for f in expected], rtol=1e-6, atol=1e-3
    )


def states(listener: Listener, stamp: int, position: np.ndarray) -> list:
    q = -position
    q[PLANAR_JOINTS.index("telescope")] *= -1e3
    message = JointState(name=["slew", *PLANAR_JOINTS], position=[0.0, *q.tolist()])
    set_stamp(message, stamp)
    return listener.take(message, stamp + 5)


def set_stamp(message: JointState | FluidPressure, stamp: int) -> None:
    message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp, NANOSECONDS)


@pytest.mark.parametrize(
    ("topic", "message", "reason"),
    [
        (
            "/q",
            JointState(name=["slew"], position=[0.0]),
            r"position\[inner_boom\]: its names are s",
        ),
        ("/q", JointState(name=["inner_boom"]), "position is empty"),
        ("/a", Float64MultiArray(data=[1.0]), "no place 1 in an array of 1, counted from 0"),
    ],
)
def test_what_a_message_lacks_is_said(
    topic: str, message: JointState | Float64MultiArray, reason: str
) -> None:
    listeners = mapped_listeners(OnlineEstimator(crane()), column_map(), "map.yaml")
    (listener,) = (listener for listener in listeners if listener.topic == topic)
    with pytest.raises(CraneError, match=f"{topic}: {reason}.*; correct the column map"):
        listener.take(message, 0)


@pytest.mark.parametrize(
    ("absent", "message"),
    [
        ("cylinder", "m.yaml: key 'joints.inner_boom': pressure_a and pressure_b are needed"),
        ("type", "m.yaml: topic /q: give its type, such as sensor_msgs/msg/JointState"),
    ],
)
def test_what_the_map_lacks_for_the_node(absent: str, message: str) -> None:
    content = column_map().model_dump(exclude_none=True)
    for joint, sources in content["joints"].items():
        if absent == "type":
            del sources["position"]["type"]
        else:
            del sources["pressure_a"], sources["pressure_b"]
            unit = "N" if joint == "telescope" else "N m"
            sources["force"] = {"topic": "/q", "field": "effort", "index": joint, "unit": unit}
    with pytest.raises(CraneError, match=message):
        mapped_listeners(OnlineEstimator(crane()), ColumnMap.model_validate(content), "m.yaml")
