"""Numbers on pages are those that commands have measured, and no page contradicts them."""

import math
import re
from collections.abc import Callable
from pathlib import Path

import pytest
from figures import rows as rows_of_demo
from from_code import figures
from from_code.figures import MEASURED, names_on, pages, rendered, take_over
from manual import ROOT, text
from outcome import DemoOutcome, Following, OnlineEstimate, Unplugged

from crane_benchmark.folders import read_json
from crane_benchmark.measured import NO_BREAK, MeasuredFigures, MeasuredRow, write
from crane_benchmark.scores.locked import RECORD
from crane_identification.report.summary import MotionSummary, ParameterSummary, Summary

NAMES = sorted(path.stem for path in MEASURED.glob("*.json"))


@pytest.mark.parametrize("page", pages(), ids=lambda page: page.name)
def test_tables_are_those_of_the_data(page: Path) -> None:
    assert rendered(page.read_text("utf-8")) == page.read_text("utf-8"), "run: make figures"


def test_whatever_is_measured_is_shown_with_command_date_and_commit() -> None:
    shown = {name for page in pages() for name in names_on(page.read_text("utf-8"))}
    assert {*NAMES, *figures.MADE} <= shown
    tests = {path.stem for path in (ROOT / "tests").rglob("test_*.py")}
    assert shown <= {*NAMES, *figures.MADE} | tests
    for name in NAMES:
        one = figures.figures(name)
        assert one.command and one.commit, name
        assert re.fullmatch(r"20\d\d-\d\d-\d\d( \d\d:\d\d)?", one.date), name


def measured(name: str, *values: str) -> list[float]:
    return [figures.figures(name).value(value) for value in values]


def held_out() -> float:
    joints = ("inner_boom", "outer_boom", "telescope")
    return 100.0 * max(measured("demo", *(f"held_out_{joint}" for joint in joints)))


def frictions() -> list[float]:
    joints = ("inner_boom", "outer_boom", "telescope")
    return [100.0 * one for one in measured("demo", *(f"friction_share_{j}" for j in joints))]


def of_plants(value: str) -> list[float]:
    return [
        measured(f"discrepancy_{simulator}", value)[0] for simulator in ("primary", "independent")
    ]


def cases(rate: str) -> list[float]:
    """How many of each simulator."""
    return [a * b for a, b in zip(of_plants(rate), of_plants(f"{rate}_of"), strict=True)]


AT_MOST: list[tuple[str, str, Callable[[], float]]] = [
    ("README.md", r"leaves less than ([\d.]+) % of the force", held_out),
    ("README.md", r"make demo +# (\d+) min", lambda: measured("demo", "seconds")[0] / 60.0),
    ("README.md", r"make test +# (\d+) min", lambda: measured("checks", "seconds")[0] / 60.0),
]
"""What pages promise: a page, its words with the number, and what was measured."""
ACCURACY = "docs/explanation/accuracy.md"
EQUAL: list[tuple[str, str, Callable[[], float]]] = [
    ("docs/developers/simulated_crane.md", r"Friction is (\d+) to", lambda: min(frictions())),
    ("docs/developers/simulated_crane.md", r"Friction is \d+ to (\d+) %",
     lambda: max(frictions())),
    (ACCURACY, r"of 2 % or more: named \| (\d+) %",
     lambda: 100.0 * of_plants("right_from_2_percent")[0]),
    (ACCURACY, r"of 2 % or more: named \| .*? \| (\d+) %",
     lambda: 100.0 * of_plants("right_from_2_percent")[1]),
    (ACCURACY, r"of 1 %: named \| (\d+) %",
     lambda: 100.0 * of_plants("right_at_1_percent")[0]),
    (ACCURACY, r"of 1 %: named \| .*? \| (\d+) %",
     lambda: 100.0 * of_plants("right_at_1_percent")[1]),
    (ACCURACY, r"catalogue: `unknown` \| (\d+) %",
     lambda: 100.0 * of_plants("unknown_recognised")[0]),
    (ACCURACY, r"catalogue: `unknown` \| .*? \| (\d+) %",
     lambda: 100.0 * of_plants("unknown_recognised")[1]),
    (ACCURACY, r"wrong effect named \| ([\d.]+) %",
     lambda: 100.0 * of_plants("wrong_names")[0]),
    (ACCURACY, r"wrong effect named \| .*? \| ([\d.]+) %",
     lambda: 100.0 * of_plants("wrong_names")[1]),
    (ACCURACY, r"false alarms \| (\d+) of", lambda: cases("false_alarms")[0]),
    (ACCURACY, r"false alarms \| .*? \| (\d+) of", lambda: cases("false_alarms")[1]),
    ("docs/figures.md", r"set on (\d+) cases without an effect",
     lambda: float(read_json(RECORD)["cases"])),
    ("docs/figures.md", r"Effects below ([\d.]+) %",
     lambda: 100.0 * float(read_json(RECORD)["state"]["gates"]["smallest_strength"])),
    ("docs/figures.md", r"up to\s+([\d.]+)\s+times the\s+scatter",
     lambda: float(read_json(RECORD)["state"]["gates"]["floor_factor"])),
]  # fmt: skip


def stated(page: str, words: str) -> str:
    (found,) = re.findall(words, text(page), re.MULTILINE) or [None]
    assert found, f"{page} does not say '{words}' any more: mend this test"
    return found


@pytest.mark.parametrize(("page", "words", "number"), AT_MOST)
def test_promises_are_kept_and_not_much_too_wide(
    page: str, words: str, number: Callable[[], float]
) -> None:
    promised = float(stated(page, words))
    assert 0.6 * promised <= number() <= promised


@pytest.mark.parametrize(("page", "words", "number"), EQUAL)
def test_numbers_in_sentences_are_those_that_were_measured(
    page: str, words: str, number: Callable[[], float]
) -> None:
    said = stated(page, words)
    decimals = len(said.partition(".")[2])
    assert said == f"{number():.{decimals}f}"


def test_the_readme_has_no_other_number_that_somebody_measured() -> None:
    words = text("README.md")
    for _, said, _ in AT_MOST:
        words = re.sub(said, "", words)
    assert re.findall(r"[\d.]+ ?(?:%|min\b|s\b|ms\b|σ)", words) == []


@pytest.fixture
def files(tmp_path: Path) -> tuple[Path, Path]:
    return tmp_path / "new.json", tmp_path / "old.json"


def some(*values: float) -> list[MeasuredRow]:
    return [
        MeasuredRow(cells=[f"row {i}", "", "{x}"], values={"x": x}) for i, x in enumerate(values)
    ]


def test_what_was_measured_last_is_taken_over(files: tuple[Path, Path]) -> None:
    source, target = files
    write(source, "make bench", some(1.0))
    take_over(source, target)
    write(source, "make bench", some(2.0, 3.0))
    take_over(source, target)
    assert MeasuredFigures.read(target) == MeasuredFigures.read(source)


def test_part_of_a_measurement_and_an_older_one_are_not(files: tuple[Path, Path]) -> None:
    source, target = files
    kept = write(target, "make bench", some(1.0, 2.0))
    write(source, "make bench", some(3.0))
    take_over(source, target)
    write(source, "make bench", some(3.0, 4.0)).model_copy(update={"date": "2020-01-01"}).write(
        source
    )
    take_over(source, target)
    assert MeasuredFigures.read(target) == kept


def test_figures_of_the_demo_are_those_of_its_outcome() -> None:
    joints = ("inner_boom", "telescope")
    errors = dict(zip(joints, (0.001, 0.0025), strict=True))
    way = dict.fromkeys(joints, 0.5)
    names, values = ("one", "two"), ((0.9, 0.1), (1.0, 0.1))
    motion = MotionSummary(
        horizon=0.5, windows=9, position_rms=errors, displacement_rms=way, reason=""
    )
    summary = Summary.model_construct(
        parameters=[
            ParameterSummary(name=name, unit="kg", value=value, std_dev=std_dev)
            for name, (value, std_dev) in zip(names, values, strict=True)
        ],
        simulated_motion=motion,
        heldout_relative_error=errors,
        heldout_relative_error_without_gravity=errors,
        noise_floor=errors,
        friction_share=way,
    )
    outcome = DemoOutcome(
        online=[
            OnlineEstimate(name="one", true_value=1.0, value=1.3, std_dev=0.2),
            OnlineEstimate(name="two", true_value=1.0, value=math.inf, std_dev=math.inf),
        ],
        tracking_rms={"slew": 0.001, "telescope": 0.009},
        following=Following(
            controller="flow_and_pressures",
            tracking_rms={"slew": 0.0, "telescope": 0.00012},
            times_better={"slew": None, "telescope": 75.0},
        ),
        unplugged=Unplugged(
            joint="telescope",
            named_by="driver",
            seconds_to_name=0.21,
            seconds_to_neutral=0.354,
            estimate_error=-0.0021,
            true_load=60.0,
            load=59.6,
            load_std_dev=0.4,
        ),
        recorded={},
        wall_seconds={"live": 100.0, "bags": 23.0},
    )
    units = {"slew": "rad", "telescope": "m"}
    rows = rows_of_demo("make demo", summary, summary, outcome, dict.fromkeys(names, 1.0), units)
    shown = [[cell.replace(NO_BREAK, " ") for cell in row.shown] for row in rows]
    told = {what: said for what, _, said in shown}
    assert (
        told["2 parameters, live: farthest from the true values, online and offline"]
        == "1.5 σ, 1.0 σ"
    )
    assert told["friction in τ"] == "50 %, 50 %"
    assert (
        told["simulated motion 0.5 s ahead, error relative to the displacement"] == "0.20 %, 0.50 %"
    )
    assert told["RMS tracking error, PD controller (slew, telescope)"] == "1 mrad, 9 mm"
    led = "the same by `flow_and_pressures` with the fitted model (slew, telescope)"
    assert told[led] == "0.00 mrad, 0.12 mm"
    assert told["`make demo`, after the set-up"] == "123 s"
    (lost,) = (said for what, said in told.items() if what.startswith("encoder of telescope"))
    assert lost == "0.21 s by driver; 0.35 s; -2.1 mm; 59.6 ± 0.4 kg"
    assert "0.10 %, 0.25 %" in told.values()
