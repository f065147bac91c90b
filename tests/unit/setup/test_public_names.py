"""What `from PACKAGE import NAME` gives, and that it costs nothing before."""

import ast
import subprocess
import sys
from importlib import import_module
from pathlib import Path

import pytest

PACKAGES = (
    "crane_bags",
    "crane_nodes",
    "crane_driver",
    "crane_trajectory",
    "crane_benchmark",
    "crane_observer",
    "crane_viewer",
)


@pytest.mark.parametrize("name", PACKAGES)
def test_public_names_are_those_that_types_are_checked_by(name: str) -> None:
    package = import_module(name)
    path = Path(str(package.__file__))
    checked = {
        alias.name: str(node.module)
        for node in ast.walk(ast.parse(path.read_text("utf-8")))
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
        if alias.asname
    }
    assert sorted(checked) == package.__all__ == dir(package)
    for public, module in checked.items():
        assert getattr(package, public) is getattr(import_module(module), public)
    assert path.with_name("py.typed").exists()
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        package.nothing  # noqa: B018


def test_importing_a_package_imports_nothing_of_it() -> None:
    script = f"import sys, {', '.join(PACKAGES)}; print(*sys.modules)"
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=True
    )
    loaded = done.stdout.split()
    assert set(PACKAGES) <= set(loaded)
    heavy = [one for one in loaded if one in ("numpy", "rclpy", "pydantic", "rosbags", "can")]
    assert not heavy
    assert not [one for one in loaded if one.startswith(tuple(f"{name}." for name in PACKAGES))]
