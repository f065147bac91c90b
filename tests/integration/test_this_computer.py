"""Nodes that talk within one computer: through its loopback alone, with all others there."""

import os
import socket
import subprocess
import sys
from pathlib import Path

import pytest
from integration.processes import end

from crane_nodes.this_computer import DISCOVERY_RANGE, PROFILES

PROGRAM = """
import sys
import rclpy
from rclpy.node import Node
from std_msgs.msg import String

own, other = sys.argv[1:]
rclpy.init()
node = Node(own)
publisher = node.create_publisher(String, own, 10)
node.create_timer(0.1, lambda: publisher.publish(String(data=own)))
node.create_subscription(String, other, lambda heard: print(heard.data, flush=True), 10)
try:
    rclpy.spin(node)
except rclpy.executors.ExternalShutdownException:
    pass
"""


def begin(own: str, other: str, environment: dict[str, str]) -> subprocess.Popen[str]:
    """A node that talks as `own` and prints what it hears of `other`."""
    return subprocess.Popen(
        [sys.executable, "-c", PROGRAM, own, other],
        env=environment,
        stdout=subprocess.PIPE,
        text=True,
    )


def listening(process: subprocess.Popen[str]) -> set[str]:
    """Local addresses of the IPv4 UDP sockets of a process."""
    links = Path(f"/proc/{process.pid}/fd").iterdir()
    inodes = {str(link.readlink()).removeprefix("socket:[").rstrip("]") for link in links}
    rows = [row.split() for row in Path("/proc/net/udp").read_text().splitlines()[1:]]
    own = [row[1].split(":")[0] for row in rows if row[9] in inodes]
    return {socket.inet_ntoa(bytes.fromhex(one)[::-1]) for one in own}


@pytest.mark.parametrize("other_range", ["SYSTEM_DEFAULT", "LOCALHOST", "SUBNET"])
def test_nodes_talk_through_the_loopback_alone(other_range: str, ros_domain: int) -> None:
    """With those of a shell without `env.sh`, too."""
    kept = dict(os.environ)
    if kept[DISCOVERY_RANGE] != "SYSTEM_DEFAULT":
        pytest.skip("the profile is for Fast DDS")
    node = begin("kept", "other", kept)
    plain = {name: value for name, value in kept.items() if name != PROFILES}
    other = begin(
        "other",
        "kept",
        kept if other_range == kept[DISCOVERY_RANGE] else plain | {DISCOVERY_RANGE: other_range},
    )
    try:
        assert node.stdout is not None and other.stdout is not None
        assert node.stdout.readline() == "other\n"
        assert other.stdout.readline() == "kept\n"
        assert listening(node) == {"127.0.0.1"}
    finally:
        end(node)
        end(other)
