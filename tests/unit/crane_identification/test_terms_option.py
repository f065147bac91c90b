"""The option --terms of both commands."""

from collections.abc import Callable
from pathlib import Path

import pytest

from crane_identification import diagnose, identify


@pytest.mark.parametrize("main", [identify.main, diagnose.main])
def test_terms_are_loaded_before_the_model(
    main: Callable[[list[str]], int], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """And what is wrong with them ends the command."""
    (tmp_path / "own.py").write_text("raise ValueError('of my own making')")
    files = ["--model", "m.yaml", "--train", "a", "--validate", "b", "--out", str(tmp_path)]
    assert main([*files, "--terms", str(tmp_path / "own.py")]) == 1
    assert "own.py: ValueError: of my own making" in capsys.readouterr().err
