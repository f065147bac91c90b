"""What the client of an experiment asks the trajectory node for."""

from pathlib import Path

import pytest

from crane_trajectory.run_excitation_node import name_for_node


def test_files_go_by_their_place_and_trajectories_of_the_machine_by_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The node may run in another folder."""
    monkeypatch.chdir(tmp_path)
    Path("mine.yaml").write_text("")
    assert name_for_node(Path("mine.yaml")) == str(tmp_path / "mine.yaml")
    assert name_for_node(Path("runs/absent.yaml")) == str(tmp_path / "runs" / "absent.yaml")
    assert name_for_node(Path("excitation_20s")) == "excitation_20s"
