"""Links of a page hold where page, model and bags are moved together."""

from pathlib import Path
from urllib.parse import unquote

import pytest

from crane_identification.report.html import link, page_of


@pytest.mark.parametrize("given", ["runs/train 1#2", "{here}/runs/train 1#2"])
def test_a_link_holds_where_everything_is_moved(
    given: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Whether the user gave a path from here or from the root."""
    here = tmp_path / "here"
    (here / "runs" / "train 1#2").mkdir(parents=True)
    (here / "results" / "fit").mkdir(parents=True)
    monkeypatch.chdir(here)
    made = link(given.format(here=here), Path("results/fit"))
    assert made.text == given.format(here=here)
    assert made.address == "../../runs/train%201%232"
    here.rename(tmp_path / "there")
    assert (tmp_path / "there" / "results" / "fit" / unquote(made.address)).is_dir()


def test_a_page_links_to_that_of_its_model(tmp_path: Path) -> None:
    for name in ("fit", "diagnosis"):
        (tmp_path / name).mkdir()
    model = str(tmp_path / "fit" / "model.yaml")
    assert page_of(model, tmp_path / "diagnosis") is None
    (tmp_path / "fit" / "report.html").write_text("")
    found = page_of(model, tmp_path / "diagnosis")
    assert found is not None and found.address == "../fit/report.html"
    assert page_of(model, tmp_path / "fit") is None  # not to itself
