"""The walks of the page on recordings of other robots: its commands, on three synthetic arms."""

import json
import re
import subprocess
from io import StringIO
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from manual import text

PAGE = "docs/reference/other_robots.md"
BLOCK = re.compile(r"```(\w+)\n(.*?)```", re.DOTALL)


class Arm:
    """A serial arm, an axis a line of `table`.

    Place x y z [m] and roll [deg] of its axis z, mass [kg] and centre of mass x y z [m] of its
    link, middle and swing of its motion [rad], dry [N m] and viscous [N m s/rad] friction.
    """

    def __init__(self, name: str, table: str) -> None:
        self.name, self.axes = name, np.loadtxt(StringIO(table))
        self.middle, self.swing, self.dry, self.viscous = self.axes[:, 8:].T

    def urdf(self, factor: float = 1.0) -> str:
        """Its URDF, with bodies `factor` as heavy as those that move."""
        parts, parent = ['<link name="base"/>'], "base"
        for i, (x, y, z, roll, mass, *centre) in enumerate(self.axes[:, :8], 1):
            m = factor * mass
            parts.append(
                f'<joint name="axis_{i}" type="revolute"><parent link="{parent}"/>'
                f'<child link="link_{i}"/><origin xyz="{x} {y} {z}" rpy="{np.radians(roll)} 0 0"/>'
                '<axis xyz="0 0 1"/><limit lower="-2.9" upper="2.9" velocity="4.5" effort="200"/>'
                f'</joint><link name="link_{i}"><inertial><mass value="{m}"/>'
                f'<origin xyz="{" ".join(map(str, centre))}"/><inertia ixx="{0.012 * m}" '
                f'iyy="{0.010 * m}" izz="{0.007 * m}" ixy="0" ixz="0" iyz="0"/></inertial></link>'
            )
            parent = f"link_{i}"
        return f'<robot name="{self.name}">{"".join(parts)}</robot>'

    def motion(self, time: np.ndarray, seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """q, q' and q'' (n, axes): five harmonics of 10 s."""
        rng = np.random.default_rng(seed)
        w = 2 * np.pi / 10.0 * np.arange(1, 6)[:, np.newaxis]
        size = rng.uniform(0.4, 1.0, (5, len(self.axes))) * self.swing / 2.5
        phase = w * time[:, np.newaxis, np.newaxis] + rng.uniform(0, 2 * np.pi, size.shape)
        q = self.middle + (size * np.sin(phase)).sum(axis=1)
        return q, (size * w * np.cos(phase)).sum(axis=1), (-size * w**2 * np.sin(phase)).sum(axis=1)

    def torque(self, q: np.ndarray, v: np.ndarray, a: np.ndarray) -> np.ndarray:
        """(n, axes) [N m]: rigid bodies by Pinocchio, from the URDF, and friction of the joints."""
        model = pin.buildModelFromXML(self.urdf())
        data = model.createData()
        bodies = [pin.rnea(model, data, *row).copy() for row in zip(q, v, a, strict=True)]
        return np.array(bodies) + self.dry * np.sign(v) + self.viscous * v


UR = Arm(
    "six_light_axes",
    """
    0 0 0.14 0 4.1 0 0.01 0.02 0.2 1.2 4.2 6
    0 0.12 0 90 7.6 0.2 0 0.12 -1.1 0.7 5.1 7.5
    0.43 0 0 0 2.5 0.17 0 0.02 1 0.9 3.3 4
    0.36 0 0.11 0 1.3 0 -0.02 0.01 -0.6 1.3 1.1 1.2
    0 -0.09 0 90 1.2 0 0.03 0.01 0.5 1.3 0.9 1.1
    0 0.08 0 -90 0.9 0.03 0.02 0.04 0.1 1.6 0.8 0.9
    """,
)
PANDA = Arm(
    "seven_axes",
    """
    0 0 0.31 0 3.1 0 -0.02 -0.06 0.1 1.2 0.5 0.6
    0 0 0 -90 3.3 0 -0.07 0.03 0.3 0.8 0.7 0.7
    0 -0.3 0 90 2.9 0.04 0.02 -0.05 -0.2 1.1 0.4 0.5
    0.09 0 0 90 2.6 -0.04 0.06 0.02 -1.3 0.7 0.6 0.5
    -0.09 0.37 0 -90 2.4 0 0.03 -0.1 0.3 1.3 0.3 0.3
    0 0 0 90 1.5 0.06 -0.01 0.01 1.4 0.9 0.25 0.2
    0.1 0 0 90 1.1 0.03 0.02 0.08 0.4 1.5 0.2 0.15
    """,
)
TX = Arm(
    "coupled_wrist",
    """
    0 0 0.3 0 6.5 0.01 0 -0.03 0 1.2 5 6
    0.03 0 0 -90 5.2 0.1 0 0.03 -0.9 0.7 6 7
    0.23 0 0.04 0 4.1 0 0.02 0.03 1.2 0.8 4 4.5
    0 -0.05 0 90 2.3 0 0 0.1 0.2 1.2 2 1.8
    0 0 0.22 -90 1.2 0.01 -0.01 0.02 0.6 0.9 0 0
    0 -0.06 0 90 0.7 0.02 0.01 0.03 0.1 1.5 0 0
    """,
)
CONSTANT = np.array([11.5, 11.5, 9.8, 8.4, 8.4, 8.1])  # N m/A of the gears of UR
MOTOR_COULOMB = np.array([1.6, 1.1])  # N m, of axes 5 and 6 of TX
MOTOR_VISCOUS = np.array([1.3, 0.8])  # N m s/rad
TWIST = 1.2  # N m/rad of the hose along the forearm of TX


def write(path: Path, columns: dict[str, np.ndarray], digits: int = 6) -> None:
    """A table with a line of names."""
    rows = np.column_stack(list(columns.values()))
    np.savetxt(path, rows, f"%.{digits}f", delimiter=",", header=",".join(columns), comments="")


def numbered(symbol: str, values: np.ndarray) -> dict[str, np.ndarray]:
    return {f"{symbol}_{i}": column for i, column in enumerate(values.T, 1)}


def noisy(values: np.ndarray, rng: np.random.Generator, share: float = 0.02) -> np.ndarray:
    return values + share * values.std(axis=0) * rng.standard_normal(values.shape)


def record_ur(path: Path, seed: int) -> None:
    """125 Hz; motor currents [A]."""
    rng, time = np.random.default_rng(seed), np.arange(0.0, 20.0, 0.008)
    q, v, a = UR.motion(time, seed)
    current = noisy(UR.torque(q, v, a) / CONSTANT, rng)
    q = q + 2e-5 * rng.standard_normal(q.shape)
    write(path, {"t": time, **numbered("q", q), **numbered("i", current)})


def record_panda(path: Path, seed: int) -> None:
    """1 kHz; the controller repeats a state now and then, stamps jitter by 0.3 ms."""
    rng, time = np.random.default_rng(seed), np.arange(0.0, 20.0, 0.001)
    q, v, a = PANDA.motion(time, seed)
    sent = np.arange(len(time))
    late = rng.uniform(size=len(time)) < 0.05
    sent = np.maximum.accumulate(np.where(late, 0, sent))
    torque = noisy(PANDA.torque(q, v, a), rng)[sent]
    q = (q + 1e-5 * rng.standard_normal(q.shape))[sent]
    stamp = time + rng.uniform(-0.3e-3, 0.3e-3, len(time))
    write(path, {"t": stamp, **numbered("q", q), **numbered("tau", torque)})


def record_tx(path: Path, seed: int) -> None:
    """250 Hz; friction of the coupled wrist on the motors, and a hose along the forearm."""
    rng, time = np.random.default_rng(seed), np.arange(0.0, 20.0, 0.004)
    q, v, a = TX.motion(time, seed)
    torque = TX.torque(q, v, a)
    motor = np.column_stack([v[:, 4], v[:, 4] + v[:, 5]])
    drag = MOTOR_COULOMB * np.sign(motor) + MOTOR_VISCOUS * motor
    torque[:, 4] += drag.sum(axis=1)
    torque[:, 5] += drag[:, 1]
    torque[:, [3, 5]] += TWIST * (q[:, 3] + q[:, 5])[:, np.newaxis]
    torque = noisy(torque, rng)
    q = q + 1e-5 * rng.standard_normal(q.shape)
    write(path, {"t": time, **numbered("q", q), **numbered("tau", torque)})


ARMS = {"ur": (UR, record_ur), "panda": (PANDA, record_panda), "tx": (TX, record_tx)}


def model_file(arm: Arm) -> str:
    """One term for all bodies, and friction for each axis."""
    joints = [f"axis_{i}" for i in range(1, len(arm.axes) + 1)]
    friction = [
        f"  - {{type: {kind}, joint: {joint}}}\n"
        for joint in joints
        for kind in ("coulomb", "viscous")
    ]
    listed = ", ".join(f"{joint}: rad" for joint in joints)
    head = f"name: {arm.name}\nmachine: machine.yaml\njoints: {{{listed}}}\n"
    return head + "terms:\n  - {type: serial_rigid_body}\n" + "".join(friction)


@pytest.fixture(scope="module")
def walk(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder in which every file of the page was written and every command was run."""
    folder = tmp_path_factory.mktemp("robots")
    for name, (arm, record) in ARMS.items():
        (folder / name).mkdir()
        (folder / name / "arm.urdf").write_text(arm.urdf(1.15))
        (folder / name / "model.yaml").write_text(model_file(arm))
        record(folder / name / "train.csv", 1)
        record(folder / name / "held_out.csv", 2)
    for language, block in BLOCK.findall(text(PAGE)):
        if language in ("yaml", "python"):
            name, _, content = block.removeprefix("# ").partition("\n")
            (folder / name).write_text(content)
        elif language == "bash":
            command = ["bash", "-euo", "pipefail", "-c", block]
            done = subprocess.run(command, cwd=folder, capture_output=True, text=True)
            assert done.returncode == 0, f"{block}\n{done.stdout}\n{done.stderr}"
    return folder


def result(folder: Path, name: str) -> dict[str, Any]:
    content: dict[str, Any] = json.loads((folder / name).read_text())
    return content


def value(summary: dict[str, Any], name: str) -> float:
    (found,) = [one["value"] for one in summary["parameters"] if one["name"] == name]
    return float(found)


def test_currents_and_a_prior_from_the_urdf(walk: Path) -> None:
    """Bodies of the URDF are 15 % too heavy; the recordings correct them."""
    summary = result(walk, "ur/fit/summary.json")
    assert max(summary["heldout_relative_error"].values()) < 0.005
    for i, (dry, viscous) in enumerate(zip(UR.dry, UR.viscous, strict=True), 1):
        assert value(summary, f"f_c.axis_{i}") == pytest.approx(dry, rel=0.03)
        assert value(summary, f"f_v.axis_{i}") == pytest.approx(viscous, rel=0.03)
    amperes = result(walk, "ur/fit_amperes/summary.json")
    assert len(amperes["warnings"]) > len(summary["warnings"])
    for joint in ("axis_1", "axis_2", "axis_3"):  # their constants differ most from the others
        wrong, right = (one["heldout_relative_error"][joint] for one in (amperes, summary))
        assert wrong > 4.0 * right


def test_states_that_repeat_hide_nothing_and_invent_nothing(walk: Path) -> None:
    findings = result(walk, "panda/diagnosis/findings.json")
    assert findings["verdict"] == "none" and not findings["findings"]


def test_a_coupled_wrist_and_a_term_of_the_user(walk: Path) -> None:
    findings = result(walk, "tx/diagnosis/findings.json")
    assert findings["verdict"] == "named"
    assert [one["effect"] for one in findings["findings"]] == ["hose_twist"]
    summary = result(walk, "tx/fit/summary.json")
    assert max(summary["heldout_relative_error"].values()) < 0.005
    assert value(summary, "k_twist") == pytest.approx(TWIST, rel=0.01)
    for i, (dry, viscous) in enumerate(zip(MOTOR_COULOMB, MOTOR_VISCOUS, strict=True), 5):
        assert value(summary, f"f_c_motor.axis_{i}") == pytest.approx(dry, rel=0.02)
        assert value(summary, f"f_v_motor.axis_{i}") == pytest.approx(viscous, rel=0.02)
