"""The viewer as a process: what a bag or the topics tell arrives, and a real browser draws it."""

import io
import os
import signal
import socket
import time
from collections import defaultdict
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from integration.browser import installed
from integration.recording_graph import LATCHED, PATIENCE, Graph, Process
from laboratory_crane import JOINTS, PLANAR_JOINTS
from PIL import Image
from rclpy.duration import Duration
from rclpy.node import Node
from sensor_msgs.msg import JointState

from crane_bags import BagWriter
from crane_bags.types import CYLINDER_PRESSURES, DRIVER_STATE, JOINT_STATES, VALVE_COMMAND
from crane_interfaces.msg import DriverState, GeneralizedForces, ParameterEstimate

pytest.importorskip("rerun", reason="Rerun is not installed (make view)")
pytest.importorskip("websockets", reason="websockets is not installed (make view)")

COUNT, STEP = 400, 5_000_000  # of samples; ns
START = 1_700_000_000_000_000_000  # ns
TIMES = START + STEP * np.arange(COUNT)
POSITIONS = 0.2 + 0.1 * np.sin(np.arange(COUNT)[:, None] / 50.0 + np.arange(len(JOINTS)))
EFFORTS = 1000.0 * POSITIONS
PRESSURES = 1e6 * (1.0 + POSITIONS[:, : len(PLANAR_JOINTS)])
COMMANDS = 0.3 * np.cos(np.arange(COUNT)[:, None] / 30.0 + np.arange(len(JOINTS)))
CRANE_YELLOW = (150, 100, 20), (255, 190, 90)  # darkest and brightest of the drawn links
PAGE_PATIENCE = 100  # visits of 2 s


@pytest.fixture(scope="module")
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """2 s of made motion, with a fault in its middle."""
    path = tmp_path_factory.mktemp("bags") / "bag"
    with BagWriter(path) as writer:
        states = writer.add_arrays(JOINT_STATES, JOINTS)
        pressures = writer.add_arrays(CYLINDER_PRESSURES, PLANAR_JOINTS)
        commands = writer.add_arrays(VALVE_COMMAND, JOINTS)
        driver = writer.add(DRIVER_STATE)
        for k, time in enumerate(TIMES.tolist()):
            states.write(time, time, POSITIONS[k], np.zeros(len(JOINTS)), EFFORTS[k])
            pressures.write(time, time, PRESSURES[k], PRESSURES[k] / 2.0, 2e7, 0.0)
            commands.write(time, time, COMMANDS[k])
        fault = {"node": "/driver", "text": "fault", "cause": "encoders late", "remedy": "reset"}
        kind = writer.store.types[DRIVER_STATE.msgtype]
        header = writer.store.types["std_msgs/msg/Header"]
        stamp = writer.store.types["builtin_interfaces/msg/Time"]
        at = int(TIMES[COUNT // 2])
        driver.write(
            at,
            kind(
                **fault,
                state=DriverState.STATE_FAULT,
                fault=DriverState.FAULT_LATE,
                source="Encoders1",
                further_faults=0,
                substituted="",
                commands_refused=0,
                last_refusal="",
                header=header(stamp(at // 10**9, at % 10**9), ""),
            ),
        )
    return path


def saved(file: Path) -> dict[str, dict[str, list]]:
    """What a file of Rerun holds, as Rerun's own reader finds it: values by entity and column."""
    from rerun.chunk import RrdReader

    found: dict[str, dict[str, list]] = defaultdict(lambda: defaultdict(list))
    for chunk in RrdReader(file).stream():
        batch = chunk.to_record_batch()
        for name, column in zip(batch.schema.names, batch.columns, strict=True):
            found[chunk.entity_path.lstrip("/")][name.rpartition(":")[2]] += column.to_pylist()
    return found


def in_order(entity: dict[str, list]) -> np.ndarray:
    """The scalars (n, k) of an entity by their times."""
    times = [int(one.value) if hasattr(one, "value") else one for one in entity["time"]]
    order = np.argsort(np.array(times, dtype="datetime64[ns]"), kind="stable")
    return np.array(entity["scalars"], dtype=float)[order]


def test_a_bag_arrives_whole(bag: Path, tmp_path: Path) -> None:
    file = tmp_path / "bag.rrd"
    viewer = Process(tmp_path, "crane_viewer", "viewer", "--bag", bag, "--no-page", "--save", file)
    assert viewer.process.wait(PATIENCE) == 0, viewer.output
    entities = saved(file)
    for k, joint in enumerate(JOINTS):
        assert in_order(entities[f"positions/{joint}/measured"])[:, 0] == pytest.approx(
            POSITIONS[:, k]
        )
        assert in_order(entities[f"forces/{joint}/measured"])[:, 0] == pytest.approx(EFFORTS[:, k])
    for k, joint in enumerate(PLANAR_JOINTS):
        chambers = np.stack([PRESSURES[:, k], PRESSURES[:, k] / 2.0], axis=1) / 1e6
        assert in_order(entities[f"pressures/{joint}"]) == pytest.approx(chambers)
    assert in_order(entities["valve_commands"]) == pytest.approx(COMMANDS)
    assert entities["events"]["text"] == [["/driver: fault (Encoders1); encoders late; reset"]]
    assert entities["driver/state"]["state"] == [["fault"]]
    assert {f"joint_frames/{joint}" for joint in JOINTS} < set(entities)
    assert "scene/reach" in entities


def test_a_bag_of_another_machine_is_refused_and_says_so(bag: Path, tmp_path: Path) -> None:
    file = tmp_path / "bag.rrd"
    arguments = ("--bag", bag, "--no-page", "--save", file, "--machine", "excavator")
    viewer = Process(tmp_path, "crane_viewer", "viewer", *arguments)
    assert viewer.process.wait(PATIENCE) != 0
    assert "name the machine of the bag by --machine" in viewer.output
    assert not file.exists()


@pytest.mark.parametrize(
    ("place", "told"), [(".", "exists; name another"), ("absent/x.rrd", "there is no folder")]
)
def test_a_place_that_cannot_be_written_is_refused(
    bag: Path, tmp_path: Path, place: str, told: str
) -> None:
    arguments = ("--bag", bag, "--no-page", "--save", tmp_path / place)
    viewer = Process(tmp_path, "crane_viewer", "viewer", *arguments)
    assert viewer.process.wait(PATIENCE) == 1
    assert told in viewer.output


def test_a_port_in_use_is_told(bag: Path, tmp_path: Path) -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        arguments = ("--bag", bag, "--web-port", port, "--data-port", 0)
        viewer = Process(tmp_path, "crane_viewer", "viewer", *arguments)
        assert viewer.process.wait(PATIENCE) == 1
    assert f"ports {port} and" in viewer.output
    assert "name others by --web-port and --data-port" in viewer.output


def published(node: Node) -> set[str]:
    """What the viewer publishes on, as far as ROS has told yet."""
    found = node.get_publisher_names_and_types_by_node("viewer", "/")
    return {topic for topic, _ in found}


def test_topics_arrive_and_nothing_is_published(ros: Graph, tmp_path: Path) -> None:
    file = tmp_path / "live.rrd"
    node = ros.node
    publishers = {
        JointState: node.create_publisher(JointState, "/joint_states", 50),
        GeneralizedForces: node.create_publisher(GeneralizedForces, "/generalized_forces", 50),
        ParameterEstimate: node.create_publisher(ParameterEstimate, "/parameter_estimate", LATCHED),
        DriverState: node.create_publisher(DriverState, "/driver/state", LATCHED),
        DiagnosticArray: node.create_publisher(DiagnosticArray, "/diagnostics", 10),
    }
    viewer = Process(tmp_path, "crane_viewer", "viewer", "--no-page", "--save", file)
    try:
        ros.wait(lambda: all(one.get_subscription_count() for one in publishers.values()))
        own = {"/rosout", "/parameter_events"}
        ros.wait(lambda: "viewer" in node.get_node_names() and published(node) >= own)
        assert published(node) == own
        assert not node.get_client_names_and_types_by_node("viewer", "/")
        broken = DiagnosticStatus(level=b"\x02", name="driver: bus", message="bus-off")
        told = [
            DiagnosticArray(status=[broken]),
            ParameterEstimate(
                model="m", name=["a", "b"], value=[2.0, -4.0], std_dev=[0.1, 1.0], unit=["", ""]
            ),
            DriverState(node="/own/driver", state=DriverState.STATE_DISABLED, text="disabled"),
        ]
        for k in range(20):
            stamp = node.get_clock().now().to_msg()
            state = JointState(name=JOINTS, position=POSITIONS[k].tolist())
            forces = GeneralizedForces(
                name=PLANAR_JOINTS, measured=[0.0, 0.0, 0.0], predicted=[5.0 + k, 6.0, 7.0]
            )
            for message in (state, forces, *(told if k == 19 else [])):
                message.header.stamp = stamp
                publishers[type(message)].publish(message)
        for publisher in publishers.values():
            assert publisher.wait_for_all_acked(Duration(seconds=PATIENCE))
    finally:
        assert viewer.end(signal.SIGINT) == 0, viewer.output
    entities = saved(file)
    predicted = in_order(entities[f"forces/{PLANAR_JOINTS[0]}/predicted"])[:, 0]
    assert predicted == pytest.approx(5.0 + np.arange(20))
    position = in_order(entities[f"positions/{JOINTS[1]}/measured"])[:, 0]
    assert position == pytest.approx(POSITIONS[:20, 1])
    assert in_order(entities["parameters/uncertainty"]) == pytest.approx(np.array([[5.0, 25.0]]))
    # a driver of another test may just end
    events = [text for (text,) in entities["events"]["text"] if not text.startswith("/driver: ")]
    assert sorted(events) == ["/own/driver: disabled", "driver: bus: bus-off"]


def test_who_looks_gives_way(ros: Graph, tmp_path: Path) -> None:
    """Every thread of the viewer and of its server, in the session of who started it."""
    import psutil

    viewer = Process(tmp_path, "crane_viewer", "viewer", "--web-port", 0, "--data-port", 0)
    try:
        ros.wait(lambda: "ready: listens to" in viewer.output)
        started = psutil.Process(viewer.process.pid)
        processes = [started, *started.children(recursive=True)]
        assert len(processes) == 2
        for one in processes:
            assert os.getsid(one.pid) == os.getsid(0)
            for thread in one.threads():
                with suppress(ProcessLookupError):  # one of a pool that has ended meanwhile
                    assert os.sched_getscheduler(thread.id) == os.SCHED_IDLE
    finally:
        assert viewer.end(signal.SIGINT) == 0, viewer.output


def test_a_real_browser_draws_the_crane_on_loopback_alone(bag: Path, tmp_path: Path) -> None:
    from integration.live_page import Page  # needs what is skipped for above

    chromium = installed()
    arguments = ("--bag", bag, "--web-port", 0, "--data-port", 0)
    viewer = Process(tmp_path, "crane_viewer", "viewer", *arguments)
    try:
        while "shown: " not in viewer.output:
            assert viewer.running, viewer.output
            time.sleep(0.05)
        url = viewer.output.splitlines()[0].removeprefix("open in a browser: ")
        listening = ports_of_children(viewer.process.pid)
        assert {address for address, _ in listening} == {"127.0.0.1"}
        assert len(listening) == 2
        with Page(chromium, url, 1200, 700) as page:
            for _ in range(PAGE_PATIENCE):
                page.listen(2.0)
                if drawn(page.picture()) > 0.002:
                    break
            else:
                (tmp_path / "page.png").write_bytes(page.picture())
                pytest.fail(f"no crane on the page: {tmp_path / 'page.png'}; {page.console[-5:]}")
    finally:
        assert viewer.end(signal.SIGINT) == 0, viewer.output
    for _, port in listening:
        with socket.socket() as probe:
            assert probe.connect_ex(("127.0.0.1", port)), "the server outlived the viewer"


def ports_of_children(pid: int) -> set[tuple[str, int]]:
    """Addresses and ports on which the processes that `pid` has started listen."""
    import psutil

    return {
        (one.laddr.ip, one.laddr.port)
        for child in psutil.Process(pid).children(recursive=True)
        for one in child.net_connections(kind="tcp")
        if one.status == psutil.CONN_LISTEN
    }


def drawn(picture: bytes) -> float:
    """Share of pixels that have the crane's colour."""
    pixels = np.asarray(Image.open(io.BytesIO(picture)).convert("RGB"))
    darkest, brightest = CRANE_YELLOW
    yellow = np.all((pixels >= darkest) & (pixels <= brightest), axis=-1)
    saturated = pixels[..., 0].astype(int) - pixels[..., 2] > 80
    return float(np.mean(yellow & saturated))


def test_what_is_missing_is_said(tmp_path: Path) -> None:
    viewer = Process(tmp_path, "crane_viewer", "viewer", "--no-page")
    assert viewer.process.wait(PATIENCE) == 2
    assert "--save FILE.rrd" in viewer.output
