"""Rerun is large and optional: without it, the viewer explains itself and what to install."""

import sys

import pytest


@pytest.fixture(autouse=True)
def without_rerun(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in [name for name in sys.modules if name.startswith("crane_viewer.view")]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "rerun", None)


def test_help_does_not_need_rerun(capsys: pytest.CaptureFixture[str]) -> None:
    from crane_viewer.viewer import main

    with pytest.raises(SystemExit) as ended:
        main(["--help"])
    assert ended.value.code == 0
    assert "cannot move the crane" in " ".join(capsys.readouterr().out.split())


def test_a_view_names_what_to_install(capsys: pytest.CaptureFixture[str]) -> None:
    from crane_viewer.viewer import main

    assert main([]) == 1
    assert "make view" in capsys.readouterr().err
