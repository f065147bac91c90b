"""The public names of crane_model and crane_sim, and what importing them costs."""

import importlib
import subprocess
import sys

import pytest
from unit.crane_model.test_architecture import FOLDERS

PACKAGES = ("crane_model", "crane_sim")


@pytest.mark.parametrize("package", PACKAGES)
def test_every_public_name_is_there(package: str) -> None:
    module = importlib.import_module(package)
    assert dir(module) == sorted(module.__all__)
    for name in module.__all__:
        assert getattr(module, name).__module__.startswith(f"{package}.")
    with pytest.raises(AttributeError, match=f"module '{package}' has no attribute 'crane'"):
        _ = module.crane


def test_importing_the_packages_compiles_nothing() -> None:
    heavy = {"numpy", "numba", "pydantic"}
    code = f"import sys, {', '.join(PACKAGES)}; print({heavy} & {{*sys.modules}})"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "set()"


def test_types_are_installed() -> None:
    for package in PACKAGES:
        assert (FOLDERS[package] / "py.typed").is_file()
        setup = (FOLDERS[package].parent / "setup.py").read_text(encoding="utf-8")
        assert '"py.typed"' in setup
