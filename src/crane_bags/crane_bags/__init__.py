"""Bags of ROS 2 as arrays and back, without ROS."""

from typing import TYPE_CHECKING

from crane_model.lazily import lazily

if TYPE_CHECKING:
    from crane_bags.fields import Place as Place
    from crane_bags.fields import read_fields as read_fields
    from crane_bags.namespaces import namespace_of as namespace_of
    from crane_bags.reader import TopicData as TopicData
    from crane_bags.reader import read_topics as read_topics
    from crane_bags.types import TOPICS as TOPICS
    from crane_bags.types import Topic as Topic
    from crane_bags.types import typestore as typestore
    from crane_bags.writer import ArrayChannel as ArrayChannel
    from crane_bags.writer import BagWriter as BagWriter

__getattr__, __dir__, __all__ = lazily(
    __name__,
    {
        "fields": ("Place", "read_fields"),
        "namespaces": ("namespace_of",),
        "reader": ("TopicData", "read_topics"),
        "types": ("TOPICS", "Topic", "typestore"),
        "writer": ("ArrayChannel", "BagWriter"),
    },
)
