"""What is known beforehand counts as much as its standard deviation says, and no more."""

from pathlib import Path

import numpy as np
import pytest
from unit.crane_identification.synthetic import crane_log, crane_model

from crane_identification import Estimator, Log, Options, Signal, fit
from crane_identification.estimation.prior import KnownBody, load_prior
from crane_identification.report.findings import findings
from crane_model import ConfigurationError, Model, Record, load_machine
from crane_model.terms import Setting
from crane_model.terms.friction import Coulomb, Viscous
from crane_model.terms.gravity_and_load import planar_machine
from crane_model.terms.rigid_body import PlanarRigidBody, SerialRigidBody
from crane_model.terms.single_axis import Inertia, Offset

AXIS = Model("axis", Setting({"axis": "m"}, None), (Inertia(joint="axis"), Viscous(joint="axis")))
PLAIN = Options(average=False, estimator=Estimator.LEAST_SQUARES)


def log(noise: float, seed: int = 0) -> Log:
    """3 kg on 2 N s/m, whose force is noisy [N]."""
    time = np.linspace(0.0, 20.0, 2001)
    force = 2.0 * np.cos(time) - 3.0 * np.sin(time)
    force = force + noise * np.random.default_rng(seed).standard_normal(len(time))
    place = Signal(time, np.sin(time)[:, np.newaxis], "made")
    return Log("made", ("axis",), 0, place, force=Signal(time, force[:, np.newaxis], "made"))


def prior(tmp_path: Path, text: str, model: Model = AXIS):
    path = tmp_path / "prior.yaml"
    path.write_text(text)
    return load_prior(path, model)


def test_between_data_and_prior_by_their_variances(tmp_path: Path) -> None:
    data = fit(AXIS, [log(1.0)], PLAIN).estimate
    std_dev = data.std_devs[0]
    mean = data.values[0] + 2.0 * std_dev
    known = prior(tmp_path, f"parameters: {{inertia.axis: {{value: {mean}, std_dev: {std_dev}}}}}")
    both = fit(AXIS, [log(1.0)], PLAIN, prior=known).estimate
    assert both.values[0] == pytest.approx(data.values[0] + std_dev, abs=0.1 * std_dev)
    assert both.std_devs[0] == pytest.approx(std_dev / np.sqrt(2.0), rel=0.1)
    assert both.values[1] == pytest.approx(data.values[1], abs=data.std_devs[1])


def test_entries_that_recordings_contradict(tmp_path: Path) -> None:
    """Each in standard deviations of both, judged beside entries that agree; and what changes."""
    text = (
        "parameters: {inertia.axis: {value: 4, std_dev: 0.01}, f_v.axis: {value: 2.1, std_dev: 1}}"
    )
    alone = fit(AXIS, [log(1.0)], PLAIN).estimate
    result = fit(AXIS, [log(1.0)], PLAIN, prior=prior(tmp_path, text))
    assert result.conflict is not None
    (found,) = result.conflict.contradictions
    assert (found.entry, found.freedom) == ("inertia.axis", 1)
    both = np.hypot(0.01, alone.std_devs[0])
    assert found.sigmas == pytest.approx((4.0 - alone.values[0]) / both, rel=0.02)
    change = found.changes[0]
    assert change.parameter == "inertia.axis"
    assert change.with_entry == pytest.approx(result.estimate.values[0])
    assert change.without == pytest.approx(alone.values[0], abs=0.1 * alone.std_devs[0])
    assert change.std_dev == pytest.approx(alone.std_devs[0], rel=0.1)
    told = findings(result, [log(1.0)])[0]
    assert told.startswith("The recordings contradict the prior of inertia.axis (4 ± 0.01 kg) by ")
    assert f"inertia.axis {change.without:.3f} ± " in told


def test_two_wrong_entries_do_not_hide_each_other(tmp_path: Path) -> None:
    """Both are of one combination, that of weight: either alone explains the other."""
    model = Model("axis", AXIS.setting, (*AXIS.terms, Offset(joint="axis"), Coulomb(joint="axis")))
    text = (
        "parameters: {offset.axis: {value: 5, std_dev: 0.1}, f_c.axis: {value: 3, std_dev: 0.1}, "
        "f_v.axis: {value: 2, std_dev: 0.5}}"
    )
    result = fit(model, [log(1.0)], PLAIN, prior=prior(tmp_path, text, model))
    found = result.conflict
    assert found is not None
    assert {contradiction.entry for contradiction in found.contradictions} == {
        "offset.axis",
        "f_c.axis",
    }
    assert all(contradiction.sigmas > 20.0 for contradiction in found.contradictions)
    without = {change.parameter: change.without for change in found.changes}
    assert without["offset.axis"] == pytest.approx(0.0, abs=0.2)
    assert "Without these 2 priors: " in findings(result, [log(1.0)])[2]


def test_a_wrong_entry_that_the_recordings_outweigh_is_said_to_move_nothing(tmp_path: Path) -> None:
    alone = fit(AXIS, [log(1.0)], PLAIN).estimate
    std_dev = 20.0 * alone.std_devs[0]
    text = f"{{inertia.axis: {{value: {alone.values[0] + 15 * std_dev}, std_dev: {std_dev}}}}}"
    result = fit(AXIS, [log(1.0)], PLAIN, prior=prior(tmp_path, f"parameters: {text}"))
    assert (
        "Without it: no parameter moves by more than 2.00 σ, as the recordings or other priors "
        "determine them" in findings(result, [log(1.0)])[0]
    )


def test_what_recordings_do_not_show_contradicts_nothing(tmp_path: Path) -> None:
    """Of offset and Coulomb friction of a joint that moves one way, only the sum is seen."""
    time = np.linspace(0.0, 20.0, 2001)
    course = 2.0 * time + np.sin(time)
    force = 3.0 * -np.sin(time) + 5.0 + np.random.default_rng(1).standard_normal(len(time))
    place = Signal(time, course[:, np.newaxis], "made")
    one_way = Log("made", ("axis",), 0, place, force=Signal(time, force[:, np.newaxis], "made"))
    terms = (Inertia(joint="axis"), Offset(joint="axis"), Coulomb(joint="axis"))
    model = Model("axis", AXIS.setting, terms)
    text = "parameters: {f_c.axis: {value: 40, std_dev: 1}}"
    result = fit(model, [one_way], PLAIN, prior=prior(tmp_path, text, model))
    assert result.conflict is not None
    assert not result.conflict.contradictions
    assert result.estimate.values[1] == pytest.approx(-35.0, abs=0.5)


def test_a_body_that_recordings_contradict(tmp_path: Path) -> None:
    """The telescope of a crane, five times too heavy; the other bodies are right."""
    model = crane_model()
    assert model.machine is not None
    bodies = {
        "slew": (200.0, [0.0, 0.0, 0.0], [5.0, 5.0, 5.0]),
        "inner_boom": (110.0, [-0.6, 0.1, 0.0], [2.0, 20.0, 20.0]),
        "outer_boom": (90.0, [-0.2, 0.2, 0.0], [2.0, 15.0, 15.0]),
        "telescope": (60.0, [0.0, 0.0, -0.5], [10.0, 10.0, 1.0]),
    }
    ten = [
        KnownBody(mass=m, centre_of_mass=c, inertia=i, relative_std_dev=0.05).ten(joint.after)[0]
        for joint in model.machine.joints
        for m, c, i in [bodies[joint.name]]
    ]
    term = next(term for term in model.terms if term.has_base_parameters)
    theta = model.theta.copy()
    theta[model.part(term)] = term.of_bodies(model.setting) @ np.concatenate(ten)
    true = model.with_estimate(theta, np.zeros(len(theta)), "true")
    recording = crane_log(seed=1, model=true)

    def contradicted(mass: float) -> list[str]:
        given = {**bodies, "telescope": (mass, *bodies["telescope"][1:])}
        lines = [
            f"  {name}: {{mass: {m}, centre_of_mass: {c}, inertia: {i}, relative_std_dev: 0.05}}"
            for name, (m, c, i) in given.items()
        ]
        known = prior(tmp_path, "\n".join(["bodies:", *lines]), model)
        result = fit(model, [recording], Options(estimator=Estimator.LEAST_SQUARES), prior=known)
        assert result.conflict is not None
        return [contradiction.entry for contradiction in result.conflict.contradictions]

    assert contradicted(60.0) == []
    assert contradicted(300.0) == ["body telescope"]


@pytest.mark.parametrize(("std_dev", "value"), [(1e-6, 4.0), (1e6, 3.0)])
def test_sure_or_vague(tmp_path: Path, std_dev: float, value: float) -> None:
    known = prior(tmp_path, f"parameters: {{inertia.axis: {{value: 4, std_dev: {std_dev}}}}}")
    for estimator in (Estimator.LEAST_SQUARES, Estimator.CONSISTENT):
        options = Options(average=False, estimator=estimator)
        found = fit(AXIS, [log(0.01)], options, prior=known).estimate
        assert found.values[0] == pytest.approx(value, abs=0.01)
        assert "with a prior" in found.method


def test_bodies_in_space_and_in_the_plane_agree() -> None:
    """Of a crane with random bodies, by both terms: the same force, at any motion."""
    machine = load_machine()
    joints = machine.as_planar().joints
    setting = Setting({joint: machine.units[joint] for joint in joints}, machine)
    plane, space = PlanarRigidBody(), SerialRigidBody(zero=(f"mx.{joints[-1]}",))
    assert planar_machine(plane, setting) is machine
    made = np.random.default_rng(0)
    ten = made.standard_normal((len(machine.joints), 10))
    ten[-1, 1] = 0.0  # the telescope's centre of mass lies on its axis, as the planar term has it
    record = Record(joints, np.arange(50.0), *made.standard_normal((3, 50, len(joints))))
    by_plane, by_space = (
        term.columns(record, setting) @ term.of_bodies(setting) @ ten.ravel()
        for term in (plane, space)
    )
    np.testing.assert_allclose(by_space, by_plane, atol=1e-9 * np.abs(by_plane).max())


def test_a_body_is_brought_into_its_joint() -> None:
    """By the parallel axes: a ball of 2 kg, 3 m out along x of its link, which is 1 m up."""
    body = KnownBody(
        mass=2.0, centre_of_mass=(3.0, 0.0, 0.0), inertia=(0.8, 0.8, 0.8), relative_std_dev=0.1
    )
    frame = np.eye(4)
    frame[2, 3] = 1.0
    values, spread = body.ten(frame)
    np.testing.assert_allclose(values, [2, 6, 0, 2, 2.8, 0, 20.8, -6, 0, 18.8])
    assert spread[0] == pytest.approx(0.2)
    assert spread[4] == pytest.approx(0.1 * 0.5 * (2.8 + 20.8 + 18.8))


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        (
            "parameters: {mass: {value: 1, std_dev: 1}}",
            "has no 'mass'; it has inertia.axis",
        ),
        ("parameters: {inertia.axis: {value: 1, std_dev: 0}}", "std_dev"),
        ("{}", "neither parameters nor bodies are known"),
        (
            "bodies: {axis: {mass: 1, centre_of_mass: [0, 0, 0], inertia: [1, 1, 3], "
            "relative_std_dev: 1}}",
            "no distribution of mass has these",
        ),
        (
            "bodies: {axis: {mass: 1, centre_of_mass: [0, 0, 0], inertia: [1, 1, 1], "
            "relative_std_dev: 1}}",
            "model 'axis' has no machine",
        ),
    ],
)
def test_what_is_wrong_is_named(tmp_path: Path, text: str, reason: str) -> None:
    with pytest.raises(ConfigurationError, match=reason):
        prior(tmp_path, text)


def test_estimators_that_take_none(tmp_path: Path) -> None:
    known = prior(tmp_path, "parameters: {inertia.axis: {value: 4, std_dev: 1}}")
    with pytest.raises(ConfigurationError, match="takes no prior; choose consistent or"):
        fit(AXIS, [log(0.1)], Options(average=False, estimator=Estimator.ROBUST), prior=known)
