"""Who publishes on a topic, for messages to people."""

from collections.abc import Iterable

from rclpy.node import Node
from rclpy.topic_endpoint_info import TopicEndpointInfo

NAME_UNKNOWN = "_NODE_NAME_UNKNOWN_"  # ROS may find a publisher before the name of its node
UNNAMED = "a node not known by name yet"


def publishers(node: Node, topic: str) -> list[str]:
    """Full names of the nodes that publish on a topic, each once, in order."""
    return node_names(node.get_publishers_info_by_topic(topic))


def node_names(endpoints: Iterable[TopicEndpointInfo]) -> list[str]:
    """Full names of the nodes of publishers, each once, in order; `UNNAMED` last."""
    found = {(one.node_namespace, one.node_name) for one in endpoints}
    known = sorted(f"{space}/{name}".lstrip("/") for space, name in found if name != NAME_UNKNOWN)
    return known + [UNNAMED] * any(name == NAME_UNKNOWN for _, name in found)
