"""What several tests over real processes share."""

from collections.abc import Iterator
from pathlib import Path

import pytest
from integration.commander import Commander
from integration.driver_stage import Stage, commander
from integration.recording_graph import Graph, graph


@pytest.fixture(scope="module")
def stage(ros_domain: int, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Stage]:
    """Simulated crane and driver."""
    one = Stage(tmp_path_factory.mktemp("stage"), [])
    yield one
    one.close()


@pytest.fixture(scope="module")
def hand(stage: Stage) -> Iterator[Commander]:
    """The publisher of commands that the tests of a module share."""
    with commander(stage) as process:
        yield process


@pytest.fixture
def ros(ros_domain: int, tmp_path: Path) -> Iterator[Graph]:
    with graph(ros_domain, tmp_path) as made:
        yield made
