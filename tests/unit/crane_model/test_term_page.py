"""The manual's page on the catalogue: complete, and its example of an effect of one's own works."""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from unit.crane_model import test_term_registry
from unit.crane_model.test_term_registry import SETTING, random_record, setting_of

import crane_model
from crane_model import load_model
from crane_model.flow import FLOW_EFFECTS
from crane_model.terms import REGISTRY, Term, candidates, joints_of, load_terms, typical

ROOT = Path(__file__).resolve().parents[3]
PAGE = ROOT / "docs" / "effects.md"


@pytest.fixture(scope="module")
def page() -> str:
    text = PAGE.read_text(encoding="utf-8")
    return text.split("## The catalogue of effects\n")[1].split("\n## ")[0]


def parameters(cls: type[Term]) -> list[tuple[str, str]]:
    """Names and units of the parameters on the first joint that has them, then of the shapes."""
    setting = setting_of(cls.model_fields["type"].default)
    joint = next(iter(joints_of(cls, setting)), None)
    found = typical(cls, joint).parameters(setting)
    linear = [(p.name.split(".")[0], p.unit) for p in found]
    return linear + [(name, shape.unit.split(" or ")[0]) for name, shape in cls.shapes.items()]


def test_the_tables_list_every_effect_as_its_class_states_it(page: str) -> None:
    """All but the equation, which is for people to compare."""
    rows = {}
    for line in page.splitlines():
        if line.startswith("| `"):
            cells = re.split(r"(?<!\\)\|", line)[1:-1]
            kind, name, _, values, signature, confusable = (cell.strip() for cell in cells)
            listed = re.findall(r"`(\w+)` \[(.+?)\]", values)
            others = tuple(re.findall(r"`(\w+)`", confusable))
            rows[kind.strip("`")] = name, listed, signature, others
    expected = {}
    for kind, cls in REGISTRY.items():
        if (effect := cls.effect) is not None:
            expected[kind] = effect.name, parameters(cls), effect.signature, effect.confusable
    for kind, (effect, symbol, unit) in FLOW_EFFECTS.items():
        expected[kind] = effect.name, [(symbol, unit)], effect.signature, effect.confusable
    assert rows == expected


@pytest.fixture(scope="module")
def example(page: str) -> str:
    (code,) = re.findall(r"```python\n(.*?)```", page, re.DOTALL)
    return code


def test_the_example_in_a_file_of_ones_own(example: str, tmp_path: Path) -> None:
    """As --terms takes it: a candidate, in a model file, and all that the registry asks for."""
    known, path = dict(REGISTRY), list(sys.path)
    try:
        (tmp_path / "my_terms.py").write_text(example, encoding="utf-8")
        (cls,) = load_terms(tmp_path / "my_terms.py")
        name = cls.model_fields["type"].default
        assert cls in candidates(SETTING)
        assert joints_of(cls, SETTING) == tuple(SETTING.units)
        record = random_record()
        column = typical(cls, "telescope").columns(record, SETTING)[:, 2, 0]
        np.testing.assert_array_equal(column, record.velocity[:, 2] ** 3)
        (parameter,) = load_model(model_with(name, tmp_path)).parameters
        assert parameter.unit == "N s3/m3"
        checks = [one for one in vars(test_term_registry).values() if is_of_each_type(one)]
        assert len(checks) > 5
        for check in checks:
            check(name)
    finally:
        REGISTRY.clear()
        REGISTRY.update(known)
        sys.path[:] = path
        sys.modules.pop("my_terms", None)


def test_the_example_in_a_new_file_of_the_package(example: str, tmp_path: Path) -> None:
    """The package imports, and a model file of it is read, with nothing else to change."""
    source = Path(crane_model.__path__[0])
    copy = shutil.copytree(source, tmp_path / "crane_model", ignore=shutil.ignore_patterns("*.pyc"))
    (copy / "terms" / "cubic_loss.py").write_text(example, encoding="utf-8")
    read = (
        "import sys, crane_model.model_file as files; "
        "print(files.load_model(sys.argv[1]).parameters[0].name, files.__file__)"
    )
    done = subprocess.run(
        [sys.executable, "-c", read, model_with("cubic_loss", tmp_path)],
        env=os.environ | {"PYTHONPATH": f"{tmp_path}:{os.environ.get('PYTHONPATH', '')}"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.stdout.split() == ["f_3.axis", str(copy / "model_file.py")], done.stderr


@pytest.mark.parametrize("words", [("ruff", "check"), ("ruff", "format", "--check"), ("mypy",)])
def test_the_example_passes_lint(words: tuple[str, ...], example: str, tmp_path: Path) -> None:
    file = tmp_path / "my_terms.py"
    file.write_text(example, encoding="utf-8")
    option = "--config-file" if words == ("mypy",) else "--config"
    done = subprocess.run(
        [sys.executable, "-m", *words, option, ROOT / "pyproject.toml", file],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr


def model_with(name: str, folder: Path) -> Path:
    """A model file of one term."""
    file = folder / "model.yaml"
    file.write_text(f"name: one\njoints: {{axis: m}}\nterms: [{{type: {name}, joint: axis}}]\n")
    return file


def is_of_each_type(one: object) -> bool:
    """Whether it is a test that every term of the registry has to pass."""
    return test_term_registry.each_type.mark in getattr(one, "pytestmark", [])
