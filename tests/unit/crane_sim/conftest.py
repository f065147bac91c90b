"""The simulated crane and its surroundings."""

import pytest

from crane_model import ConfigurationError, Machine, load_machine
from crane_model.machine_files import machine_file
from crane_sim import SimulatedCrane, load_simulated_crane
from crane_trajectory import load_trajectory
from crane_trajectory.motion.periodic import PeriodicTrajectory


@pytest.fixture(scope="session")
def machine() -> Machine:
    """The laboratory crane."""
    return load_machine()


@pytest.fixture(scope="session")
def simulated() -> SimulatedCrane:
    """The simulated crane with the report's friction law."""
    return load_simulated_crane()


@pytest.fixture(scope="session")
def trajectory() -> PeriodicTrajectory:
    """The packaged excitation of 20 s."""
    return load_trajectory(machine_file("excitation_20s.yaml"))


@pytest.fixture(scope="session")
def opengl() -> None:
    """Skips where this machine cannot draw without a display."""
    from crane_sim.drawing.scene import gl_context

    try:
        gl_context(320, 200).free()
    except ConfigurationError as error:
        pytest.skip(str(error))
