"""Fits of six-axis robots: every body can exist, and held-out recordings are predicted as well.

The robots have the dimensions of well-known ones and bodies of their own. Whether bodies exist is
asked of another program, which seeks the pseudo-inertias with the largest smallest eigenvalue.
"""

from pathlib import Path
from typing import NamedTuple

import cvxpy
import numpy as np
import pytest
import yaml

from crane_identification import Estimator, FitResult, Log, Options, Signal, fit, validate
from crane_identification.estimation.prior import Prior, load_prior
from crane_model import ConfigurationError, Model, Record, load_model

JOINTS = tuple(f"axis_{k}" for k in range(1, 7))
LEAST_SQUARES = Options(average=False, estimator=Estimator.LEAST_SQUARES)
CONSISTENT = Options(average=False, estimator=Estimator.CONSISTENT)
LIMITS = {"position_min": -3.0, "position_max": 3.0, "velocity_min": -2.0, "velocity_max": 2.0}


class Robot(NamedTuple):
    """d, a, alpha of its rows, masses [kg], and the noise of its torques [N m]."""

    dh: list[tuple[float, float, str]]
    masses: list[float]
    noise: list[float]
    rotors: tuple[int, ...] = ()
    couplings: tuple[dict, ...] = ()

    @property
    def rotor(self) -> float:
        """Inertia of each [kg m2]."""
        return 1e-5 * self.masses[0]

    @property
    def size(self) -> float:
        """Mean length of a link [m]."""
        return float(np.mean([np.hypot(d, a) for d, a, _ in self.dh]))


UR = Robot(
    [(0.13, 0.0, "pi/2"), (0.0, -0.61, "0"), (0.0, -0.57, "0")]
    + [(0.16, 0.0, "pi/2"), (0.12, 0.0, "-pi/2"), (0.09, 0.0, "0")],
    [7.4, 13.0, 4.2, 2.0, 2.0, 0.4],
    [1.5, 1.5, 1.0, 0.3, 0.3, 0.3],
)
TX = Robot(
    [(0.0, 0.0, "-pi/2"), (0.035, 0.225, "0"), (0.0, 0.0, "pi/2")]
    + [(0.225, 0.0, "-pi/2"), (0.0, 0.0, "pi/2"), (0.065, 0.0, "0")],
    [8.0, 5.0, 3.5, 1.5, 0.8, 0.2],
    [1.0, 1.0, 0.6, 0.3, 0.3, 0.15],
    (3, 4, 5, 6),
    ({"joints": ["axis_5", "axis_6"], "matrix": [[1.0, 0.0], [1.0, 1.0]]},),
)
KUKA = Robot(
    [(-0.675, 0.350, "pi/2"), (-0.189, 1.150, "0"), (0.189, 0.041, "-pi/2")]
    + [(-1.0, 0.0, "pi/2"), (0.0, 0.0, "-pi/2"), (-0.24, 0.0, "pi")],
    [350.0, 250.0, 200.0, 60.0, 30.0, 150.0],
    [80.0, 80.0, 60.0, 15.0, 15.0, 10.0],
    (3, 4, 5, 6),
)
ROBOTS = {"UR10-like": UR, "TX40-like": TX, "KUKA-like": KUKA}


def model_of(folder: Path, robot: Robot, zero: tuple[str, ...] = ()) -> Model:
    """Bodies, rotors and friction of a robot."""
    drive = {"type": "electric_drive", "gear_ratio": 100.0, "rotor_inertia": robot.rotor}
    joints = [
        {
            "name": name,
            "kind": "revolute",
            "dh": {"d": d, "a": a, "alpha": alpha},
            "limits": LIMITS,
            "actuator": drive,
        }
        for name, (d, a, alpha) in zip(JOINTS, robot.dh, strict=True)
    ]
    machine = {"name": "robot", "gravity": 9.81, "joints": joints}
    write(folder / "machine.yaml", machine | {"couplings": list(robot.couplings)})
    terms = [{"type": "serial_rigid_body", "zero": list(zero)}]
    terms += [{"type": "rotor_inertia", "joint": f"axis_{k}"} for k in robot.rotors]
    terms += [{"type": kind, "joint": j} for kind in ("coulomb", "viscous") for j in JOINTS]
    units = dict.fromkeys(JOINTS, "rad")
    model = {"name": "robot", "machine": "machine.yaml", "joints": units, "terms": terms}
    return load_model(write(folder / "model.yaml", model))


def write(path: Path, content: dict) -> Path:
    path.write_text(yaml.safe_dump(content))
    return path


class Body(NamedTuple):
    """Mass, centre of mass and inertia about it, in the frame of its link."""

    mass: float
    centre: np.ndarray
    inertia: np.ndarray

    @property
    def ten(self) -> np.ndarray:
        """The ten parameters about the frame of its link."""
        c = self.centre
        about = self.inertia + self.mass * (c @ c * np.eye(3) - np.outer(c, c))
        return np.array(
            [self.mass, *(self.mass * c), *about[[0, 0, 1, 0, 1, 2], [0, 1, 1, 2, 2, 2]]]
        )


def bodies(robot: Robot) -> list[Body]:
    """Rods in any direction."""
    made = np.random.default_rng(0)
    out = []
    for mass, (d, a, _) in zip(robot.masses, robot.dh, strict=True):
        length = max(abs(a), abs(d), 0.08)
        moments = mass * length**2 * np.array([0.01, 0.02, 0.09]) * made.uniform(0.7, 1.3, 3)
        turn = np.linalg.qr(made.standard_normal((3, 3)))[0]
        second = turn @ np.diag(moments) @ turn.T
        centre = 0.3 * length * made.standard_normal(3)
        out.append(Body(mass, centre, np.trace(second) * np.eye(3) - second))
    return out


def truth(model: Model, robot: Robot) -> np.ndarray:
    values = np.zeros(len(model.parameters))
    term = model.terms[0]
    values[model.part(term)] = term.of_bodies(model.setting) @ ten_of_all(robot)
    for k, (name, *_) in enumerate(model.parameters):
        if name.startswith("I_rotor"):
            values[k] = robot.rotor
        if name.startswith("f_"):
            values[k] = 3.0 * robot.noise[JOINTS.index(name.partition(".")[2])]
    return values


def ten_of_all(robot: Robot) -> np.ndarray:
    return np.concatenate([body.ten for body in bodies(robot)])


def log(
    model: Model, robot: Robot, seed: int, more: np.ndarray | float = 0.0, noise: float = 1.0
) -> Log:
    """Ten seconds of five harmonics with noisy torques; inertias `more` act on single axes."""
    made = np.random.default_rng(seed)
    time = np.arange(0.0, 10.0, 0.005)
    omega = 2 * np.pi / 10.0 * np.arange(1, 6)
    phase, size = made.uniform(0, 2 * np.pi, (6, 5)), made.uniform(0.05, 0.3, (6, 5))
    angle = time[:, None, None] * omega + phase
    q = made.uniform(-0.5, 0.5, 6) + (size * np.sin(angle)).sum(axis=2)
    v = (size * omega * np.cos(angle)).sum(axis=2)
    a = -(size * omega**2 * np.sin(angle)).sum(axis=2)
    force = model.regressor(Record(JOINTS, time, q, v, a)) @ truth(model, robot) + more * a
    force += noise * np.array(robot.noise) * made.standard_normal(force.shape)
    place, torque = (Signal(time, values, "made") for values in (q, force))
    return Log(f"recording {seed}", JOINTS, 0, place, force=torque)


def smallest_eigenvalue(model: Model, values: np.ndarray, robot: Robot) -> float:
    """Of the pseudo-inertias of the best bodies that have these parameters, of 1 kg and a link."""
    base = model.terms[0].of_bodies(model.setting)
    least, scale = cvxpy.Variable(), np.diag([robot.size, robot.size, robot.size, 1.0])
    listed, constraints = [], []
    for _ in JOINTS:
        X = cvxpy.Variable((4, 4), symmetric=True)
        P = scale @ X @ scale
        listed += [P[3, 3], P[0, 3], P[1, 3], P[2, 3], P[1, 1] + P[2, 2], -P[0, 1]]
        listed += [P[0, 0] + P[2, 2], -P[0, 2], -P[1, 2], P[0, 0] + P[1, 1]]
        constraints += [X >> least * np.eye(4), cvxpy.trace(X) <= 1e5]
    weight = 1.0 / np.abs(base).max(axis=1) / robot.size**2
    ours = weight * values[model.part(model.terms[0])]
    constraints.append(cvxpy.multiply(weight, base @ cvxpy.hstack(listed)) == ours)
    problem = cvxpy.Problem(cvxpy.Maximize(least), constraints)
    problem.solve(solver=cvxpy.CLARABEL)
    return float(problem.value)


def held_out(result: FitResult, log: Log) -> float:
    (validation,) = validate(result.model, [log], CONSISTENT)
    return float(
        np.linalg.norm(validation.measured - validation.predicted)
        / np.linalg.norm(validation.measured)
    )


@pytest.mark.parametrize("name", ROBOTS)
def test_every_body_can_exist_and_the_model_predicts_as_well(tmp_path: Path, name: str) -> None:
    robot = ROBOTS[name]
    model = model_of(tmp_path, robot)
    train, *validation = (log(model, robot, seed) for seed in range(3))
    free, physical = (fit(model, [train], options) for options in (LEAST_SQUARES, CONSISTENT))
    assert smallest_eigenvalue(model, truth(model, robot), robot) > 1e-3
    assert smallest_eigenvalue(model, free.estimate.values, robot) < -0.1
    assert smallest_eigenvalue(model, physical.estimate.values, robot) > 1e-7
    assert "pseudo-inertia of axis_6" in physical.estimate.bounds
    for recording in validation:
        assert held_out(physical, recording) < 1.05 * held_out(free, recording)


@pytest.mark.parametrize("noise", [0.0, 0.01])
def test_where_all_bodies_can_exist_the_fit_is_least_squares(tmp_path: Path, noise: float) -> None:
    model = model_of(tmp_path, UR)
    logs = [log(model, UR, seed, noise=noise) for seed in range(3)]
    free, physical = (fit(model, logs, options).estimate for options in (LEAST_SQUARES, CONSISTENT))
    assert smallest_eigenvalue(model, free.values, UR) > 1e-4
    assert physical.bounds == ()
    assert (np.abs(physical.values - free.values) < 0.01 * free.std_devs).all()
    np.testing.assert_array_equal(physical.std_devs, free.std_devs)


def test_a_rotor_that_the_model_lacks_counts_with_the_bodies(tmp_path: Path) -> None:
    """No motion tells the rotor of axis 2 from its link, and no link could have so much inertia."""
    model = model_of(tmp_path, UR)
    rotor = np.array([0.0, 30.0, 0.0, 0.0, 0.0, 0.0])
    train, validation = (log(model, UR, seed, rotor) for seed in (0, 1))
    free, physical = (fit(model, [train], options) for options in (LEAST_SQUARES, CONSISTENT))
    assert smallest_eigenvalue(model, physical.estimate.values, UR) < 0.0
    assert held_out(physical, validation) < 1.05 * held_out(free, validation)


def test_moments_that_a_model_takes_to_be_zero_are_zero_in_every_body(tmp_path: Path) -> None:
    zero = ("mx.axis_6", "my.axis_6", "Iyy.axis_1")  # the last at the edge of what there can be
    model = model_of(tmp_path, UR, zero)
    found = fit(model, [log(model, UR, 0)], CONSISTENT).estimate
    assert np.isfinite(found.values).all()
    assert found.values[found.names.index("Izz.axis_6")] > 0.0


def known(folder: Path, model: Model, std_dev: float, measure: str, factor: float = 1.0) -> Prior:
    """A prior of the true bodies, with masses and inertias times `factor`."""
    listed = {}
    for joint, body in zip(model.machine.joints, bodies(UR), strict=True):
        turn = joint.after[:3, :3]  # it counts from the far end of the link
        inertia = factor * turn.T @ body.inertia @ turn
        listed[joint.name] = {
            "mass": factor * body.mass,
            "centre_of_mass": (turn.T @ (body.centre - joint.after[:3, 3])).tolist(),
            "inertia": np.diag(inertia).tolist(),
            "products": inertia[[0, 0, 1], [1, 2, 2]].tolist(),
            "relative_std_dev": std_dev,
        }
    content = {"bodies": listed, "measure": measure}
    return load_prior(write(folder / "prior.yaml", content), model)


def test_a_log_det_prior_makes_up_for_what_the_recordings_lack(tmp_path: Path) -> None:
    model = model_of(tmp_path, UR)
    train, validation = (log(model, UR, seed) for seed in (0, 1))
    free = fit(model, [train], CONSISTENT)
    prior = known(tmp_path, model, 0.3, "log_det", factor=1.2)
    found = fit(model, [train], CONSISTENT, prior=prior)
    assert found.estimate.method.startswith("physically consistent least squares with a log-det")
    assert smallest_eigenvalue(model, found.estimate.values, UR) > 1e-4
    assert held_out(found, validation) < held_out(free, validation)
    part = model.part(model.terms[0])
    assert np.median((found.estimate.std_devs / free.estimate.std_devs)[part]) < 0.8
    wrong = np.abs(found.estimate.values - truth(model, UR))
    assert np.mean((wrong / found.estimate.std_devs)[part] < 2.0) > 0.8


@pytest.mark.parametrize("std_dev", [1e-6, 1e2])
def test_a_log_det_prior_that_is_sure_or_vague(tmp_path: Path, std_dev: float) -> None:
    """The known bodies, or nearly the data alone."""
    model = model_of(tmp_path, UR)
    train = log(model, UR, 0)
    part = model.part(model.terms[0])
    prior = known(tmp_path, model, std_dev, "log_det", factor=1.2)
    found = fit(model, [train], CONSISTENT, prior=prior).estimate
    alone = fit(model, [train], CONSISTENT).estimate
    sure = model.terms[0].of_bodies(model.setting) @ (1.2 * ten_of_all(UR))
    expected = sure if std_dev < 1.0 else alone.values[part]
    assert (np.abs(found.values[part] - expected) < 0.05 * alone.std_devs[part]).all()


def test_where_both_are_narrow_a_log_det_prior_is_the_gaussian_of_its_curvature(
    tmp_path: Path,
) -> None:
    """One tensor, by hand: tr((P⁻¹ δP)²) of a mass alone is (δm / m)²."""
    model = model_of(tmp_path, UR)
    prior = known(tmp_path, model, 0.01, "log_det")
    term = model.terms[0]
    step = np.zeros(60)
    body = bodies(UR)[5]
    step[50:] = body._replace(mass=1.01 * body.mass).ten - body.ten  # a point at the centre of mass
    shift = np.zeros(len(model.parameters))
    shift[model.part(term)] = term.of_bodies(model.setting) @ step
    assert np.linalg.norm(prior.matrix @ shift) <= 1.0 + 1e-9
    np.testing.assert_allclose(prior.matrix @ truth(model, UR), prior.values, rtol=1e-6, atol=1e-6)


def test_where_a_log_det_prior_does_not_go(tmp_path: Path) -> None:
    model = model_of(tmp_path, UR)
    prior = known(tmp_path, model, 0.1, "log_det")
    with pytest.raises(ConfigurationError, match="estimator least_squares: takes no prior by the"):
        fit(model, [log(model, UR, 0)], LEAST_SQUARES, prior=prior)
    flat = {"mass": 1.0, "centre_of_mass": [0.0, 0.0, 0.0], "inertia": [1.0, 1.0, 2.0]}
    listed = {name: flat | {"relative_std_dev": 0.1} for name in JOINTS}
    path = write(tmp_path / "prior.yaml", {"bodies": listed, "measure": "log_det"})
    with pytest.raises(ConfigurationError, match="axis_1, .*: measure log_det needs bodies with"):
        load_prior(path, model)
    path.write_text(path.read_text().replace("log_det", "gaussian"))
    assert load_prior(path, model).bodies is None
