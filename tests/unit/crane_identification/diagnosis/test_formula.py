"""Formulas of forces that the catalogue does not hold, on one axis; the laws are of this test."""

import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from unit.crane_identification.diagnosis.test_axis import FULL, model
from unit.crane_identification.synthetic import axis_log

from crane_identification import Log, Options, Signal, fit, validate
from crane_identification.diagnosis import words
from crane_identification.diagnosis.diagnosis import Diagnosis, diagnose
from crane_identification.diagnosis.findings import FoundFormula, Verdict
from crane_identification.thresholds import load_thresholds
from crane_model.terms import REGISTRY, load_terms

FORCE = 3.0  # N rms of what is added, a quarter of the drive's
Law = Callable[[np.ndarray, np.ndarray], np.ndarray]
LAWS: dict[str, Law] = {
    "ripple": lambda q, v: np.cos(q / 0.04),
    "damping along the stroke": lambda q, v: v * q**2,
    "damping of one half": lambda q, v: v * np.tanh(q / 0.05),
    "kink": lambda q, v: np.abs(q - 0.05),
    "bump": lambda q, v: np.exp(-(((q - 0.1) / 0.05) ** 2)),
    "waves with the speed": lambda q, v: np.sin(30.0 * q) * np.cos(9.0 * v),
}


def logs(folder: Path, law: Law) -> list[Log]:
    out, size = [], 0.0
    for seed in range(5):
        plain = axis_log(seed, model(folder, *FULL), periods=2)
        assert plain.force is not None
        q = plain.position.value[:, 0]
        added = law(q, np.gradient(q, plain.position.time))[:, np.newaxis]
        size = size or float(np.sqrt((added**2).mean()))
        measured = plain.force.value + FORCE / size * added
        out.append(replace(plain, force=Signal(plain.force.time, measured, "f")))
    return out


def diagnosed(folder: Path, law: Law) -> Diagnosis:
    recordings = logs(folder, law)
    given = recordings[:-1], recordings[-1:], Options(), load_thresholds()
    return diagnose(model(folder, *FULL), *given)


@pytest.fixture(scope="module")
def found(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Diagnosis]:
    return {name: diagnosed(tmp_path_factory.mktemp("law"), law) for name, law in LAWS.items()}


def formula_of(diagnosis: Diagnosis) -> FoundFormula | None:
    unknown = diagnosis.results().unknown
    return None if unknown is None else unknown.formula


def test_most_unknown_forces_have_a_formula_that_closes_the_error(
    found: dict[str, Diagnosis],
) -> None:
    """On held-out recordings."""
    assert {one.verdict for one in found.values()} == {Verdict.UNKNOWN}
    formulas = {name: formula_of(one) for name, one in found.items()}
    closed = [name for name, one in formulas.items() if one and (one.closed_share or 0.0) >= 0.8]
    assert len(closed) >= len(LAWS) / 2
    assert formulas["bump"] is None  # none rather than a bad one


def test_a_formula_has_the_scale_and_the_size_of_the_law(found: dict[str, Diagnosis]) -> None:
    one = formula_of(found["ripple"])
    assert one is not None
    assert one.equation.startswith("a cos(q/0.0")
    (size,) = one.parameters
    assert size.unit == "N" and size.determined
    assert size.value == pytest.approx(4.23, abs=4.0 * (size.std_dev or 0.0))
    assert (one.after or 1.0) < 0.1 * (one.before or 0.0)


def test_coefficients_have_units(found: dict[str, Diagnosis]) -> None:
    one = formula_of(found["damping of one half"])
    assert one is not None and one.equation.endswith("q'")
    assert [each.unit for each in one.parameters] == ["N s/m"]


def test_a_formula_is_told_with_the_command_that_adds_it(found: dict[str, Diagnosis]) -> None:
    text = "\n".join(words.lines(found["ripple"].results().plain()))
    assert "a short formula: a cos(q/0.0" in text
    assert "name it with --terms formula_of_axis.py" in text


def test_the_file_of_a_formula_is_a_term(found: dict[str, Diagnosis], tmp_path: Path) -> None:
    """Added to the model, it leaves noise."""
    one = formula_of(found["ripple"])
    assert one is not None
    path = tmp_path / "formula_of_axis.py"
    path.write_text(one.source)
    registered, folders = dict(REGISTRY), list(sys.path)
    try:
        (cls,) = load_terms(path)
        recordings = logs(tmp_path, LAWS["ripple"])
        added = model(tmp_path, *FULL).with_term(cls.model_validate({"joint": "axis"}))
        result = fit(added, recordings[:-1])
        (held_out,) = validate(result.model, recordings[-1:])
        assert float(np.max(held_out.relative_error)) < 0.05
    finally:
        REGISTRY.clear()
        REGISTRY.update(registered)
        sys.path[:] = folders
        sys.modules.pop("formula_of_axis", None)
