"""What several tests over real processes share."""

from collections.abc import Iterator

import pytest
import yaml
from integration.driver_stage import Stage
from integration.experiments import TIMEOUT

from crane_model.machine_files import machine_file


@pytest.fixture(scope="module")
def stage(ros_domain: int, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Stage]:
    """Simulated crane, and a driver as patient as the trajectory node of `Experiments`."""
    folder = tmp_path_factory.mktemp("stage")
    settings = yaml.safe_load(machine_file("safety.yaml").read_text())
    safety = folder / "safety.yaml"
    safety.write_text(yaml.safe_dump(settings | {"command_timeout": 2 * TIMEOUT}))
    one = Stage(folder, [], safety=str(safety))
    yield one
    one.close()
