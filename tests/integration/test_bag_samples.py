"""Bags that rosbag2 itself wrote: they open, and are refused for what they lack."""

import sqlite3
from contextlib import closing
from pathlib import Path

import pytest
from laboratory_crane import PLANAR_JOINTS

from crane_bags import Topic, read_topics
from crane_bags.storage import open_bag
from crane_identification import read_bag
from crane_model import DataError

SINGLE, SPLIT = "sqlite3/convert_a", "sqlite3/wbag"


@pytest.fixture
def samples(real_data: Path) -> Path:
    return real_data / "rosbag2_samples"


def log_times(file: Path, topic: str) -> list[int]:
    """Straight out of the database."""
    query = (
        "SELECT timestamp FROM messages JOIN topics ON topics.id = messages.topic_id "
        "WHERE topics.name = ? ORDER BY timestamp"
    )
    with closing(sqlite3.connect(f"file:{file}?immutable=1", uri=True)) as database:
        return [stamp for (stamp,) in database.execute(query, [topic])]


@pytest.mark.parametrize(("name", "count"), [(SINGLE, 150), (SPLIT, 6074)])
def test_folders_open(name: str, count: int, samples: Path) -> None:
    with open_bag(samples / name) as bag:
        assert bag.message_count == count


@pytest.mark.parametrize("topic", ["AAA", "DDD", "HHH"])
def test_every_message_of_a_split_bag_is_read(topic: str, samples: Path) -> None:
    strings = Topic(topic, "std_msgs/msg/String")
    data = read_topics(samples / SPLIT, [strings])[topic]
    assert data.stamped_by == "log time"
    files = sorted((samples / SPLIT).glob("*.db3"))
    assert len(files) == 5
    assert data.stamp.tolist() == [stamp for file in files for stamp in log_times(file, topic)]


@pytest.mark.parametrize(
    ("name", "topics"),
    [(SINGLE, "a_empty, b_basictypes"), (SPLIT, "AAA, BBB, CCC, DDD, EEE, FFF, GGG, HHH")],
)
def test_bags_without_joint_states_are_refused(name: str, topics: str, samples: Path) -> None:
    with pytest.raises(DataError) as error:
        read_bag(samples / name, PLANAR_JOINTS)
    assert f"{samples / name}: no topic /joint_states; the bag holds {topics}" in str(error.value)
    for file in (samples / name).glob("*.db3"):
        with pytest.raises(DataError, match="no topic /joint_states"):
            read_bag(file, PLANAR_JOINTS)


@pytest.mark.parametrize("name", ["mcap/convert_a", "mcap/wbag"])
def test_mcap_bags_are_refused_for_what_they_lack(name: str, samples: Path) -> None:
    """Joint states; or their .mcap files, where only the metadata were kept."""
    path = samples / name
    lacking = "no topic /joint_states" if list(path.glob("*.mcap")) else "files are missing.*.mcap"
    with pytest.raises(DataError, match=lacking) as error:
        read_bag(path, PLANAR_JOINTS)
    assert str(path) in str(error.value)
