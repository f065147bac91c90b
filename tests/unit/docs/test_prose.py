"""The check of the manual's prose, which `make lint` runs, finds what it is for."""

import importlib.util
import sys
from pathlib import Path
from types import ModuleType

import pytest
from manual import ROOT


def _loaded() -> ModuleType:
    spec = importlib.util.spec_from_file_location("check_prose", ROOT / "scripts/check_prose.py")
    assert spec and spec.loader
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


check = _loaded()


@pytest.mark.parametrize(
    ("sentence", "found"),
    [
        ("What is missing is named in one line.", "begins with 'What'"),
        ("Where the bus is lost, the valves close.", "begins with 'Where'"),
        ("*Of* a bag, it goes backwards.", "begins with 'Of'"),
        (" ".join(["word"] * 31) + ".", "31 words (limit 30)"),
        ("The stand-in machine moves.", "'stand-in'"),
        ("An orifice law describes the valve.", "'law'"),
        ("A gap is no error.", "'is no'"),
        ("It goes a long way.", "'way'"),
    ],
)
def test_faults_of_a_sentence(sentence: str, found: str) -> None:
    assert any(found in text for text, _ in check.judged(sentence))


@pytest.mark.parametrize(
    "sentence",
    [
        "What does this message mean?",
        " ".join(["word"] * 30) + ".",
        "The friction law and the control law are in the paper.",
        "There is no fault.",
        "A check valve has one way out.",
    ],
)
def test_plain_sentences_pass(sentence: str) -> None:
    assert list(check.judged(sentence)) == []


def test_code_and_markup_are_no_prose() -> None:
    page = """---
kernelspec: what
---

# Record

Run `planted` and read [the page](beside.md). It **works**.
It goes on here, e.g. Like this.

```bash
echo "Of a label"
```

| one | two words |
|---|---|
| ![a picture](beside.png) | $x_{gate}$ is small |

:::{warning}
1. First item
2. Second item
:::
"""
    assert list(check.sentences(page)) == [
        "Run `x` and read the page.",
        "It **works**.",
        "It goes on here, e.g Like this.",
        "two words",
        "a picture",
        "`x` is small",
        "First item",
        "Second item",
    ]


def test_links_to_missing_targets(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(check, "ROOT", tmp_path)
    (tmp_path / "there.md").write_text("# A `heading`: first\n")
    page = "[1](there.md#a-heading-first) [2](there.md#second) [3](gone.md) [4](https://a.b/c)"
    (tmp_path / "page.md").write_text(f"# Links\n\n{page} [5](#links)\n")
    assert [one.text for one in check.faults("page.md")] == [
        "a link leads to there.md#second",
        "a link leads to gone.md",
    ]


def test_pages_are_found() -> None:
    assert {"README.md", "docs/index.md", "docs/how_to/bring_up.md"} < set(check.pages())
    assert not any("generated" in page for page in check.pages())
