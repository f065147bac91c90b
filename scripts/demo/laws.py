"""The simulated cranes of the demo and their bags."""

from pathlib import Path

from crane_benchmark.rehearsal.crane_run import EXCITATION, VALIDATION, WARM_S, CraneRun
from crane_benchmark.rehearsal.processes import Processes
from crane_model.machine_files import machine_file

OUT = Path("runs/demo")
PERIODS = 5  # of the bags that are made faster than real time


def report_law(machine: str) -> CraneRun:
    """That which the machine's model can represent."""
    plant = machine_file("simulated_crane.yaml", machine)
    return CraneRun("the paper's friction law (13)", machine, plant, OUT)


def dynamic_law(machine: str) -> CraneRun:
    """That which it cannot."""
    plant = machine_file("simulated_crane_dynamic_friction.yaml", machine)
    return CraneRun("dynamic friction (LuGre)", machine, plant, OUT / "dynamic_friction")


def make_bags(suite: Processes, law: CraneRun) -> None:
    """One bag to fit on and one, of another trajectory and other noise, to validate on."""
    trajectories = {"train": EXCITATION, "validate": VALIDATION}
    for seed, (use, trajectory) in enumerate(trajectories.items(), start=1):
        suite.start(
            *(f"make_bag_{use}", "crane_sim", "make_bag", "--machine", law.machine),
            *("--plant", law.plant, "--trajectory", law.file(trajectory)),
            *("--periods", PERIODS, "--seed", seed, "--out", law.bag(use)),
            *("--running", WARM_S),
        )
    suite.finish(*(f"make_bag_{use}" for use in trajectories))
