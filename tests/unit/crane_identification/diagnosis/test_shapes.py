"""The physics before the law: laws that no catalogue has, of one axis, by their signature.

The seeds and laws are of these tests alone; `FORCE` of the added law is a quarter of the drive's.
"""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.signal import lfilter
from unit.crane_identification.diagnosis import made
from unit.crane_identification.diagnosis.test_axis import FULL, model
from unit.crane_identification.report.html_reader import read_html
from unit.crane_identification.synthetic import axis_log

from crane_identification import Log, Options, Signal
from crane_identification.diagnosis import page, signatures, words
from crane_identification.diagnosis.candidates import candidates_of
from crane_identification.diagnosis.decision import decide
from crane_identification.diagnosis.diagnosis import Diagnosis, diagnose
from crane_identification.diagnosis.findings import Verdict
from crane_identification.diagnosis.search import Shapes
from crane_identification.diagnosis.selection import ForwardSelection
from crane_identification.report.content import Provenance
from crane_identification.thresholds import load_thresholds
from crane_model import load_model, save_model

FORCE = 3.0  # N rms of what is added
SEEDS = range(5)  # four recordings to train on, one to validate on
HALF = 0.2  # m, of the spring that gives up
FADING = 1.0  # s
KNEE = 0.08  # m/s, of the fastest 0.34

Law = Callable[[np.ndarray, np.ndarray], np.ndarray]


def spring(q: np.ndarray, v: np.ndarray) -> np.ndarray:
    """A hose that hardly resists where it is bent far: no `k q`."""
    return np.tanh(2.0 * q / HALF)


def fading(q: np.ndarray, v: np.ndarray) -> np.ndarray:
    """A hose whose force fades within a second: no effect of the catalogue."""
    step = 0.01 / FADING
    return np.tanh(10.0 * lfilter([1.0], [1.0, -(1.0 - step)], 0.01 * v))


def falling(q: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Friction that falls up to a speed: Stribeck friction, by no law of the catalogue."""
    return np.sign(v) * np.maximum(1.0 - np.abs(v) / KNEE, 0.0)


def dying(q: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Stribeck friction that is gone only beyond half of the range of speeds."""
    return np.sign(v) * np.maximum(1.0 - np.abs(v) / (2.5 * KNEE), 0.0) ** 1.7


def rising(q: np.ndarray, v: np.ndarray) -> np.ndarray:
    """A loss that begins at a speed: beside Coulomb and viscous friction bent as `falling`."""
    return np.sign(v) * np.maximum(np.abs(v) - KNEE, 0.0) ** 1.2


def turning(q: np.ndarray, v: np.ndarray) -> np.ndarray:
    """A loss that turns from none to straight where friction falls: all of its bend is there."""
    return np.sign(v) * (np.hypot(v, KNEE / 2.0) - KNEE / 2.0)


def logs(folder: Path, law: Law, force: float) -> list[Log]:
    out, size = [], 0.0
    for seed in SEEDS:
        plain = axis_log(seed, model(folder, *FULL), periods=2)
        assert plain.force is not None
        q = plain.position.value[:, 0]
        added = law(q, np.gradient(q, plain.position.time))[:, np.newaxis]
        size = size or float(np.sqrt((added**2).mean()))
        measured = plain.force.value + force / size * added
        out.append(replace(plain, force=Signal(plain.force.time, measured, "f")))
    return out


def diagnosed(folder: Path, law: Law, force: float = FORCE) -> Diagnosis:
    recordings = logs(folder, law, force)
    given = recordings[:-1], recordings[-1:], Options(), load_thresholds()
    return diagnose(model(folder, *FULL), *given)


@pytest.fixture(scope="module")
def of_a_spring(tmp_path_factory: pytest.TempPathFactory) -> Diagnosis:
    return diagnosed(tmp_path_factory.mktemp("spring"), spring)


def test_an_effect_of_another_law_is_named_by_its_signature(of_a_spring: Diagnosis) -> None:
    """Its shape, as drawn, is the drawn one, beside a constant; and the gap closes."""
    (found,) = of_a_spring.findings
    assert of_a_spring.verdict in (Verdict.NAMED, Verdict.AND_MORE)
    assert (found.candidate.type, found.candidate.drawn) == ("hose_stiffness", True)
    assert of_a_spring.gap.closed[0] > 0.95
    (entry,) = of_a_spring.results().findings
    (shape,) = entry.curves
    assert (entry.effect, shape.variable, shape.times) == ("hose_stiffness", "position", "1")
    assert (shape.variable_unit, shape.unit) == ("m", "N")
    knots, values = np.array(shape.knots), np.array(shape.values)
    drawn = spring(knots, knots)
    drawn *= np.ptp(values) / np.ptp(drawn)
    np.testing.assert_allclose(values - values[4], drawn - drawn[4], atol=0.1 * np.ptp(values))


@pytest.mark.parametrize(
    ("law", "force", "expected"),
    [
        (falling, FORCE, "stribeck"),
        (dying, 5.0 * FORCE, "stribeck"),
        (rising, FORCE, "viscous_quadratic"),
        (turning, 20.0 * FORCE, "viscous_quadratic"),  # beside Stribeck's, Coulomb's is negative
    ],
)
def test_a_loss_beyond_a_speed_is_no_stribeck_friction(
    law: Law, force: float, expected: str, tmp_path: Path
) -> None:
    result = diagnosed(tmp_path, law, force)
    (found,) = result.findings
    assert result.verdict in (Verdict.NAMED, Verdict.AND_MORE)
    assert found.candidate.type == expected and not found.judged.indistinct
    assert result.gap.closed[0] > 0.95


def test_a_drawn_law_is_in_page_terminal_and_model_file(
    of_a_spring: Diagnosis, tmp_path: Path
) -> None:
    content = of_a_spring.results().plain()
    said = "\n".join(words.lines(content))
    assert "hose stiffness, shape as drawn (axis)" in said
    assert "curve over the position [N at m]: 0 at" in said
    html = page.render(of_a_spring, Provenance.of("2012-06-01", ["diagnose"], "axis.yaml"))
    assert "The nonparametric curve" in " ".join(read_html(html).text.split())
    save_model(tmp_path / "after.yaml", of_a_spring.after)
    read = load_model(tmp_path / "after.yaml")
    record = of_a_spring.training.runs[0].record
    np.testing.assert_allclose(read.predict(record), of_a_spring.after.predict(record))
    assert read.terms[-1].type == "nonparametric_position_force"
    again = {one.type for one in candidates_of(read, of_a_spring.training)}
    assert "stribeck" in again and "hose_stiffness" not in again


def test_a_force_that_fades_is_unknown_and_says_so(tmp_path: Path) -> None:
    result = diagnosed(tmp_path, fading)
    assert result.verdict is Verdict.UNKNOWN and not result.findings
    near = result.answer.nearest
    assert near is not None
    assert "follows the position and fades within seconds explains clearly more" in near.objection
    unknown = result.results().unknown
    assert unknown is not None and unknown.joint == "axis" and not unknown.recordings
    best = unknown.signatures[0]
    assert best.signature == "a force that follows the position and fades within seconds"
    assert not best.effects and best.explained_share > 0.9 and best.better == best.asked == 4
    said = "\n".join(words.lines(result.results().plain()))
    assert (
        "What it may depend on (axis, rms" in said
        and "no effect of the catalogue depends on that" in said
    )
    html = page.render(
        result, Provenance.of("2012-06-01", ["diagnose"], "axis.yaml"), folder=Path("out")
    )
    text = " ".join(read_html(html).text.split())
    assert "fades within seconds: its best curve explains" in text
    assert "The nonparametric curve" in text  # of the nearest that is one
    command = "ros2 run crane_trajectory design --discriminate out --out out/discriminate.yaml"
    assert "The next experiment" in text and command in text
    assert words.next_step(result.results().plain(), Path("out"))[0].endswith(command)


def test_effects_pass_with_the_law_that_fits_and_take_the_name_of_the_bend(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The law where the shape bends is turned round in two of six parts of the time: with it, the
    effect would not pass, and the one beside it neither.
    """
    fits, other = made.normal(1), made.normal(2)
    turned = fits * np.where(np.arange(made.ROWS) < made.ROWS // 3, -1.0, 1.0)
    columns = {"hose_stiffness": fits, "pressure_offset": turned, "actuator_inertia": other}
    known = made.searched(columns, 3.0 * fits + 2.0 * other)
    laws = {one.candidate.type: one.candidate for one in known.projection.candidates}
    drawn = {
        laws["hose_stiffness"]: made.shaped("hose_stiffness", fits[:, np.newaxis]),
        laws["pressure_offset"]: made.shaped("pressure_offset", fits[:, np.newaxis]),
        laws["actuator_inertia"]: None,
    }
    known = replace(known, shapes=Shapes(drawn=drawn))
    bends = {"hose_stiffness": ("pressure_offset",)}
    monkeypatch.setattr(signatures, "likelier", lambda search, law, rest: bends.get(law.type, ()))
    passed = decide(ForwardSelection(known)).passed
    assert [one.shaped.candidate.type for one in passed] == ["pressure_offset", "actuator_inertia"]
    assert all((one.held_out > 0.0).all() for one in passed)
