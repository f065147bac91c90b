"""Every state that the driver tells has a colour of ours: of others the page chooses any."""

import pytest

pytest.importorskip("rerun", reason="Rerun is not installed (make view)")

from crane_driver.driver_messages import FINALIZED
from crane_driver.safety.supervisor import SafetyState
from crane_viewer.layout import STATES


def test_every_state_of_the_driver_has_a_colour() -> None:
    assert STATES.keys() == {*map(str, SafetyState), "unconfigured", "inactive", FINALIZED}
