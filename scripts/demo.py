"""make demo: bags from the stand-in machine, a fitted model, its validation, one table.

The machine exists twice: with the report's friction law, which the model can represent, and with
a dynamic law (LuGre), which it cannot, so that the bias this brings is seen. Everything is done by
the executables that a user would call; results are left in runs/demo.
"""

import json
import math
import shutil
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from ament_index_python.packages import get_package_prefix
from rich import box
from rich.console import Console
from rich.progress import Progress, SpinnerColumn, TextColumn, TimeElapsedColumn
from rich.table import Table

from crane_model.configuration import packaged

OUT = Path("runs/demo")
PERIODS = 5
SEED = 1


@dataclass(frozen=True)
class Law:
    """One friction law of the stand-in machine and where its results go."""

    name: str
    plant: Path
    folder: Path

    def bag(self, use: str) -> Path:
        """Folder of the bag recorded for `use`, "train" or "validate"."""
        return self.folder / "bags" / use

    def read(self, name: str) -> dict:
        """One of the JSON files of this law."""
        return json.loads((self.folder / name).read_text(encoding="utf-8"))


REPORT_LAW = Law("the report's friction law (13)", packaged("crane_sim", "stand_in.yaml"), OUT)
DYNAMIC_LAW = Law(
    "dynamic friction (LuGre)",
    packaged("crane_sim", "stand_in_dynamic_friction.yaml"),
    OUT / "dynamic_friction",
)
LAWS = (REPORT_LAW, DYNAMIC_LAW)


class Phases:
    """Wall time of each phase, shown while it runs."""

    def __init__(self, console: Console) -> None:
        self.console = console
        self.seconds: dict[str, float] = {}

    @contextmanager
    def phase(self, name: str, description: str) -> Iterator[None]:
        """Show and time one phase."""
        columns = (SpinnerColumn(), TextColumn("{task.description}"), TimeElapsedColumn())
        start = time.monotonic()
        with Progress(*columns, console=self.console) as progress:
            task = progress.add_task(description, total=1)
            yield
            progress.update(task, completed=1)
        self.seconds[name] = round(time.monotonic() - start, 2)


def run(package: str, executable: str, *arguments: object) -> str:
    """Run one executable of the suite to its end and return what it printed; exit if it fails."""
    path = Path(get_package_prefix(package)) / "lib" / package / executable
    command = [str(path), *map(str, arguments)]
    done = subprocess.run(command, capture_output=True, text=True)
    if done.returncode:
        sys.exit(f"{package} {executable} failed ({done.returncode}):\n{done.stderr}")
    return done.stdout


def make_bags(law: Law) -> None:
    """One bag to fit on and one, of another trajectory and other noise, to validate on."""
    trajectories = {"train": "excitation_20s.yaml", "validate": "validation_20s.yaml"}
    for seed, (use, trajectory) in enumerate(trajectories.items(), start=SEED):
        run(
            *("crane_sim", "make_bag", "--plant", law.plant, "--out", law.bag(use)),
            *("--trajectory", packaged("crane_trajectory", trajectory)),
            *("--periods", PERIODS, "--seed", seed),
        )
    planted = run("crane_sim", "planted", "--plant", law.plant, "--json")
    (law.folder / "planted.json").write_text(planted, encoding="utf-8")


def identify(law: Law) -> None:
    """Fit and validate; writes model.yaml, summary.json and report.html."""
    run(
        *("crane_identification", "identify", "--out", law.folder),
        *("--model", packaged("crane_model", "crane_model.yaml")),
        *("--train", law.bag("train"), "--validate", law.bag("validate")),
        *("--reference-values", law.folder / "planted.json"),
    )


def for_both(work: Callable[[Law], None]) -> None:
    """Do the work for both laws at once, one core each."""
    with ThreadPoolExecutor(len(LAWS)) as pool:
        list(pool.map(work, LAWS))


def parameters(law: Law) -> list[dict]:
    """Rows of the table: what was planted and what the batch fit found."""
    planted = law.read("planted.json")
    return [
        {
            "name": row["name"],
            "unit": row["unit"],
            "planted": planted[row["name"]],
            "batch": row["value"],
            "batch_std": row["std_dev"],
        }
        for row in law.read("summary.json")["parameters"]
    ]


def table() -> Table:
    """Parameter, unit, planted, and estimate ± σ under both laws."""
    result = _table("Θ: planted in the stand-in machine, and identified from its bags")
    for heading in ("parameter", "unit"):
        result.add_column(heading, no_wrap=True)
    for heading in ("planted", "estimate", "± σ", "off/σ", "LuGre", "off/σ"):
        result.add_column(heading, justify="right", no_wrap=True)
    for row, dynamic in zip(parameters(REPORT_LAW), parameters(DYNAMIC_LAW), strict=True):
        std_dev = row["batch_std"]
        result.add_row(
            row["name"],
            row["unit"],
            *(_rounded(value, std_dev) for value in (row["planted"], row["batch"], std_dev)),
            _deviation(row),
            _rounded(dynamic["batch"], dynamic["batch_std"]),
            _deviation(dynamic),
        )
    return result


def _table(title: str) -> Table:
    return Table(title=title, title_justify="left", box=box.SIMPLE_HEAD, padding=(0, 1, 0, 0))


def _rounded(value: float, std_dev: float) -> str:
    """The value to the place of the second digit of its standard deviation."""
    places = max(0, 1 - math.floor(math.log10(std_dev)))
    return f"{value:.{places}f}"


def _deviation(row: dict) -> str:
    return f"{(row['batch'] - row['planted']) / row['batch_std']:+.1f}"


def errors_table() -> Table:
    """Held-out errors per joint."""
    result = _table("On the bag that was not used for fitting: error of force and of motion")
    result.add_column("joint", no_wrap=True)
    for heading in (
        *("‖τ-τ̂‖/‖τ‖", "without gravity", "noise floor", "with LuGre"),
        *("motion 0.5 s ahead", "friction in τ"),
    ):
        result.add_column(heading, justify="right")
    summary, dynamic = REPORT_LAW.read("summary.json"), DYNAMIC_LAW.read("summary.json")
    motion = summary["simulated_motion"]
    for joint, error in summary["heldout_relative_error"].items():
        result.add_row(
            joint,
            f"{error:.2%}",
            f"{summary['heldout_relative_error_without_gravity'][joint]:.2%}",
            f"{summary['noise_floor'][joint]:.2%}",
            f"{dynamic['heldout_relative_error'][joint]:.2%}",
            f"{motion['position_rms'][joint] / motion['displacement_rms'][joint]:.2%}",
            f"{summary['friction_share'][joint]:.0%}",
        )
    return result


def write_summary(seconds: dict[str, float]) -> None:
    """Add what only the demo knows, planted values and wall time, to the fit's summary.json."""
    summary = REPORT_LAW.read("summary.json") | {
        "parameters": parameters(REPORT_LAW),
        "dynamic_friction": DYNAMIC_LAW.read("summary.json")
        | {"parameters": parameters(DYNAMIC_LAW)},
        "wall_seconds": seconds,
    }
    text = json.dumps(summary, indent=2, ensure_ascii=False)
    (OUT / "summary.json").write_text(text + "\n", encoding="utf-8")


def main() -> None:
    """Run the demo."""
    console = Console()
    phases = Phases(console)
    shutil.rmtree(OUT, ignore_errors=True)  # only ever written by this script
    for law in LAWS:
        law.folder.mkdir(parents=True)
    with phases.phase("bags", f"stand-in machine: {2 * len(LAWS)} bags of {PERIODS} periods"):
        for_both(make_bags)
    with phases.phase("identify", "identification: fit, validation on the other bag, report"):
        for_both(identify)
    console.print(table(), errors_table())
    write_summary(phases.seconds)
    console.print(f"Report: {OUT}/report.html   Model: {OUT}/model.yaml   All: {OUT}/summary.json")


if __name__ == "__main__":
    main()
