"""Memory of `identify --stream` over the number of bags."""

import subprocess
import sys
from pathlib import Path

from crane_model.machine_files import machine_file
from crane_sim import make_bag

FEW, MANY = 2, 20
AT_MOST = 1.1  # times the memory
COMMAND = """
import resource, sys
from crane_identification.identify import main
assert not main(sys.argv[1:])
print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024)
"""


def peak(bags: list[Path], out: Path) -> float:
    """Peak memory [MB] of the command in a process of its own."""
    arguments = ["--model", str(machine_file("model.yaml")), "--out", str(out), "--replace"]
    arguments += ["--stream", "--estimator", "least_squares", "--train", *map(str, bags)]
    command = [sys.executable, "-c", COMMAND, *arguments]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    return float(done.stdout.splitlines()[-1])


def test_memory_does_not_grow_with_the_bags(tmp_path: Path, measured) -> None:
    trajectory = str(machine_file("excitation_20s.yaml"))
    arguments = ["--trajectory", trajectory, "--periods", "2", "--out", str(tmp_path / "bag")]
    assert not make_bag.main(arguments)
    bags = [tmp_path / f"bag_{number}" for number in range(MANY)]
    for bag in bags:
        bag.symlink_to(tmp_path / "bag")
    peak(bags[:1], tmp_path / "out")  # compiles what has not been yet
    few, many = (peak(bags[:n], tmp_path / "out") for n in (FEW, MANY))
    print(f"\npeak memory: {few:.0f} MB of {FEW} bags, {many:.0f} MB of {MANY}")
    measured(
        f"peak memory of identify --stream, {FEW} and {MANY} bags",
        "the same",
        "{few:.0f}, {many:.0f} MB",
        few=few,
        many=many,
    )
    assert many < AT_MOST * few
