"""Terms of the user's own on a robot whose wrist has two motors that turn with both axes."""

import json
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from unit.crane_identification.synthetic import PERIOD, motion

from crane_identification.diagnose import main
from crane_model.terms import REGISTRY

JOINTS = ("base", "pitch", "roll")
TERMS = '''
from typing import ClassVar, Literal
import numpy as np
from crane_model.terms import Effect, Family, JointTerm, Parameter, Term

class MotorFriction(Term):
    """f sgn(s) + v s on both axes of the wrist, s the sum of their speeds."""

    type: Literal["motor_friction"] = "motor_friction"
    family: ClassVar[Family] = "friction"
    of_one_instant: ClassVar[bool] = True
    effect: ClassVar[Effect] = Effect(
        "friction of the wrist motor", "steps with the sum of both speeds", (), "single axes"
    )

    def parameters(self, setting):
        return (
            Parameter("f_motor", "N m", 0.0, "Coulomb friction of the motor"),
            Parameter("v_motor", "N m s/rad", 0.0, "viscous friction of the motor"),
        )

    def fill(self, record, setting, columns):
        pitch, roll = record.column("pitch"), record.column("roll")
        speed = record.velocity[:, pitch] + record.velocity[:, roll]
        for j in (pitch, roll):
            columns[:, j, 0], columns[:, j, 1] = np.sign(speed), speed

class Hardening(JointTerm):
    """c q^3, which this robot does not have."""

    type: Literal["hardening"] = "hardening"
    family: ClassVar[Family] = "elasticity"
    effect: ClassVar[Effect] = Effect("hardening spring", "force at the ends", (), "slow strokes")

    def column(self, record, j):
        return record.position[:, j] ** 3

    def parameter(self, coordinate, force):
        return Parameter("c", f"{force}/{coordinate}3", 0.0, "stiffness")
'''
MOTOR = 2.0, 1.0  # N m, N m s/rad


def table(path: Path, seed: int) -> Path:
    """The base rubs by a law that turns from one recording to the next, which no name can be."""
    rng = np.random.default_rng(seed)
    time = np.arange(0.0, 2.0 * PERIOD, 0.01)
    size, harmonics = np.array([0.6, 0.8, 0.9]), np.arange(1, 6)
    phase = rng.uniform(0.0, 2.0 * np.pi, (3, 5))
    q, v, a = motion(time, np.zeros(3), size, harmonics, phase)
    tau = np.array([12.0, 0.3, 0.2]) * a + np.array([30.0, 0.5, 0.5]) * v
    tau += np.array([8.0, 0.3, 0.3]) * np.sign(v)
    speed = v[:, 1] + v[:, 2]
    tau[:, 1:] += (MOTOR[0] * np.sign(speed) + MOTOR[1] * speed)[:, np.newaxis]
    tau[:, 0] += (1.0 if seed % 2 else -1.0) * 2.5 * np.sign(v[:, 0]) * np.abs(q[:, 0])
    tau += np.array([0.002, 0.9, 0.9]) * rng.normal(size=tau.shape)
    names = [f"{what}_{joint}" for what in "qf" for joint in JOINTS]
    rows = np.column_stack([time, q, tau])
    np.savetxt(path, rows, delimiter=",", header=",".join(["t", *names]), comments="")
    return path


@pytest.fixture(scope="module")
def answer(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[dict[str, Any], str]]:
    """findings.json and report.html of `diagnose --terms`."""
    folder = tmp_path_factory.mktemp("wrist")
    (folder / "wrist_terms_of_mine.py").write_text(TERMS)
    terms = "".join(
        f"  - {{type: {kind}, joint: {joint}}}\n"
        for joint in JOINTS
        for kind in ("inertia", "viscous", "coulomb")
    )
    units = ", ".join(f"{joint}: rad" for joint in JOINTS)
    (folder / "model.yaml").write_text(f"name: wrist\njoints: {{{units}}}\nterms:\n{terms}")
    columns = "".join(
        f"  {one}: {{position: {{column: q_{one}, unit: rad}}, "
        f"force: {{column: f_{one}, unit: N m}}}}\n"
        for one in JOINTS
    )
    (folder / "columns.yaml").write_text(f"time: {{column: t, unit: s}}\njoints:\n{columns}")
    tables = [str(table(folder / f"{seed}.csv", seed)) for seed in range(1, 6)]
    registered, path = dict(REGISTRY), list(sys.path)
    try:
        status = main(
            [
                *("--model", str(folder / "model.yaml"), "--columns", str(folder / "columns.yaml")),
                *("--train", *tables[:-1], "--validate", tables[-1], "--trust-recordings"),
                *("--terms", str(folder / "wrist_terms_of_mine.py"), "--out", str(folder / "out")),
            ]
        )
    finally:
        REGISTRY.clear()
        REGISTRY.update(registered)
        sys.path[:] = path
        sys.modules.pop("wrist_terms_of_mine", None)
    assert status == 0
    content = json.loads((folder / "out" / "findings.json").read_text())
    yield content, (folder / "out" / "report.html").read_text()


def test_a_term_of_two_joints_is_held_to_the_gap_of_these(
    answer: tuple[dict[str, Any], str],
) -> None:
    """Not to that of the base, where it does nothing and another law is left."""
    content, _ = answer
    (finding,) = content["findings"]
    assert finding["effect"] == "motor_friction"
    values = [one["value"] for one in finding["parameters"]]
    assert values == pytest.approx(MOTOR, rel=0.05)
    assert content["verdict"] == "named_and_more"
    before, after = content["model_error"]["before"], content["model_error"]["after"]
    for joint in ("pitch", "roll"):
        errors = [side[joint]["force_relative_error"] for side in (before, after)]
        assert errors[1] < 0.3 * errors[0]


def test_a_term_that_is_not_named_is_reported(answer: tuple[dict[str, Any], str]) -> None:
    content, page = answer
    own = content["own_terms"]
    assert {one["effect"] for one in own} == {"hardening"}
    assert {one["joint"] for one in own} == set(JOINTS)
    assert all(one["objection"] for one in own)
    assert "Your own terms that are not named" in page
    assert "hardening spring" in page.lower()
