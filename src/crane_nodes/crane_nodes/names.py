"""Names on the ROS graph: those of nodes, and who publishes on a topic."""

from collections import Counter
from collections.abc import Collection, Iterable

from rclpy.node import Node
from rclpy.topic_endpoint_info import TopicEndpointInfo

# The name of a node with the namespace that it lives in.


def full_name(node: Node) -> str:
    """Namespace and name, without the leading slash: `left/driver`, or `driver` in the root.

    So begin the names of statuses on /diagnostics, a topic that all nodes of a domain share.
    """
    return node.get_fully_qualified_name().lstrip("/")


# Who publishes on a topic, for messages to people.

NAME_UNKNOWN = "_NODE_NAME_UNKNOWN_"  # ROS may find a publisher before the name of its node
UNNAMED = "a node not known by name yet"
LOOKS = 5  # after which a publisher is pointed out without a name


class NameLooks:
    """Looks at publishers that are pointed out once: their names follow, as a rule."""

    def __init__(self) -> None:
        self._unnamed: Counter[str] = Counter()  # looks, by topic

    def suffice(self, topic: str, names: Collection[str]) -> bool:
        """Whether to point out `names` on `topic` at this look: they are known, or for long not."""
        if UNNAMED not in names or self._unnamed[topic] >= LOOKS:
            return True
        self._unnamed[topic] += 1
        return False


def publishers(node: Node, topic: str) -> list[str]:
    """Full names of the nodes that publish on a topic, each once, in order."""
    return node_names(node.get_publishers_info_by_topic(topic))


def node_names(endpoints: Iterable[TopicEndpointInfo]) -> list[str]:
    """Full names of the nodes of publishers, each once, in order; `UNNAMED` last."""
    found = {(one.node_namespace, one.node_name) for one in endpoints}
    known = sorted(f"{space}/{name}".lstrip("/") for space, name in found if name != NAME_UNKNOWN)
    unnamed = any(name == NAME_UNKNOWN for _, name in found)
    return [*known, UNNAMED] if unnamed else known
