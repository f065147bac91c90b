"""Bags of the machine made faster than real time: without the late processes of a live crane."""

from collections.abc import Callable
from pathlib import Path

import numpy as np

from crane_benchmark.measured import of_joints
from crane_identification import fit, read_bag, validate
from crane_model import load_machine, load_model
from crane_model.machine_files import machine_file
from crane_sim import load_simulated_crane
from crane_sim.make_bag import main as make_bag
from crane_sim.true_values import true_parameters

BAGS = ("excitation_20s.yaml", "validation_20s.yaml")


def test_fit_to_bags_made_faster_than_real_time(
    tmp_path: Path, measured: Callable[..., None]
) -> None:
    model = load_model(machine_file("model.yaml"))
    for seed, name in enumerate(BAGS, start=1):
        trajectory = str(machine_file(name))
        words = ["--trajectory", trajectory, "--periods", "5", "--seed", str(seed)]
        assert make_bag([*words, "--out", str(tmp_path / name)]) == 0
    training, held_out = (read_bag(tmp_path / name, model.joints) for name in BAGS)
    fitted = fit(model, [training])
    true = {one.name: one.value for one in true_parameters(load_simulated_crane(), load_machine())}
    found = fitted.estimate
    off = np.abs(found.values - [true[name] for name in found.names]) / found.std_devs
    (validation,) = validate(fitted.model, [held_out])
    error = validation.relative_error
    errors = dict(zip(model.joints, error.tolist(), strict=True))
    row = of_joints("error", f"held-out force, relative to τ ({', '.join(errors)})", errors, ".2%")
    measured(*row.cells, **row.values)
    measured(
        f"{len(off)} true parameters: within 2 σ; farthest off",
        "",
        "{within:.0f}; {farthest:.1f} σ",
        within=np.sum(off < 2.0),
        farthest=off.max(),
    )
    assert off.max() < 4.0
    assert error.max() < 0.01
