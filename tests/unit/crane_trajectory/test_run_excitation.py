"""What the client of an experiment asks the trajectory node for, and what it is told."""

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from crane_trajectory.run_excitation_action import LONGEST_MESSAGE, bounded
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


@given(st.text(), st.integers(0, 3 * LONGEST_MESSAGE), st.text())
def test_a_long_message_keeps_what_it_is_about_and_what_to_do(
    about: str, length: int, to_do: str
) -> None:
    message = about + "x" * length + to_do
    told = bounded(message)
    assert len(told) < LONGEST_MESSAGE + 50
    assert told.startswith(about[: LONGEST_MESSAGE // 2])
    assert told.endswith(to_do[-LONGEST_MESSAGE // 2 :])
    if len(message) <= LONGEST_MESSAGE:
        assert told == message
    else:
        assert f"({len(message) - LONGEST_MESSAGE} characters left out)" in told
