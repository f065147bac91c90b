"""The line by which a node says that it works."""

from collections.abc import Iterable
from typing import Any

from rclpy.node import Node

OF_EVERY_NODE = ("lifecycle_msgs", "rcl_interfaces", "type_description_interfaces")


def say_ready(node: Node, *actions: str) -> None:
    """Log `ready: listens to ...; publishes ...; serves ...`, with full names.

    Whoever waits for a node, or reads its log, needs to know this line alone. `actions` are served
    beside the services of the node; what every node has is left out.
    """
    listened = [(one.msg_type, one.topic_name) for one in node.subscriptions]
    published = [(one.msg_type, one.topic_name) for one in node.publishers]
    served = [(one.srv_type, one.service_name) for one in node.services]
    parts = {
        "listens to": _own(listened),
        "publishes": _own(published),
        "serves": [*_own(served), *map(node.resolve_service_name, actions)],
    }
    text = "; ".join(f"{verb} {', '.join(names)}" for verb, names in parts.items() if names)
    node.get_logger().info(f"ready: {text}")


def _own(entities: Iterable[tuple[Any, str]]) -> list[str]:
    """Names of those whose type is none that every node has, each once."""
    return list(dict.fromkeys(name for kind, name in entities if not _of_every_node(kind)))


def _of_every_node(kind: type[Any]) -> bool:
    return kind.__module__.partition(".")[0] in OF_EVERY_NODE
