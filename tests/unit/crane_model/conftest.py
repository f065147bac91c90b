import pytest

from crane_model import Machine, Model, load_machine, load_model
from crane_model.dynamics import Geometry
from crane_model.machine_files import machine_file


@pytest.fixture(scope="session")
def machine() -> Machine:
    return load_machine()


@pytest.fixture(scope="session")
def geometry(machine: Machine) -> Geometry:
    return Geometry.of(machine)


@pytest.fixture(scope="session")
def crane() -> Model:
    """The model (16) of 20 parameters that ships with the suite, not yet estimated."""
    return load_model(machine_file("model.yaml"))
