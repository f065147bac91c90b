"""What terminal and page say of findings.json: complete, in units, and without contradictions."""

import json
from pathlib import Path
from typing import Any

import pytest

from crane_identification.diagnose import main
from crane_identification.diagnosis import words
from crane_identification.diagnosis.findings import Findings
from crane_identification.notation import NARROW_SPACE

PERCENT = f"{NARROW_SPACE}%"


def parameter(
    name: str, value: float, std_dev: float | None, unit: str, minimum: float | None = None
) -> dict[str, Any]:
    number = {"value": value, "std_dev": std_dev, "minimum": minimum}
    return {"name": name, "unit": unit, "determined": std_dev is not None, **number}


def finding(**more: Any) -> dict[str, Any]:
    return {
        "effect": "load_friction",
        "name": "load-dependent joint friction",
        "joint": "outer_boom",
        "ambiguity_group": [],
        "curves": [],
        "parameters": [parameter("mu_load.outer_boom", 0.039995, 8.8e-5, "1", 0.0)],
        "carried_in": {},
        "score": 7630.2,
        "threshold": 46.5,
        "runner_up": {"effect": "hose_stiffness", "name": "hose stiffness", "joint": "outer_boom"},
        "margin": 4625.9,
        "margin_needed": 76.1,
        "relative_magnitude": 0.04,
        "visible_magnitude": 0.0071,
        "discriminated_by": "the same motion with raised back-pressure",
    } | more


def side(outer: float) -> dict[str, Any]:
    noise = {
        "noise_floor": 0.0005,
        "best_achievable": 0.0012,
        "motion_error": 0.0004,
    }
    return {
        "inner_boom": {"force_relative_error": 0.0004, **noise},
        "outer_boom": {"force_relative_error": outer, **noise},
    }


def region(variable: str, low: float, high: float, unit: str) -> dict[str, Any]:
    return {"variable": variable, "range": [low, high], "unit": unit, "share": 0.53}


def place(share: float, where: dict[str, Any]) -> dict[str, Any]:
    return {"energy_share": share, "region": where}


PRESSURE = region("pressure sum of outer_boom", 20396674.4, 22380688.8, "Pa")


def content(verdict: str, *findings: dict[str, Any], **more: Any) -> dict[str, Any]:
    noise = {"learnable_share": 0.0, "systematic": False, "beyond_noise": False}
    return {
        "verdict": verdict,
        "reason": "the effects explain 100% of what can be explained",
        "values_kept": False,
        "where": {
            "inner_boom": place(0.35, region("time", 1.0, 9.0, "s")),
            "outer_boom": place(0.65, PRESSURE),
        },
        "findings": list(findings),
        "nearest": None,
        "model_error": {
            "before": side(0.0113),
            "after": side(0.0005 if findings else 0.0113),
            "closed": {"inner_boom": None, "outer_boom": 1.0 if findings else None},
            "loads": [],
        },
        "left": dict.fromkeys(("inner_boom", "outer_boom"), noise | {"region": PRESSURE}),
        "undetermined": [],
        "clock": None,
        "needs_units": [],
        "warnings": [],
        "without": [],
        "not_testable": [],
        "not_observable": [],
        "pulsations": [],
        "flow": {},
        "open": {"row_rate": 6.0, "noise": {}, "questions": []},
        "named_from": {"inner_boom": 0.002},
    } | more


def text(said: dict[str, Any]) -> str:
    Findings.model_validate(said)  # such a file can be
    return "\n".join(words.lines(said)).replace(NARROW_SPACE, " ")


def test_the_proof_comes_before_what_was_found() -> None:
    lines = text(content("named", finding())).splitlines()
    assert lines[0] == (
        "Something is missing, and these recordings show what: load-dependent joint friction "
        "(outer boom)."
    )
    assert lines[2].startswith("Held-out error of the force, before → after")
    assert (
        lines[4]
        == "  outer boom: 1.13 % → 0.05 % (0.05 %, 0.12 %), 100 % of the explainable error removed"
    )
    assert lines[5].startswith("1. load-dependent joint friction (outer boom)")


def test_strength_and_what_of_it_shows_have_names_of_their_own() -> None:
    said = text(content("named", finding()))
    assert "rms 4.0 % of the drive force; 0.71 % visible" in said


def test_a_class_is_named_by_all_of_its_members() -> None:
    members = [
        {"effect": "offset", "name": "constant force", "joint": "outer_boom"},
        {"effect": "base_tilt", "name": "base tilt", "joint": "all"},
    ]
    said = text(content("ambiguous", finding(ambiguity_group=members)))
    own = "load-dependent joint friction or constant force (outer boom)"
    names = f"{own} or base tilt (the whole machine)"
    assert said.splitlines()[0].endswith(f"which of these effects it is: {names}.")
    assert f"1. {names}" in said and "as load-dependent joint friction (outer boom): mu" in said


def test_a_lead_that_was_not_asked_for_is_not_printed_as_one() -> None:
    """A rival of more freedom needs no lead; a member of the class has none."""
    assert words.evidence(finding(margin=50.0)).endswith("which is the same with more freedom")
    rival = finding()["runner_up"]
    member = finding(margin=0.0, ambiguity_group=[rival])
    assert words.evidence(member).endswith("0 ahead of hose stiffness (outer boom), 76 required")


@pytest.mark.parametrize("verdict", ["none", "insufficient_data"])
def test_noise_sits_nowhere(verdict: str) -> None:
    said = text(content(verdict))
    assert "disagrees" not in said and "unexplained" not in said
    assert "before → after" not in said


def test_regions_have_units_that_people_read() -> None:
    said = text(content("unknown"))
    assert "53 % of it with the pressure sum of the outer boom from 204 to 224 bar" in said
    assert "with the time from 1.0 to 9.0 s" in said
    assert "outer_boom" not in said


@pytest.mark.parametrize(
    ("one", "expected"),
    [
        (parameter("f.axis", 98.9, 92.5, "N", 0.0), "f.axis = not determined, at most 284 N"),
        (parameter("f.axis", -5.8e-11, 0.3, "N", 0.0), "f.axis = at its bound 0 ± 0.30 N"),
        (parameter("f.axis", 98.9, 1.5, "N", 0.0), "f.axis = 98.9 ± 1.5 N"),
        (parameter("dp.axis", 12345.0, 120.0, "Pa"), "dp.axis = 0.1235 ± 0.0012 bar"),
        (parameter("mu.axis", 0.04, None, "1"), "mu.axis = 0.04000"),
        ({"name": "mu", "value": 1.0, "std_dev": 0.1, "unit": "1"}, "mu = 1.00 ± 0.10"),
    ],
)
def test_parameters_that_are_not_determined_are_no_numbers(one: dict, expected: str) -> None:
    assert str(words.estimate(one)) == expected


NEAREST = {
    "effects": [
        {
            "effect": "backlash",
            "name": "backlash",
            "joint": "outer_boom",
            "score": 13224.0,
            "threshold": 54.0,
        }
    ],
    "explained_share": 0.43,
    "model_error": {
        "inner_boom": {"before": 0.0004, "after": 0.0004},
        "outer_boom": {"before": 0.0113, "after": 0.009},
    },
    "objection": "it removes 39% of the error on outer_boom",
}


def test_unknown_says_what_is_nearest_and_why_that_does_not_do() -> None:
    said = text(content("unknown", nearest=NEAREST))
    assert "backlash (outer boom): score 13224, threshold 54" in said
    assert "explains 43 %" in said and "of the outer boom 1.13 % → 0.90 %" in said
    assert "not named, because it removes 39 % of the error on outer boom" in said


def test_what_is_left_beside_names_is_said() -> None:
    left = {"learnable_share": 0.3, "systematic": True}
    left |= {"beyond_noise": True, "region": PRESSURE}
    said = text(content("named_and_more", finding(), left={"outer_boom": left}))
    assert (
        "Remaining: a systematic residual on the outer boom (30 % of the energy there, "
        "most with the pressure sum of the outer boom from 204 to 224 bar)." in said
    )


def test_nothing_is_left_out_without_a_word() -> None:
    nine = [finding(joint=f"joint_{i}") for i in range(9)]
    why = {"reason": "a parameter does the same"}
    hidden = {"effect": "offset", "name": "constant force", "joint": "outer_boom", **why}
    known = {"unexplained_share": 0.01, "known_time": 59.0, "recorded_time": 60.0}
    flow = {"outer_boom": {"quantities": {}, **known}}
    said = text(content("named", *nine, not_testable=[hidden, hidden], flow=flow))
    assert "9. load-dependent" in said
    assert (
        "Not printed: errors of the simulated motion, effects that the parameters of the model "
        "absorb (2), joints with a flow balance (1); see report.html" in said
    )


def test_what_exceeds_the_scatter_between_periods_is_not_called_noise() -> None:
    """The reason of the verdict, though no learner finds its law."""
    left = {
        "learnable_share": 0.0,
        "systematic": False,
        "region": None,
    }
    joints = {
        "inner_boom": left | {"beyond_noise": False},
        "outer_boom": left | {"beyond_noise": True},
    }
    assert "Remaining: more than noise on the outer boom." in text(content("unknown", left=joints))


def test_a_load_of_one_recording_says_where_it_is_carried() -> None:
    """It competes with no effect, so that it has no strength."""
    load = finding(
        name="payload change",
        joint="all",
        parameters=[parameter("m_payload", 6.617, 0.005, "kg")],
        carried_in={"m_payload": ["held_out"], "none": ["train_0", "train_1"]},
        runner_up=None,
        relative_magnitude=None,
        visible_magnitude=None,
    )
    said = text(content("named", load))
    assert "1. payload change (the whole machine)\n   m_payload = 6.6170 ± 0.0050 kg\n" in said
    assert "m_payload in held_out" in said
    assert "no load, from which masses count, in train_0 and train_1" in said


def test_explain_tells_what_is_doubtful_of_the_recordings(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    told = content("none", suspicions=["bag: pressures look like kPa"], warnings=["bag: mended."])
    (tmp_path / "findings.json").write_text(json.dumps(told), encoding="utf-8")
    assert main(["--explain", str(tmp_path)]) == 0
    out, err = capsys.readouterr()
    assert err == "warning: bag: pressures look like kPa\nwarning: bag: mended.\n"
    assert out.startswith("Nothing is missing that these recordings could show.\n")


def test_names_of_parameters_are_not_spoken() -> None:
    joints = ("outer_boom",)
    assert words.said("f_v.outer_boom on outer_boom, 3%", joints) == (
        f"f_v.outer_boom on outer boom, 3{PERCENT}"
    )
