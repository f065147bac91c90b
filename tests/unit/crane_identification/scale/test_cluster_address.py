"""What is no address of a Dask scheduler is refused before anything is read."""

from pathlib import Path

import pytest

from crane_identification.scale.cluster import fit_on_cluster
from crane_model import ConfigurationError, load_model
from crane_model.machine_files import machine_file


@pytest.mark.parametrize(
    "address",
    ["http://here:8786", "here:8786", "tcp://here", "tcp://here:port", "tcp://", "tcp://a b:1", ""],
)
def test_an_address_of_another_kind_is_refused(address: str) -> None:
    model = load_model(machine_file("model.yaml"))
    with pytest.raises(ConfigurationError, match=r"write tcp://HOST:PORT, or tls://, ws://"):
        fit_on_cluster(model, [Path("nowhere")], address)
