"""The design of experiments for what is open: predictions, motions, `design --discriminate`."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import lsq_linear
from unit.crane_identification.synthetic import crane_model

from crane_model import save_model
from crane_model.cylinders import lever_arm
from crane_model.machine_files import machine_file
from crane_model.result_file import OpenMember, OpenQuestion, OpenQuestions, QuestionKind
from crane_model.terms import Term, term_from_mapping
from crane_model.terms.friction import Coulomb
from crane_trajectory import load_clearance, load_design_settings, load_trajectory, plan
from crane_trajectory.design import main
from crane_trajectory.excitation.discrimination import model_of, pairs_of
from crane_trajectory.excitation.prediction import (
    Hypothesis,
    PlannedExperiment,
    PlannedRecording,
    steady_pressures,
)
from crane_trajectory.excitation.sweeps import CourseDraws
from crane_trajectory.motion.check import trajectory_violations

MODEL = crane_model()
MACHINE = MODEL.machine
assert MACHINE is not None
NOISE, ROW_RATE = np.array([20.0, 15.0, 10.0]), 6.0
START = np.array([0.0, 0.35, -1.5, 0.4])
CLEARANCE = load_clearance(machine_file("clearance.yaml"))
EXCITATION = load_trajectory(machine_file("excitation_20s.yaml"))
LOAD_FRICTION = Hypothesis(
    term_from_mapping({"type": "load_friction", "joint": "outer_boom"}), np.array([0.02])
)
PRESLIDING = Hypothesis(
    term_from_mapping({"type": "presliding", "joint": "outer_boom", "travel": 5e-3}),
    np.array([60.0]),
)
WORN = Hypothesis(
    term_from_mapping({"type": "position_friction", "joint": "outer_boom"}), np.array([-30.0])
)


def member(hypothesis: Hypothesis, joint: str = "outer_boom", **more: float) -> OpenMember:
    term: Term = hypothesis.term
    assert term.effect is not None
    return OpenMember(
        effect=term.type,
        name=term.effect.name,
        joint=joint,
        term=term.model_dump(),
        values=hypothesis.values.tolist(),
        separation=more.get("separation"),
        discriminated_by=term.effect.discriminated_by,
    )


def question(*members: OpenMember, needed: float = 7.0) -> OpenQuestion:
    return OpenQuestion(
        kind=QuestionKind.AMBIGUOUS, members=list(members), needed=needed, needed_share=0.1
    )


def test_steady_pressures_carry_the_force_and_pass_the_flow_of_both_chambers() -> None:
    """With an orifice law at each edge, and the continuity of the piston."""
    rng = np.random.default_rng(1)
    for joint in MODEL.joints:
        limits, cylinder = MACHINE.limits[joint], MACHINE.cylinders[joint]
        q = rng.uniform(limits.position_min, limits.position_max, 50)
        v, force = rng.choice([-0.1, 0.1], 50), rng.normal(0.0, 2000.0, 50)
        p_a, p_b = steady_pressures(MACHINE, joint, q, v, force)
        arm = lever_arm(MACHINE, joint, q)
        np.testing.assert_allclose(
            arm * (cylinder.area_a * p_a - cylinder.area_b * p_b), force, rtol=1e-9, atol=1e-6
        )
        supply, tank = MACHINE.hydraulics.supply_pressure, MACHINE.hydraulics.tank_pressure
        out = arm * v > 0.0
        flow_a = np.sqrt(np.where(out, supply - p_a, p_a - tank))
        flow_b = np.sqrt(np.where(out, p_b - tank, supply - p_b))
        np.testing.assert_allclose(flow_a / cylinder.area_a, flow_b / cylinder.area_b, rtol=1e-9)


def fitted(force: np.ndarray, columns: np.ndarray, bounded: int) -> float:
    """Sum of squares that columns (n, k) leave, of which the last `bounded` are not negative."""
    scale = np.linalg.norm(columns, axis=0)
    low = np.full(columns.shape[1], -np.inf)
    low[columns.shape[1] - bounded :] = 0.0
    found = lsq_linear(columns / scale, force, (low, np.inf), method="bvls", tol=1e-14)
    return 2.0 * float(found.cost)


def test_the_separation_is_the_lead_to_be_expected() -> None:
    """Of two fits to made-up rows of the true hypothesis, with noise; 40 draws."""
    recording = PlannedRecording(EXCITATION, 1)
    experiment = PlannedExperiment(MODEL, [recording], NOISE, ROW_RATE)
    expected = experiment.separation(LOAD_FRICTION, WORN)
    base, true, alternative = (
        experiment._rows([hypothesis])
        for hypothesis in (
            MODEL.regressor(experiment._known[0]),
            LOAD_FRICTION.term.columns(experiment._known[0], MODEL.setting),
            WORN.term.columns(experiment._known[0], MODEL.setting),
        )
    )
    rng = np.random.default_rng(2)
    leads: list[list[float]] = [[], []]
    for _ in range(40):
        noise = rng.standard_normal(len(base))
        for (columns, values, rival, bounds), out in zip(
            (
                (true, LOAD_FRICTION.values, alternative, (1, 0)),
                (alternative, WORN.values, true, (0, 1)),
            ),
            leads,
            strict=True,
        ):
            force = base @ MODEL.theta + columns @ values + noise
            wrong = fitted(force, np.concatenate([base, rival], axis=1), bounds[1])
            right = fitted(force, np.concatenate([base, columns], axis=1), bounds[0])
            out.append(wrong - right)
    assert expected > 3.0
    assert min(map(np.mean, leads)) == pytest.approx(expected**2, rel=0.1)


def test_a_parameter_of_a_physical_sign_does_not_stand_in_for_the_other() -> None:
    """|tau| sgn(q') of a force of one sign is a difference of the friction of two chambers, of
    which neither can be negative."""
    seals = Hypothesis(
        term_from_mapping({"type": "seal_friction", "joint": "inner_boom"}), np.array([0.01, 0.01])
    )
    load = Hypothesis(
        term_from_mapping({"type": "load_friction", "joint": "inner_boom"}), np.array([0.02])
    )
    experiment = PlannedExperiment(MODEL, [PlannedRecording(EXCITATION, 1)], NOISE, ROW_RATE)
    assert experiment.separation(load, seals) > 0.3 * experiment.shown(load)


def test_what_the_model_has_already_shows_nothing() -> None:
    again = Hypothesis(Coulomb(joint="outer_boom"), np.array([100.0]))
    experiment = PlannedExperiment(MODEL, [PlannedRecording(EXCITATION, 1)], NOISE, ROW_RATE)
    assert experiment.shown(again) < 1e-6


def test_the_named_member_is_not_part_of_what_the_question_is_asked_beside() -> None:
    more = MODEL.with_term(LOAD_FRICTION.term)
    more = more.with_estimate(np.append(MODEL.theta, 0.02), np.zeros(21), "true values")
    asked = model_of(more, question(member(LOAD_FRICTION), member(WORN)))
    assert asked.terms == MODEL.terms
    np.testing.assert_array_equal(asked.theta, MODEL.theta)


def test_two_laws_of_one_effect_need_not_be_told_apart() -> None:
    waves = Hypothesis(
        term_from_mapping({"type": "cyclic_friction", "joint": "outer_boom", "wave": 5.0}),
        np.array([10.0, 0.0]),
    )
    three = question(member(LOAD_FRICTION), member(WORN), member(waves))
    two = question(member(WORN), member(waves))
    told = OpenQuestions(row_rate=ROW_RATE, noise={}, questions=[three, two])
    assert [(pair.question, pair.places) for pair in pairs_of(told)] == [
        (0, (0, 1)),
        (0, (0, 2)),
        (1, (0, 1)),
    ]


def test_courses_stay_within_all_limits_and_change_a_little() -> None:
    settings = load_design_settings(machine_file("design.yaml"))
    courses = CourseDraws(
        MACHINE, MODEL.joints, ("telescope",), CLEARANCE, settings.margins, period=20.0
    )
    rng = np.random.default_rng(3)
    drawn = [course for _ in range(20) if (course := courses.draw(rng)) is not None]
    assert len(drawn) > 5
    for course in drawn:
        assert trajectory_violations(MACHINE, course, CLEARANCE) == []
        assert 20.0 <= course.period < 60.0
    variations = [
        course for _ in range(10) if (course := courses.varied(drawn[0], rng)) is not None
    ]
    assert variations and all(course.joints != drawn[0].joints for course in variations)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What a diagnosis leaves that cannot tell presliding from load friction and from wear."""
    folder = tmp_path_factory.mktemp("diagnosis")
    found = MODEL.with_term(LOAD_FRICTION.term)
    save_model(
        folder / "model.yaml",
        found.with_estimate(np.append(MODEL.theta, 0.02), np.zeros(21), "true values"),
    )
    members = (
        member(LOAD_FRICTION),
        member(WORN, separation=3.0),
        member(PRESLIDING, separation=5.0),
    )
    write(folder, question(*members))
    return folder


def write(folder: Path, *questions: OpenQuestion) -> None:
    open_ = OpenQuestions(
        row_rate=ROW_RATE,
        noise=dict(zip(MODEL.joints, NOISE, strict=True)),
        questions=list(questions),
    )
    content = {"verdict": "ambiguous", "open": open_.plain()}
    (folder / "findings.json").write_text(json.dumps(content), encoding="utf-8")


def discriminated(folder: Path, out: Path) -> dict:
    assert main(["--discriminate", str(folder), "--out", str(out), "--starts", "6"]) == 0
    return json.loads(out.with_suffix(".json").read_text(encoding="utf-8"))


def test_the_motion_designed_discriminates_better_than_that_of_an_excitation(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    plan_ = discriminated(folder, tmp_path / "discriminate.yaml")
    trajectory = load_trajectory(tmp_path / "discriminate.yaml")
    assert (tmp_path / "discriminate.png").is_file()
    assert "design --discriminate" in trajectory.provenance
    plan(MACHINE, trajectory, START, plan_["periods"], CLEARANCE)  # raises if it cannot be run
    assert plan_["duration"] == pytest.approx(plan_["periods"] * trajectory.period)
    before = PlannedExperiment(MODEL, [PlannedRecording(EXCITATION, 3)], NOISE, ROW_RATE)
    usual = min(before.separation(LOAD_FRICTION, effect) for effect in (WORN, PRESLIDING))
    assert len(plan_["separations"]) == 3
    assert [separation["so_far"] for separation in plan_["separations"]] == [3.0, 5.0, None]
    assert min(separation["predicted"] for separation in plan_["separations"]) > usual
    assert all(separation["discriminated_by"] == "" for separation in plan_["separations"])
    said = capsys.readouterr().out
    assert "ambiguous: load-dependent joint friction (outer_boom)" in said
    assert f"run_excitation --periods {plan_['periods']} --enable" in said


def test_where_no_motion_discriminates_it_an_action_is_named(tmp_path: Path) -> None:
    """The offset of a transducer of the telescope is the same constant force as the asymmetry of
    its friction."""
    without = tuple(
        term for term in MODEL.terms if (term.type, term.only_joint) != ASYMMETRY
    )  # fmt: skip
    bare = replace(MODEL, terms=without, values=None, std_devs=None)
    kept = [i for i, p in enumerate(MODEL.parameters) if p.name != "df_c.telescope"]
    bare = bare.with_estimate(MODEL.theta[kept], np.zeros(len(kept)), "true values")
    save_model(tmp_path / "model.yaml", bare)
    constants = [
        Hypothesis(term_from_mapping({"type": name, "joint": "telescope"}), np.array([value]))
        for name, value in (("coulomb_asymmetry", 100.0), ("pressure_offset", 8e4))
    ]
    write(tmp_path, question(*(member(hypothesis, "telescope") for hypothesis in constants)))
    (separation,) = discriminated(tmp_path, tmp_path / "discriminate.yaml")["separations"]
    assert separation["predicted"] < 0.01
    assert separation["actions"] == []
    assert separation["discriminated_by"] == "readings of the pressure transducers at zero pressure"


ASYMMETRY = ("coulomb_asymmetry", "telescope")


def test_nothing_open_needs_no_motion(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    save_model(tmp_path / "model.yaml", MODEL)
    write(tmp_path)
    assert (
        main(["--discriminate", str(tmp_path), "--out", str(tmp_path / "discriminate.yaml")]) == 0
    )
    assert "nothing is open" in capsys.readouterr().out
    assert not (tmp_path / "discriminate.yaml").exists()


def test_what_cannot_be_predicted_is_said_and_the_rest_is_designed_for(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Nobody knows how warm the oil will be."""
    save_model(tmp_path / "model.yaml", MODEL)
    warmth = Hypothesis(
        term_from_mapping({"type": "temperature_viscosity", "joint": "outer_boom"}), np.ones(1)
    )
    write(tmp_path, question(member(warmth), member(WORN), member(LOAD_FRICTION)))
    (separation,) = discriminated(tmp_path, tmp_path / "new" / "discriminate.yaml")["separations"]
    assert {separation["first"], separation["second"]} == {
        "position-dependent Coulomb friction (outer_boom)",
        "load-dependent joint friction (outer_boom)",
    }
    said = capsys.readouterr().out
    assert said.count("no motion is sought for temperature-dependent viscosity") == 2
    assert "the same motion with cold and with warm oil" in said


@pytest.mark.parametrize(
    ("content", "said"),
    [(None, "no such file"), ({"verdict": "ambiguous"}, "key 'open'")],
)
def test_a_folder_without_questions_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], content: dict | None, said: str
) -> None:
    if content is not None:
        (tmp_path / "findings.json").write_text(json.dumps(content), encoding="utf-8")
    assert (
        main(["--discriminate", str(tmp_path), "--out", str(tmp_path / "discriminate.yaml")]) == 1
    )
    assert said in capsys.readouterr().err


def test_a_term_that_is_not_determined_is_asked_whether_it_is_there(tmp_path: Path) -> None:
    kept = [i for i, p in enumerate(MODEL.parameters) if p.name != "f_v.telescope"]
    without = [t for t in MODEL.terms if (t.type, t.only_joint) != ("viscous", "telescope")]
    bare = replace(MODEL, terms=tuple(without), values=None, std_devs=None)
    bare = bare.with_estimate(MODEL.theta[kept], np.zeros(len(kept)), "true values")
    save_model(tmp_path / "model.yaml", bare)
    viscous = Hypothesis(
        term_from_mapping({"type": "viscous", "joint": "telescope"}), np.array([150.0])
    )
    asked = question(member(viscous, "telescope")).model_copy(
        update={"kind": QuestionKind.UNDETERMINED}
    )
    write(tmp_path, asked)
    (separation,) = discriminated(tmp_path, tmp_path / "discriminate.yaml")["separations"]
    assert separation["second"] == ""
    assert separation["predicted"] > separation["needed"]
