"""A node of rclpy alone that talks with others; prints how long `publish` took at most [ms]."""

import sys
import time

import rclpy
from rclpy.node import Node
from sensor_msgs.msg import JointState

RATE = 50.0  # Hz


def main(own: str, others: str, seconds: str) -> None:
    """Publish on a topic of its own and listen to those of others, for so long [s]."""
    rclpy.init()
    node = Node(f"joining_{own}")
    publisher = node.create_publisher(JointState, f"joining_{own}", 10)
    for other in others.split(","):
        node.create_subscription(JointState, f"joining_{other}", lambda _: None, 10)
    message = JointState(name=["joint"], position=[0.0])
    longest, end = 0.0, time.monotonic() + float(seconds)
    print("ready", flush=True)
    while time.monotonic() < end:
        before = time.monotonic()
        publisher.publish(message)
        longest = max(longest, time.monotonic() - before)
        rclpy.spin_once(node, timeout_sec=0.0)
        time.sleep(1.0 / RATE)
    print(f"{1e3 * longest:.0f}", flush=True)


if __name__ == "__main__":
    main(*sys.argv[1:])
