"""What lengths that are not those of the machine's file leave, on recordings without noise."""

from pathlib import Path

import numpy as np
import pytest

from crane_benchmark import Case, CaseKind
from crane_benchmark.cases.simulators import drawn_machine, load_seen, save_clean
from crane_benchmark.scores.truth import NOTHING_LEFT, CaseTruth
from crane_model import load_machine, load_model
from crane_model.machine_files import machine_file
from crane_sim.calibration import moved
from crane_trajectory import load_clearance, load_trajectory, plan
from crane_trajectory.control.controller import load_gains

SEEDS = range(40, 46)  # of machines
KINDS = {False: "surveyed, to 0.2 %", True: "off by up to 3 %"}


def left(folder: Path, seed: int, off: bool) -> float:
    """Error of the model over the force, of the joint where it is largest; nothing is hidden."""
    machine, model = load_machine(), load_model(machine_file("model.yaml"))
    case = Case(name="", kind=CaseKind.NOTHING, seed=(0, seed), off=off)
    drawn = drawn_machine(case, machine, seed)
    motion = plan(
        machine,
        load_trajectory(machine_file("excitation_20s.yaml")),
        drawn.simulated.start,
        1,
        load_clearance(machine_file("clearance.yaml")),
    )
    gains = load_gains(machine_file("controller.yaml"), machine)
    path = folder / f"{seed}-{off}.npz"
    save_clean(path, moved((), machine, drawn.simulated, motion, gains, drawn.build))
    seen = load_seen([path], [[]], 0)
    return float(CaseTruth(case, drawn.simulated, (), seen, seen).gap(model).max())


@pytest.mark.parametrize("off", KINDS)
def test_what_lengths_leave(tmp_path: Path, measured, off: bool) -> None:
    errors = np.array([left(tmp_path, seed, off) for seed in SEEDS])
    measured(
        f"force unexplained on the worst joint, lengths {KINDS[off]}; {len(errors)} machines",
        "" if off else "at most 0.2 %",
        "{least:.2%} to {most:.2%}, median {middle:.2%}",
        least=errors.min(),
        most=errors.max(),
        middle=np.median(errors),
    )
    if off:
        assert errors.max() > NOTHING_LEFT
    else:
        assert errors.max() < NOTHING_LEFT
