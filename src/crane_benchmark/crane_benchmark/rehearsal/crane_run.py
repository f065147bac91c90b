"""A simulated crane whose recordings are identified: its files, and where results go."""

import json
from dataclasses import dataclass
from pathlib import Path

from crane_benchmark.rehearsal.processes import Processes
from crane_identification.report.summary import Summary
from crane_model.machine import load_machine
from crane_model.machine_files import machine_file
from crane_trajectory.control.choice import suited_controller

EXCITATION, VALIDATION = "excitation_20s.yaml", "validation_20s.yaml"
WARM_S = 36_000.0  # s that a simulated crane has been running: no valve answers late for cold
NEEDED = (  # later steps need them: better missed at once than in the middle
    *("model.yaml", EXCITATION, VALIDATION, "joints.yaml", "sensors.yaml", "can.yaml", "can.dbc"),
    *("safety.yaml", "controller.yaml", "clearance.yaml", "hydraulics.yaml"),
)


@dataclass(frozen=True)
class CraneRun:
    """A simulated crane, and the folder of its recordings and results."""

    name: str
    machine: str  # name of a shipped one, a folder or a machine file
    plant: Path
    folder: Path

    def check(self) -> None:
        """`ConfigurationError` if the machine lacks a file."""
        for name in NEEDED:
            self.file(name)

    def file(self, name: str) -> Path:
        return machine_file(name, self.machine)

    @property
    def fitted(self) -> Path:
        """The model file that `identify` writes."""
        return self.folder / "model.yaml"

    @property
    def controller(self) -> str:
        """Name of the controller that the fitted model is given to."""
        return suited_controller(load_machine(self.machine))

    def bag(self, use: str) -> Path:
        """Folder of the bag recorded for `use`, "train", "validate" or "follow"."""
        return self.folder / "bags" / use

    def result(self, use: str) -> Path:
        """File of the result of the live experiment of `use`."""
        return self.folder / f"excitation_{use}.json"

    def true_values(self) -> dict[str, float]:
        """True value of each parameter [SI]."""
        values: dict[str, float] = json.loads(self.true_values_file.read_text(encoding="utf-8"))
        return values

    def summary(self) -> Summary:
        return Summary.read(self.folder / "summary.json")

    @property
    def true_values_file(self) -> Path:
        return self.folder / "true_values.json"

    def note_true_values(self, suite: Processes) -> None:
        """Write the true values of the simulated crane to a file beside its bags."""
        text = suite.output(
            *("true_values", "crane_sim", "true_values", "--machine", self.machine),
            *("--plant", self.plant, "--json"),
        )
        self.true_values_file.write_text(text, encoding="utf-8")


def identify(suite: Processes, *runs: CraneRun) -> None:
    """Fit and validate, all at once; writes model.yaml, summary.json and report.html of each."""
    for run in runs:
        suite.start(
            *(f"identify_{run.folder.name}", "crane_identification", "identify"),
            *("--model", run.file("model.yaml"), "--out", run.folder),
            *("--train", run.bag("train"), "--validate", run.bag("validate")),
            *("--reference-values", run.true_values_file),
        )
    suite.finish(*(f"identify_{run.folder.name}" for run in runs))
