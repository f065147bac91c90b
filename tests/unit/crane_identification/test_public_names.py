"""What packages offer to programs: there, typed, cheap to import."""

import ast
import subprocess
import sys
from importlib import import_module
from pathlib import Path

import pytest

import crane_identification

HOME = Path(crane_identification.__file__).parent
COMMANDS = ("identify", "diagnose", "check_recording", "simulate")
WITHOUT_CAN = """
import sys
class Absent:
    def find_spec(self, name, path=None, target=None):
        if name.split(".")[0] in ("can", "cantools", "canopen", "rclpy", "crane_driver"):
            raise ModuleNotFoundError(f"{name}: not installed", name=name)
sys.meta_path.insert(0, Absent())
try:
    import can
except ModuleNotFoundError:
    from importlib import import_module
    for command in sys.argv[1:]:
        try:
            import_module(f"crane_identification.{command}").main(["--help"])
        except SystemExit as end:
            assert end.code == 0
"""


def test_names_are_there_and_typed() -> None:
    module = crane_identification
    assert module.__all__
    (typed,) = (
        block
        for block in ast.parse(Path(str(module.__file__)).read_text(encoding="utf-8")).body
        if isinstance(block, ast.If)
    )
    imports = [node for node in typed.body if isinstance(node, ast.ImportFrom)]
    homes = {alias.name: str(node.module) for node in imports for alias in node.names}
    assert sorted(homes) == module.__all__
    assert all(
        getattr(import_module(home), name) is getattr(module, name) for name, home in homes.items()
    )
    with pytest.raises(AttributeError, match="nothing"):
        _ = module.nothing


def test_folders_offer_nothing_beside() -> None:
    folders = [file for file in HOME.rglob("__init__.py") if file.parent != HOME]
    assert len(folders) >= 9
    assert not [file for file in folders if "import" in file.read_text(encoding="utf-8")]


def test_import_costs_nothing() -> None:
    """Neither numba nor SciPy nor NumPy: seconds, of which --version would need none."""
    code = "import crane_identification, sys; sys.exit('numpy' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code]).returncode == 0


def test_commands_need_neither_can_nor_ros() -> None:
    words = [sys.executable, "-c", WITHOUT_CAN, *COMMANDS]
    done = subprocess.run(words, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert done.stdout.count("usage:") == len(COMMANDS)


def test_help_costs_little() -> None:
    """Neither numba nor SciPy: a third of a second in place of four."""
    code = WITHOUT_CAN + "sys.exit(bool({'numba', 'scipy', 'sklearn'} & sys.modules.keys()))"
    assert subprocess.run([sys.executable, "-c", code, *COMMANDS]).returncode == 0


def test_marked_as_typed() -> None:
    assert (HOME / "py.typed").exists()
