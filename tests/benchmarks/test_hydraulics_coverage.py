"""Whether intervals of the hydraulics cover what they claim: simulated experiments, one bag each.

Every experiment is kept in runs/bench, by what code made it: a run that ends early is taken up.
"""

import hashlib
import json
import multiprocessing
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from scipy.stats import binomtest
from unit.crane_identification.hydraulics.valve_experiments import (
    FITTED,
    MACHINE,
    PERIOD,
    recorded,
    truth,
)

import crane_identification.hydraulics
import crane_model.hydraulics
import crane_sim
from crane_identification.hydraulics.joint_estimate import identify_joint
from crane_sim import load_simulated_crane
from crane_sim.parts.parameters import vary, vary_valves

Measured = Callable[[str, str, str], None]

EXPERIMENTS = 200
PROCESSES = 2
KEPT = Path(__file__).resolve().parents[2] / "runs" / "bench" / "hydraulics_coverage"
CODE = (crane_identification.hydraulics, crane_model.hydraulics, crane_sim)
"""What an experiment depends on, above all."""
CONFIDENCE = 1.959964  # standard deviations either side of a 95 % interval
KINDS = {
    "dead bands": ("dead_band_a", "dead_band_b"),
    "flow gains": ("supply_a", "a_tank", "supply_b", "b_tank"),
    "bulk modulus": ("bulk_modulus",),
    "dead volumes": ("dead_volume_a", "dead_volume_b"),
    "leakage": ("leakage",),
    "lag": ("lag",),
}
COVERED = [name for names in KINDS.values() for name in names]


class Outcome(NamedTuple):
    """Of the joints in FITTED: errors in standard deviations of COVERED, and p-values."""

    errors: list[list[float]]
    p_values: list[float]


def experiment(seed: int) -> Outcome:
    """Of a drawn machine with drawn valves."""
    simulated = vary_valves(vary(load_simulated_crane(), seed), MACHINE, seed)
    log = recorded(simulated, seed=seed)
    outcome = Outcome([], [])
    for joint in FITTED:
        found, true = identify_joint(MACHINE, joint, [log], PERIOD).values, truth(simulated, joint)
        values = [found.values[name] for name in COVERED]
        off = [(v.value - true[n]) / v.std_dev for n, v in zip(COVERED, values, strict=True)]
        outcome.errors.append(off)
        outcome.p_values.append(found.lack_of_fit)
    return outcome


def kept(file: Path) -> Outcome:
    """The experiment of a file named by its seed, made if there is none."""
    if not file.exists():
        part = file.with_suffix(".part")
        part.write_text(json.dumps(experiment(int(file.stem))))
        part.rename(file)
    return Outcome(*json.loads(file.read_text()))


def fingerprint() -> str:
    """Of CODE."""
    whole = hashlib.sha256()
    for package in CODE:
        folder = Path(str(package.__file__)).parent
        for file in sorted(folder.rglob("*.py")):
            whole.update(file.read_bytes())
    return whole.hexdigest()[:12]


@pytest.mark.timeout(2 * 3600)
def test_intervals_cover_what_they_claim(measured: Measured) -> None:
    folder = KEPT / fingerprint()
    folder.mkdir(parents=True, exist_ok=True)
    files = [folder / f"{seed}.json" for seed in range(EXPERIMENTS)]
    with multiprocessing.get_context("fork").Pool(PROCESSES) as pool:
        found = pool.map(kept, files, chunksize=1)
    covered = np.abs(np.array([one.errors for one in found])) < CONFIDENCE
    for kind, names in {**KINDS, "pooled": COVERED}.items():
        of_kind = covered[:, :, [COVERED.index(name) for name in names]]
        low, high = binomtest(int(of_kind.sum()), of_kind.size).proportion_ci()
        measured(
            f"95 % intervals that cover, {EXPERIMENTS} experiments, {kind}",
            "93 to 97 %",
            f"{of_kind.mean():.1%} ({low:.1%} to {high:.1%})",
        )
        assert low <= 0.97 and high >= 0.93, kind
    assert 0.93 <= covered.mean() <= 0.97
    alarms = np.array([one.p_values for one in found], dtype=float) < 0.05
    of_joints = dict(zip(FITTED, alarms.T, strict=True))
    for joint, alarm in {**of_joints, "all joints": alarms.ravel()}.items():
        low, high = binomtest(int(alarm.sum()), len(alarm)).proportion_ci()
        measured(
            f"lack of fit at p < 5 % where nothing is missing, {joint}",
            "~ 5 %",
            f"{alarm.mean():.1%} ({low:.1%} to {high:.1%})",
        )
    assert low <= 0.05  # of all joints
