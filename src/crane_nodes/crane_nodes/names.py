"""The name of a node with the namespace that it lives in."""

from rclpy.node import Node


def full_name(node: Node) -> str:
    """Namespace and name, without the leading slash: `left/driver`, or `driver` in the root.

    So begin the names of statuses on /diagnostics, a topic that all nodes of a domain share.
    """
    return node.get_fully_qualified_name().lstrip("/")
