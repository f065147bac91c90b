"""A machine is one folder of files, found by the machine's name, folder or machine file."""

from pathlib import Path

import pytest

import crane_machines
from crane_model import ConfigurationError, load_machine
from crane_model.machine_files import machine_file


@pytest.fixture
def own(tmp_path: Path) -> Path:
    """A folder of a machine under names of its own: its machine file is not machine.yaml."""
    text = machine_file("machine.yaml").read_text()
    (tmp_path / "machine.yaml").write_text(text.replace("gravity: 9.81", "gravity: 9.80"))
    (tmp_path / "slow.yaml").write_text(text.replace("gravity: 9.81", "gravity: 9.79"))
    (tmp_path / "safety.yaml").write_text("")
    return tmp_path


@pytest.mark.parametrize("name", crane_machines.shipped())
def test_every_shipped_machine_is_found_by_its_name(name: str) -> None:
    assert machine_file("machine.yaml", name).parent.name == name
    assert load_machine(name).name


def test_a_folder_or_a_file_name_a_machine_of_ones_own(own: Path) -> None:
    assert load_machine(own).gravity == 9.80
    assert load_machine(own / "slow.yaml").gravity == 9.79
    for machine in (own, str(own), own / "slow.yaml", own / "machine.yaml"):
        assert machine_file("safety.yaml", machine) == own / "safety.yaml"


def test_the_laboratory_crane_lends_no_file_to_another_machine(own: Path) -> None:
    with pytest.raises(ConfigurationError) as refused:
        machine_file("can.yaml", own)
    assert str(refused.value) == (
        f"{own / 'can.yaml'}: no such file of the machine (it has machine.yaml, safety.yaml, "
        "slow.yaml); write it there, or name another one"
    )


def test_a_shipped_machine_comes_before_a_folder_of_its_name(
    own: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (own / "laboratory_crane").mkdir()
    (own / "machine.yaml").rename(own / "laboratory_crane" / "machine.yaml")
    monkeypatch.chdir(own)
    assert load_machine("laboratory_crane").gravity == 9.81
    assert load_machine("./laboratory_crane").gravity == 9.80


def test_a_file_that_is_named_goes_before_that_of_the_machine(
    own: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A path is a path, there or not; a bare name is one of the machine's, unless it is there."""
    (own / "lazy.yaml").write_text("")
    (own / "elsewhere").mkdir()
    monkeypatch.chdir(own / "elsewhere")
    assert machine_file("safety.yaml", own, "") == own / "safety.yaml"
    assert machine_file("safety.yaml", own, "nowhere/mine.yaml") == Path("nowhere/mine.yaml")
    assert machine_file("safety.yaml", own, "lazy") == own / "lazy.yaml"
    assert machine_file("safety.yaml", own, "lazy.yaml") == own / "lazy.yaml"
    Path("lazy.yaml").write_text("")
    assert machine_file("safety.yaml", own, "lazy.yaml") == Path("lazy.yaml")
    with pytest.raises(ConfigurationError, match=r"fast\.yaml: no such file of the machine"):
        machine_file("safety.yaml", own, "fast")


@pytest.mark.parametrize("given", ["excavater", "nowhere/machine.yaml", "/", "."])
def test_no_machine_is_answered_with_those_that_ship(
    given: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(ConfigurationError, match=r"no such machine; .*laboratory_crane.*a folder"):
        load_machine(given)
