"""The manual's page on the catalogue: complete, and its example of an effect of one's own works."""

import re
from pathlib import Path

import numpy as np
import pytest
from unit.crane_model.test_term_registry import SETTING, random_record

from crane_model.flow import FLOW_REGISTRY
from crane_model.model_file import load_model
from crane_model.terms import REGISTRY, candidates, joints_of, typical

PAGE = Path(__file__).resolve().parents[3] / "docs" / "effects.md"


@pytest.fixture(scope="module")
def page() -> str:
    text = PAGE.read_text(encoding="utf-8")
    return text.split("## The catalogue of effects\n")[1].split("\n## ")[0]


def test_the_tables_list_every_effect_as_its_class_states_it(page: str) -> None:
    rows = {}
    for line in page.splitlines():
        if line.startswith("| `"):
            cells = re.split(r"(?<!\\)\|", line)[1:-1]
            kind, name, _, signature, confusable = (cell.strip() for cell in cells)
            rows[kind.strip("`")] = name, signature, tuple(re.findall(r"`(\w+)`", confusable))
    classes = {**REGISTRY, **FLOW_REGISTRY}
    effects = {name: cls.effect for name, cls in classes.items() if cls.effect is not None}
    assert rows == {
        name: (effect.name, effect.signature, effect.confusable) for name, effect in effects.items()
    }


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
