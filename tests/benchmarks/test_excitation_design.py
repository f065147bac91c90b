"""Excitation design at the paper's setting, beside random search and SLSQP by differences.

Table 2 without margins, 5 harmonics, period 66 s, the 20 base columns in SI units, 200 samples of
the period, no bounds on clearance and acceleration. Times are of
processors: two cores share a design.
"""

import time
from collections.abc import Callable

import numpy as np
from benchmarks.speed import of_children
from scipy.optimize import minimize

from crane_model import load_model
from crane_model.machine_files import machine_file
from crane_trajectory import load_clearance, load_design_settings
from crane_trajectory.excitation.criterion import (
    ColumnSet,
    Criterion,
    CriterionKind,
    condition_numbers,
    one_period,
)
from crane_trajectory.excitation.limits import Limit, Margins
from crane_trajectory.excitation.search import ExcitationProblem, search, workers

SEEDS = range(10)
STARTS = 16
CORES = 2
AT_MOST = 10.0  # s a design, on two cores
MODEL = load_model(machine_file("model.yaml"))
SETTINGS = load_design_settings(machine_file("design.yaml"))
PROBLEM = ExcitationProblem(
    MODEL,
    Criterion.of(
        MODEL, CriterionKind.PRODUCT, ColumnSet.BASE, SETTINGS.experiment, SETTINGS.plausible
    ),
    66.0,
    5,
    SETTINGS.search,
    Margins(position=0.0, velocity=0.0, flow=0.0, clearance=0.0),
    load_clearance(machine_file("clearance.yaml")),
    without=frozenset({Limit.CLEARANCE}),
)


def conditions(point: np.ndarray) -> tuple[float, float]:
    candidate = PROBLEM.fitted(PROBLEM.start_limits.repaired(point), "found")
    phi = one_period(MODEL, candidate.trajectory, PROBLEM.search.samples).reshape(-1, 20)
    raw, normalised = condition_numbers(phi.T @ phi)
    return float(raw), float(normalised)


def random_search(rng: np.random.Generator, seconds: float) -> np.ndarray:
    end = time.process_time() + seconds
    best = PROBLEM.random_point(rng)
    while time.process_time() < end:
        best = min(best, PROBLEM.random_point(rng), key=PROBLEM.value)
    return best


def slsqp_by_differences(rng: np.random.Generator, seconds: float) -> np.ndarray:
    limits, stage = PROBLEM.start_limits, PROBLEM.search.explore
    found, end = [], time.process_time() + seconds
    while time.process_time() < end:
        result = minimize(
            PROBLEM.value,
            PROBLEM.random_point(rng),
            method="SLSQP",
            constraints=[
                {"type": "ineq", "fun": lambda x: limits.bound - limits.matrix @ x},
                {"type": "ineq", "fun": limits.reserves},
            ],
            options={"maxiter": stage.iterations, "ftol": stage.tolerance},
        )
        found.append(limits.repaired(result.x))
    return min(found, key=PROBLEM.value)


def timed_design(seed: int) -> tuple[float, float, float, float]:
    """Raw and normalised condition number, CPU time [s] on each of two cores, wall time [s]."""
    begin, used = time.perf_counter(), of_children()
    with workers(STARTS) as pool:
        best = search(PROBLEM, seed, STARTS, "found", pool)[0]
    assert not best.violations
    wall, used = time.perf_counter() - begin, of_children() - used
    return *conditions(best.trajectory.coefficients.ravel()), used / CORES, wall


def test_designs_reach_the_marks_from_every_seed(measured) -> None:
    print("\n66 s, 5 harmonics            raw   normalised   product   CPU s/2   wall s")
    product = []
    designs = []
    for seed in SEEDS:
        raw, normalised, cpu, wall = timed_design(seed)
        designs.append((raw, normalised, cpu, wall))
        product.append(raw * normalised)
        print(f"  design, seed {seed:<12d}{_row(raw, normalised)}{cpu:10.1f}{wall:9.1f}")
    budget = CORES * float(np.mean([cpu for _, _, cpu, _ in designs]))
    others: dict[str, Callable[[np.random.Generator, float], np.ndarray]] = {
        "random search": random_search,
        "SLSQP by differences": slsqp_by_differences,
    }
    found = {}
    for name, method in others.items():
        row = conditions(method(np.random.default_rng(0), budget))
        print(f"  {name:<25}{_row(*row)}{budget / CORES:10.1f}")
        found[name] = row
        assert row[0] * row[1] > min(product), f"{name} is better than the design"
    marks = [
        (raw, normalised) for raw, normalised, *_ in designs if raw <= 272 and normalised <= 16
    ]
    raw, normalised = min(marks or designs)[:2]
    slowest = max(cpu for *_, cpu, _ in designs)
    wall = max(wall for *_, wall in designs)
    measured(
        "excitation at the paper's setting: raw, column-normalised condition number",
        "272, 16",
        "{raw:.0f}, {normalised:.1f}",
        raw=raw,
        normalised=normalised,
    )
    measured(
        "worst of ten seeds above the best, product of the two",
        "10 %",
        "{above:.1%}",
        above=max(product) / min(product) - 1,
    )
    measured(
        "one design on two cores, the slowest of ten seeds: CPU time a core; wall time",
        "10 s",
        "{cpu:.1f}; {wall:.1f} s",
        cpu=slowest,
        wall=wall,
    )
    for name, row in found.items():
        measured(
            f"excitation by {name}, for the same CPU time",
            "",
            "{raw:.0f}, {normalised:.1f}",
            raw=row[0],
            normalised=row[1],
        )
    assert marks, "no design has raw <= 272 and column-normalised <= 16"
    assert max(product) <= 1.1 * min(product), f"products {np.sort(product)}"
    assert slowest <= AT_MOST, f"{slowest:.1f} s of two cores for a design"


def _row(raw: float, normalised: float) -> str:
    return f"{raw:6.1f}{normalised:13.2f}{raw * normalised:10.0f}"
