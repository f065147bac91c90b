"""Who publishes on a topic, for messages to people."""

from rclpy.node import Node


def publishers(node: Node, topic: str) -> list[str]:
    """Names of the nodes that publish on a topic, each once, in order."""
    return sorted({one.node_name for one in node.get_publishers_info_by_topic(topic)})
