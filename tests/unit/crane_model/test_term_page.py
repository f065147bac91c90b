"""The manual's page on the catalogue: complete, and its example of an effect of one's own works."""

import re
from pathlib import Path

import numpy as np
import pytest
from unit.crane_model.test_term_registry import SETTING, random_record

from crane_model.flow import FLOW_EFFECTS
from crane_model.model_file import load_model
from crane_model.terms import REGISTRY, Term, candidates, joints_of, typical

PAGE = Path(__file__).resolve().parents[3] / "docs" / "effects.md"


@pytest.fixture(scope="module")
def page() -> str:
    text = PAGE.read_text(encoding="utf-8")
    return text.split("## The catalogue of effects\n")[1].split("\n## ")[0]


def parameters(cls: type[Term]) -> list[tuple[str, str]]:
    """Names and units of the parameters on the first joint that has them, then of the shapes."""
    joint = next(iter(joints_of(cls, SETTING)), None)
    found = typical(cls, joint).parameters(SETTING)
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


def test_the_example_of_an_effect_of_ones_own(page: str, tmp_path: Path) -> None:
    """It is registered by being defined, is a candidate, and stands in a model file."""
    (code,) = re.findall(r"```python\n(.*?)```", page, re.DOTALL)
    known = set(REGISTRY)
    try:
        exec(compile(code, str(PAGE), "exec"), {"__name__": "effect_of_ones_own"})
        (name,) = set(REGISTRY) - known
        cls = REGISTRY[name]
        assert cls in candidates(SETTING)
        assert joints_of(cls, SETTING) == tuple(SETTING.units)
        record = random_record()
        column = typical(cls, "telescope").columns(record, SETTING)[:, 2, 0]
        np.testing.assert_array_equal(column, record.velocity[:, 2] ** 3)
        file = tmp_path / "model.yaml"
        file.write_text(
            f"name: one\njoints: {{axis: m}}\nterms:\n  - {{type: {name}, joint: axis}}\n"
        )
        assert [p.unit for p in load_model(file).parameters] == ["N s3/m3"]
    finally:
        for added in set(REGISTRY) - known:
            del REGISTRY[added]
