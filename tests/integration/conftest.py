"""What several tests over real processes share."""

from collections.abc import Iterator

import pytest
from integration.driver_stage import Stage
from integration.patient_files import patient_safety


@pytest.fixture(scope="module")
def stage(ros_domain: int, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Stage]:
    """Simulated crane, and a patient driver."""
    folder = tmp_path_factory.mktemp("stage")
    one = Stage(folder, [], safety=patient_safety(folder))
    yield one
    one.close()
