"""What several tests over real processes share."""

from collections.abc import Iterator

import pytest
from integration.driver_stage import Stage


@pytest.fixture(scope="module")
def stage(ros_domain: int, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Stage]:
    """Simulated crane and driver."""
    one = Stage(tmp_path_factory.mktemp("stage"), [])
    yield one
    one.close()
