"""What every executable of the suite has in common, whichever `setup.py` names it."""

import re
from importlib import import_module
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[3]
PACKAGES = [*ROOT.glob("crane_*/setup.py"), *ROOT.glob("src/*/setup.py")]
NAMED = "".join(path.read_text(encoding="utf-8") for path in PACKAGES)
MODULES = sorted(set(re.findall(r'"([\w.]+):main"', NAMED)))


def test_all_executables_are_found() -> None:
    assert len(MODULES) > 15
    assert "crane_identification.identify" in MODULES


@pytest.mark.parametrize("module", MODULES)
def test_tells_its_version(module: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        import_module(module).main(["--version"])
    assert ended.value.code == 0
    assert re.search(r"of the crane suite \d+\.\d+\.\d+\n$", capsys.readouterr().out)


@pytest.mark.parametrize("module", MODULES)
def test_help_is_there_and_names_what_can_be_replaced(
    module: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """Where results go to a file, --replace lets them; a recording is never written over."""
    with pytest.raises(SystemExit) as ended:
        import_module(module).main(["--help"])
    assert ended.value.code == 0
    told = capsys.readouterr().out
    results = {
        *("decode", "design", "diagnose", "identify", "machine_command", "picture"),
        *("run_excitation_node", "move_node", "estimate_positions", "estimate_payload", "film"),
        *("export", "rehearse"),
    }
    assert ("--replace" in told) == (module.rpartition(".")[2] in results)
