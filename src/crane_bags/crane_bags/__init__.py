"""Bags of ROS 2 as arrays and back, without ROS.

A bag of two messages, and what it holds:

>>> from crane_bags import Place, Topic, BagWriter, namespace_of, read_fields
>>> from crane_bags import read_messages, read_topics
>>> states = Topic("/joint_states", "sensor_msgs/msg/JointState")
>>> with BagWriter("bag") as bag:
...     channel = bag.add_arrays(states, ["telescope"])
...     for k in range(2):  # received, stamped [ns]; position, velocity, effort
...         channel.write(k * 5_000_000, k * 5_000_000, [0.1 * k], [20.0], [300.0])
>>> found = read_topics("bag", [states])["/joint_states"]
>>> found.names, found.fields["position"].tolist()
(('telescope',), [[0.0], [0.1]])
>>> namespace_of("bag")
'/'

Single numbers are read out of any topic of any type:

>>> found = read_fields("bag", {"/joint_states": [Place("effort", "telescope")]}, {})
>>> found["/joint_states"].fields["effort[telescope]"].tolist()
[300.0, 300.0]

Messages of given types are read one by one:

>>> found = read_messages("bag", ["sensor_msgs/msg/JointState"])
>>> [(topic, message.position.tolist()) for topic, log_time, message in found]
[('/joint_states', [0.0]), ('/joint_states', [0.1])]

The topics of the suite and their types:

>>> from crane_bags import TOPICS, typestore
>>> all(topic.msgtype in typestore().types for topic in TOPICS)
True
"""

from typing import TYPE_CHECKING

from crane_model.lazily import lazily

if TYPE_CHECKING:
    from crane_bags.fields import Place as Place
    from crane_bags.fields import read_fields as read_fields
    from crane_bags.fields import read_messages as read_messages
    from crane_bags.reader import TopicData as TopicData
    from crane_bags.reader import namespace_of as namespace_of
    from crane_bags.reader import read_topics as read_topics
    from crane_bags.types import TOPICS as TOPICS
    from crane_bags.types import Topic as Topic
    from crane_bags.types import typestore as typestore
    from crane_bags.writer import ArrayChannel as ArrayChannel
    from crane_bags.writer import BagWriter as BagWriter

__getattr__, __dir__, __all__ = lazily(__name__, __file__)
