"""The policies of SROS2 allow each node what it does, and nobody else to command the valves."""

import gc
import re
import subprocess
import time
import xml.etree.ElementTree as ElementTree
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from fnmatch import fnmatchcase
from pathlib import Path
from typing import NamedTuple

import pytest
import rclpy
from from_code.nodes import NODES
from from_code.parameter_files import ROOT
from integration.processes import PATIENCE
from integration.test_namespaces import READY, activate
from rclpy.duration import Duration
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node

from crane_driver.operator.bringup.crane_client import CraneClient
from crane_interfaces.msg import DriverState
from crane_model import load_machine
from crane_nodes.driver_client import LATCHED, STATE_TOPIC
from crane_nodes.managed import Stop
from crane_nodes.recording.bag import RecordedBag
from crane_nodes.recording.player_node import Player
from crane_nodes.recording.recorder_node import Recorder
from crane_trajectory.run_excitation_node import RunExcitationClient

POLICIES = ROOT / "src/crane_nodes/security/policies.xml"
PAGE = (ROOT / "docs/how_to/ros.md").read_text("utf-8")
COMMANDING = {"trajectory", "jog", "bringup"}
COMMANDS = re.compile(r"create_publisher\(ValveCommand, (\"valve_command\"|TOPIC),")
OTHERS: dict[str, Callable[[], Node]] = {
    "run_excitation": lambda: RunExcitationClient(Stop()),
    "player": lambda: Player(Stop()),
    "bringup": lambda: CraneClient(Stop()),
    "recorder": lambda: Recorder(RecordedBag("bag"), []),
}
CALLBACKS = 30  # more than wait in a node that has just begun
ACTION = "/_action/"


class Rights(NamedTuple):
    """Expressions for full names that a profile allows, in words of SROS2."""

    publish: list[str]
    subscribe: list[str]
    reply: list[str]
    request: list[str]
    execute: list[str]
    call: list[str]

    def lacking(self, node: Node) -> list[str]:
        """What `node` does by the graph, and may not."""
        done = self._done(node)
        return [
            f"{verb} {name}"
            for verb, names in done.items()
            for name in names
            if not allows(getattr(self, verb), name)
        ]

    def _done(self, node: Node) -> dict[str, set[str]]:
        """By verb; what belongs to an action is told as that action."""
        asked: dict[str, Callable[..., list[tuple[str, list[str]]]]] = {
            "publish": node.get_publisher_names_and_types_by_node,
            "subscribe": node.get_subscriber_names_and_types_by_node,
            "reply": node.get_service_names_and_types_by_node,
            "request": node.get_client_names_and_types_by_node,
        }
        done: dict[str, set[str]] = {"execute": set(), "call": set()}
        for verb, ask in asked.items():
            names = {name for name, _ in ask(node.get_name(), node.get_namespace())}
            of_actions = {name for name in names if ACTION in name}
            done[verb] = names - of_actions
            if verb in ("reply", "request"):
                of = "execute" if verb == "reply" else "call"
                done[of] |= {name.partition(ACTION)[0] for name in of_actions}
            elif verb == "publish":  # feedback and status are the server's
                done["execute"] |= {name.partition(ACTION)[0] for name in of_actions}
            elif not done["call"]:  # who only looks at them
                done[verb] |= of_actions
        return done


def allows(rules: list[str], name: str) -> bool:
    return any(fnmatchcase(name, rule) for rule in rules)


def in_full(name: str, namespace: str, node: str) -> str:
    """As SROS2 reads a name in a profile."""
    inside = namespace.rstrip("/")
    if name.startswith("~"):
        return f"{inside}/{node}{name[1:]}"
    return name if name.startswith("/") else f"{inside}/{name}"


def rights(policies: str) -> dict[str, Rights]:
    """By the name of the node."""
    found = {}
    for profile in ElementTree.fromstring(policies).iter("profile"):
        node, namespace = profile.attrib["node"], profile.attrib["ns"]
        rules = {
            verb: [
                in_full(str(one.text), namespace, node)
                for group in profile
                if group.get(verb) == "ALLOW"
                for one in group
            ]
            for verb in Rights._fields
        }
        found[node] = Rights(**rules)
    return found


def of_namespace(namespace: str) -> dict[str, Rights]:
    """Of the file; in a namespace, of what the page makes of it."""
    if not namespace:
        return rights(POLICIES.read_text("utf-8"))
    made = re.search(r"^sed '(.*)' \$policies > left.xml$", PAGE, re.MULTILINE)
    assert made
    edit = subprocess.run(["sed", made[1], str(POLICIES)], capture_output=True, text=True)
    return rights(edit.stdout)


ALLOWED = of_namespace("")


@contextmanager
def running(make: Callable[[], Node], domain: int, namespace: str) -> Iterator[Node]:
    """A node, active if it can be so without files of a crane, of which the graph tells."""
    remapping = ["--ros-args", "-r", f"__ns:={namespace}"] if namespace else []
    gc.collect()  # a managed node is in the graph until then, and would be told of in its place
    rclpy.init(args=["node", *remapping], domain_id=domain)
    try:
        node = make()
        if node.get_name() in READY:
            activate(node)
        deadline = time.monotonic() + PATIENCE
        own = {one.topic_name for one in node.publishers}
        while not own <= set(dict(named(node))):
            assert time.monotonic() < deadline, own
            time.sleep(0.01)
        hears_a_driver(node)
        yield node
        node.destroy_node()
    finally:
        rclpy.shutdown()


def hears_a_driver(node: Node) -> None:
    """Whatever comes of it: some ask its services from then on."""
    played = Node("played", namespace=node.get_namespace())
    publisher = played.create_publisher(DriverState, STATE_TOPIC, LATCHED)
    publisher.publish(DriverState(node=f"{node.get_namespace().rstrip('/')}/driver"))
    if any(one.topic_name == publisher.topic_name for one in node.subscriptions):
        deadline = time.monotonic() + PATIENCE
        while not publisher.get_subscription_count():
            assert time.monotonic() < deadline
            time.sleep(0.01)
        assert publisher.wait_for_all_acked(Duration(seconds=PATIENCE))
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    for _ in range(CALLBACKS):
        executor.spin_once(timeout_sec=0.01)
    executor.shutdown()
    played.destroy_node()


def named(node: Node) -> list[tuple[str, list[str]]]:
    names: list[tuple[str, list[str]]] = node.get_publisher_names_and_types_by_node(
        node.get_name(), node.get_namespace()
    )
    return names


@pytest.mark.parametrize("namespace", ["", "/left"], ids=["alone", "left"])
@pytest.mark.parametrize("name", [*NODES, *OTHERS])
def test_each_node_may_do_what_it_does(
    name: str, namespace: str, ros_domain: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)  # for the recorder's bag
    make = (NODES | OTHERS)[name]
    with running(make, ros_domain, namespace) as node:
        allowed = of_namespace(namespace)[node.get_name()]
        assert not allowed.lacking(node)
        nothing = Rights([], [], [], [], [], [])
        assert any(one.startswith("publish") for one in nothing.lacking(node))
        assert any(one.startswith("reply") for one in nothing.lacking(node))


def test_the_viewer_may_listen_and_do_nothing_else(ros_domain: int, tmp_path: Path) -> None:
    own = {"/rosout", "/parameter_events"}
    viewer = ALLOWED["viewer"]
    assert set(viewer.publish) == own
    assert viewer.subscribe == ["/*"]
    assert viewer.reply == ["/viewer/*"]
    assert viewer.request == viewer.execute == viewer.call == []
    pytest.importorskip("rerun", reason="rerun is not installed (make view)")
    from crane_viewer.view import View
    from crane_viewer.viewer_node import Viewer

    view = View(load_machine(), live=True, file=tmp_path / "view.rrd")
    with running(lambda: Viewer(view), ros_domain, "") as node:
        assert not viewer.lacking(node)


@pytest.mark.parametrize("namespace", ["", "/left"], ids=["alone", "left"])
def test_three_nodes_may_command_the_valves_and_only_those_do(namespace: str) -> None:
    for name, allowed in of_namespace(namespace).items():
        commands = allows(allowed.publish, f"{namespace}/valve_command")
        assert commands is (name in COMMANDING), name
        for other in ("/valve_command", "/right/valve_command"):
            assert other == f"{namespace}/valve_command" or not allows(allowed.publish, other)
    sources = [*ROOT.glob("crane_*/**/*.py"), *ROOT.glob("src/**/*.py")]
    commanding = [one for one in sources if COMMANDS.search(one.read_text("utf-8"))]
    assert len(commanding) == len(COMMANDING), commanding


def test_only_those_who_operate_ask_the_driver_for_anything() -> None:
    asking = {name for name, one in ALLOWED.items() if allows(one.request, "/driver/enable")}
    assert asking == {"jog", "bringup", "panel", "run_excitation"}


@pytest.mark.parametrize("topic", ["/joint_states", "/driver/state"])
def test_only_the_driver_says_where_joints_are(topic: str) -> None:
    assert [name for name, one in ALLOWED.items() if allows(one.publish, topic)] == ["driver"]


def test_the_page_makes_an_enclave_of_each_profile() -> None:
    found = re.search(r"\$\(sed -n '(.*)' \$policies\)", PAGE)
    assert found
    made = subprocess.run(["sed", "-n", found[1], str(POLICIES)], capture_output=True, text=True)
    enclaves = list(ElementTree.parse(POLICIES).iter("enclave"))
    assert made.stdout.split() == [one.attrib["path"] for one in enclaves]
    for one in enclaves:
        assert [profile.attrib["node"] for profile in one.iter("profile")] in (
            [one.attrib["path"].removeprefix("/crane/")],
            ["_ros2cli"],  # a number follows
        )
