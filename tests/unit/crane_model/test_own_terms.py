"""Terms of one's own out of a Python file, and gravity on one axis."""

import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from crane_model import ConfigurationError, Model, Record, load_model, simulate
from crane_model.terms import REGISTRY, Setting, candidates, load_terms, single_axis

CODE = '''
from typing import ClassVar, Literal
import numpy as np
from crane_model.terms import Effect, Family, JointTerm, Parameter

class Cubic(JointTerm):
    """tau = c q^3: a spring that stiffens."""

    type: Literal["cubic_spring"] = "cubic_spring"
    family: ClassVar[Family] = "friction"
    effect: ClassVar[Effect] = Effect("stiffening spring", "force at the ends", (), "a slow stroke")

    def column(self, record, j):
        return record.position[:, j] ** 3

    def parameter(self, coordinate, force):
        return Parameter("c", f"{force}/{coordinate}^3", 0.0, "stiffness")
'''
MODEL = "name: one\njoints: {axis: m}\nterms: [{type: cubic_spring, joint: axis}]\n"


@pytest.fixture(autouse=True)
def as_it_was(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Iterator[None]:
    registered = dict(REGISTRY)
    monkeypatch.setattr(sys, "path", list(sys.path))
    yield
    REGISTRY.clear()
    REGISTRY.update(registered)
    for name, module in list(sys.modules.items()):
        if str(getattr(module, "__file__", None)).startswith(str(tmp_path)):
            del sys.modules[name]


def write(path: Path, code: str = CODE) -> Path:
    path.write_text(code, encoding="utf-8")
    return path


def test_a_term_of_ones_own_is_one_like_the_others(tmp_path: Path) -> None:
    model_file = write(tmp_path / "model.yaml", MODEL)
    with pytest.raises(ConfigurationError, match="no term of type 'cubic_spring'.*of --terms"):
        load_model(model_file)
    (term,) = load_terms(write(tmp_path / "own_terms.py"))
    assert load_terms(tmp_path / "own_terms.py") == (term,)
    model = load_model(model_file)
    assert [(p.name, p.unit) for p in model.parameters] == [("c.axis", "N/m^3")]
    assert term in candidates(model.setting)


@pytest.mark.parametrize(
    ("name", "code", "message"),
    [
        ("own_a", CODE.replace("cubic_spring", "viscous"), "a term of type 'viscous' already"),
        ("own_b", "import nowhere_to_be_found", "ModuleNotFoundError: No module named 'nowhere_to"),
        ("own_c", "x = (", "own_c.py: SyntaxError: "),
        ("own_d", "x = 1", "defines no term; derive a class from crane_model.terms.JointTerm"),
        ("calendar", CODE, "'calendar' is also the name of .*; rename the file"),
    ],
)
def test_files_that_hold_no_terms(name: str, code: str, message: str, tmp_path: Path) -> None:
    before = dict(REGISTRY)
    with pytest.raises(ConfigurationError, match=message):
        load_terms(write(tmp_path / f"{name}.py", code))
    assert REGISTRY.items() >= before.items()


def test_files_that_are_not_there(tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError, match=r"terms.txt: no such Python file \(.py\)"):
        load_terms(write(tmp_path / "terms.txt"))


INERTIA, WEIGHT, ABOVE = 2.0, 40.0, 0.3  # kg m2; m g r, N m; rad, at q = 0


def test_a_pendulum_swings_about_where_it_hangs() -> None:
    gravity = [-WEIGHT * np.sin(ABOVE), WEIGHT * np.cos(ABOVE)]
    terms = (single_axis.Inertia(joint="axis"), single_axis.Gravity(joint="axis"))
    model = Model("pendulum", Setting({"axis": "rad"}, None), terms, np.array([INERTIA, *gravity]))
    hanging, small, time = -np.pi / 2 - ABOVE, 1e-3, np.arange(0.0, 2.0, 1e-3)
    start, still = np.full((1, 1), hanging + small), np.zeros((1, 1))
    motion = simulate(model, start, still, np.zeros((len(time), 1, 1)), 1e-3)
    expected = hanging + small * np.cos(np.sqrt(WEIGHT / INERTIA) * time)
    np.testing.assert_allclose(motion.position[:, 0, 0], expected, atol=1e-6)
    level = Record(("axis",), np.zeros(1), np.full((1, 1), -ABOVE), still, still)
    assert model.gravity(level)[0, 0] == pytest.approx(WEIGHT)


def test_the_weight_of_what_slides_is_an_offset() -> None:
    with pytest.raises(ConfigurationError, match="joint 'axis' slides.*use the term 'offset'"):
        single_axis.Gravity(joint="axis").parameters(Setting({"axis": "m"}, None))
