"""The simulated cranes of the demo, where their results go, and the offline tools run on them."""

import json
from dataclasses import dataclass
from pathlib import Path

from processes import Processes

from crane_identification.report.summary import Summary
from crane_model.machine_files import machine_file

OUT = Path("runs/demo")
EXCITATION, VALIDATION = "excitation_20s.yaml", "validation_20s.yaml"
NEEDED = (  # by the acts to come: better missed at once than in the middle
    *("model.yaml", EXCITATION, VALIDATION, "joints.yaml", "sensors.yaml", "can.yaml", "can.dbc"),
    *("safety.yaml", "controller.yaml", "clearance.yaml", "hydraulics.yaml"),
)
PERIODS = 5  # of the bags that are made faster than real time


@dataclass(frozen=True)
class Law:
    """One friction law of the simulated crane and where its results go."""

    name: str
    machine: str  # name of a shipped one, a folder or a machine file
    plant: Path
    folder: Path

    def check(self) -> None:
        """`ConfigurationError` if the machine lacks a file."""
        for name in NEEDED:
            self.file(name)

    def file(self, name: str) -> Path:
        """A file of the machine."""
        return machine_file(name, self.machine)

    @property
    def fitted(self) -> Path:
        """The model file that `identify` writes."""
        return self.folder / "model.yaml"

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
        """What `identify` found."""
        return Summary.read(self.folder / "summary.json")

    @property
    def true_values_file(self) -> Path:
        """Where the true values stand."""
        return self.folder / "true_values.json"

    def note_true_values(self, suite: Processes) -> None:
        """Write the true values of the simulated crane to a file beside its bags."""
        text = suite.output(
            *("true_values", "crane_sim", "true_values", "--machine", self.machine),
            *("--plant", self.plant, "--json"),
        )
        self.true_values_file.write_text(text, encoding="utf-8")


def report_law(machine: str) -> Law:
    """That which the machine's model can represent."""
    plant = machine_file("simulated_crane.yaml", machine)
    return Law("the report's friction law (13)", machine, plant, OUT)


def dynamic_law(machine: str) -> Law:
    """That which it cannot."""
    plant = machine_file("simulated_crane_dynamic_friction.yaml", machine)
    return Law("dynamic friction (LuGre)", machine, plant, OUT / "dynamic_friction")


def make_bags(suite: Processes, law: Law) -> None:
    """One bag to fit on and one, of another trajectory and other noise, to validate on."""
    trajectories = {"train": EXCITATION, "validate": VALIDATION}
    for seed, (use, trajectory) in enumerate(trajectories.items(), start=1):
        suite.start(
            *(f"make_bag_{use}", "crane_sim", "make_bag", "--machine", law.machine),
            *("--plant", law.plant, "--trajectory", law.file(trajectory)),
            *("--periods", PERIODS, "--seed", seed, "--out", law.bag(use)),
        )
    suite.finish(*(f"make_bag_{use}" for use in trajectories))


def identify(suite: Processes, *laws: Law) -> None:
    """Fit and validate, all at once; writes model.yaml, summary.json and report.html of each."""
    for law in laws:
        suite.start(
            *(f"identify_{law.folder.name}", "crane_identification", "identify"),
            *("--model", law.file("model.yaml"), "--out", law.folder),
            *("--train", law.bag("train"), "--validate", law.bag("validate")),
            *("--reference-values", law.true_values_file),
        )
    suite.finish(*(f"identify_{law.folder.name}" for law in laws))
