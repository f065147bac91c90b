"""Who publishes on a topic, for messages to people."""

from rclpy.node import Node


def publishers(node: Node, topic: str) -> list[str]:
    """Full names of the nodes that publish on a topic, each once, in order."""
    found = node.get_publishers_info_by_topic(topic)
    return sorted({f"{one.node_namespace}/{one.node_name}".lstrip("/") for one in found})
