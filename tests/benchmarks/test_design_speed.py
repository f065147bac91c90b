"""Excitation designs of machines whose bodies move in space: the excavator and a six-axis robot.

Sixteen starts, 5 harmonics, 20 s, all columns of the model. Times are of processors: two cores
share a design.
"""

import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from benchmarks.speed import of_children

from crane_model import Model, load_machine, load_model
from crane_model.machine_files import machine_file
from crane_model.terms import Setting
from crane_model.terms.drives import RotorInertia
from crane_model.terms.friction import Coulomb, Viscous
from crane_model.terms.rigid_body import SerialRigidBody
from crane_model.terms.single_axis import Offset
from crane_trajectory import load_clearance, load_design_settings
from crane_trajectory.excitation.criterion import ColumnSet, Criterion, CriterionKind
from crane_trajectory.excitation.limits import Limit, pull_back, smooth_record
from crane_trajectory.excitation.search import ExcitationProblem, search, workers
from crane_trajectory.motion.periodic import MotionSamples

STARTS, CORES = 16, 2
AT_MOST = 60.0  # s a design, on two cores
SETTINGS = load_design_settings(machine_file("design.yaml", "excavator"))
CLEARANCE = load_clearance(machine_file("clearance.yaml", "excavator"))


def six_axes() -> Model:
    """The 58 base parameters of a real robot with friction and those rotors that can be told apart
    from the bodies, which the first two cannot.
    """
    machine = load_machine(Path(__file__).parents[1] / "machines" / "kuka_kr300.yaml")
    joints = machine.joint_names
    rotors = [RotorInertia(joint=joint) for joint in joints[2:]]
    friction = [kind(joint=joint) for kind in (Viscous, Coulomb, Offset) for joint in joints]
    bodies = SerialRigidBody()
    return Model("robot", Setting(machine.units, machine), (bodies, *rotors, *friction))


MACHINES: dict[str, tuple[Callable[[], Model], frozenset[Limit]]] = {
    "excavator": (lambda: load_model(machine_file("model.yaml", "excavator")), frozenset()),
    "six-axis robot": (six_axes, frozenset({Limit.FLOW, Limit.CLEARANCE})),
}


@pytest.mark.parametrize("name", MACHINES)
def test_a_design_takes_less_than_a_minute(name: str, measured) -> None:
    made, without = MACHINES[name]
    model = made()
    one = Criterion.of(model, CriterionKind.PRODUCT, ColumnSet.BASE, SETTINGS.experiment, {})
    problem = ExcitationProblem(
        model, one, 20.0, 5, SETTINGS.search, SETTINGS.margins, CLEARANCE, without=without
    )
    begin, used = time.perf_counter(), of_children()
    with workers(STARTS) as pool:
        best = search(problem, 1, STARTS, "found", pool)[0]
    assert not best.violations
    wall, used = time.perf_counter() - begin, (of_children() - used) / CORES
    columns = len(model.parameters)
    measured(
        f"design for the {name}, {columns} columns: CPU time of each of two cores; wall time",
        f"{AT_MOST:g} s",
        "{cpu:.0f} s; {wall:.0f} s",
        cpu=used,
        wall=wall,
    )
    print(f"\n{name}: {columns} columns, {used:.1f} s of each core, wall time {wall:.1f} s")
    assert used <= AT_MOST


@pytest.mark.parametrize("name", MACHINES)
def test_slopes_cost_little_more_than_the_regressor(name: str, measured) -> None:
    """One gradient, in closed form, beside the regressor that it is of."""
    model, rng = MACHINES[name][0](), np.random.default_rng(1)
    j, width = len(model.joints), np.full(len(model.joints), 0.02)
    record = smooth_record(model, MotionSamples(*rng.standard_normal((3, 200, j))), width)
    weight = rng.standard_normal((200, j, len(model.parameters)))
    best = {"regressor": np.inf, "slopes": np.inf}
    for _ in range(100):
        for what, function in (
            ("regressor", lambda: model.regressor(record)),
            ("slopes", lambda: pull_back(model, record, weight, width)),
        ):
            begin = time.perf_counter()
            function()
            best[what] = min(best[what], time.perf_counter() - begin)
    times = best["slopes"] / best["regressor"]
    print(f"\n{name}: slopes {best['slopes'] * 1e3:.2f} ms, {times:.1f} regressors")
    measured(f"slopes for a design, {name}", "30 regressors", "{times:.1f}", times=times)
    assert times <= 30.0
