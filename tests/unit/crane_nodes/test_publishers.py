"""The names of those who publish."""

from rclpy.topic_endpoint_info import TopicEndpointInfo

from crane_nodes.managed import NAME_LOOKS, NAME_UNKNOWN, UNNAMED, NameLooks, node_names


def endpoint(namespace: str, name: str) -> TopicEndpointInfo:
    return TopicEndpointInfo(node_namespace=namespace, node_name=name)


def test_nodes_are_named_in_full_once_and_in_order() -> None:
    found = [endpoint("/", "watcher"), endpoint("/left", "driver"), endpoint("/", "watcher")]
    assert node_names(found) == ["left/driver", "watcher"]


def test_a_node_that_is_not_known_yet_comes_last_in_words() -> None:
    found = [endpoint("_NODE_NAMESPACE_UNKNOWN_", NAME_UNKNOWN), endpoint("/", "watcher")]
    assert node_names(found) == ["watcher", UNNAMED]


def test_a_name_is_waited_for_but_not_for_long() -> None:
    looks = NameLooks()
    assert looks.suffice("/mixed", ["watcher"])
    assert [looks.suffice("/mixed", ["watcher", UNNAMED]) for _ in range(NAME_LOOKS)] == [
        False
    ] * NAME_LOOKS
    assert looks.suffice("/mixed", ["watcher", UNNAMED])
    assert not looks.suffice("/other", [UNNAMED]), "each topic for itself"
