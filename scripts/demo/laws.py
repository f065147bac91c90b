"""The stand-in machines of the demo, where their results go, and the offline tools run on them."""

import json
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from processes import run

from crane_model.configuration import packaged

OUT = Path("runs/demo")
EXCITATION, VALIDATION = "excitation_20s.yaml", "validation_20s.yaml"
PERIODS = 5  # of the bags that are made faster than real time


@dataclass(frozen=True)
class Law:
    """One friction law of the stand-in machine and where its results go."""

    name: str
    plant: Path
    folder: Path

    def bag(self, use: str) -> Path:
        """Folder of the bag recorded for `use`, "train" or "validate"."""
        return self.folder / "bags" / use

    def read(self, name: str) -> dict[str, Any]:
        """One of the JSON files of this law."""
        return json.loads((self.folder / name).read_text(encoding="utf-8"))


REPORT_LAW = Law("the report's friction law (13)", packaged("crane_sim", "stand_in.yaml"), OUT)
DYNAMIC_LAW = Law(
    "dynamic friction (LuGre)",
    packaged("crane_sim", "stand_in_dynamic_friction.yaml"),
    OUT / "dynamic_friction",
)


def make_bags(law: Law) -> None:
    """One bag to fit on and one, of another trajectory and other noise, to validate on."""

    def make(seed: int, use: str, trajectory: str) -> None:
        run(
            *("crane_sim", "make_bag", "--plant", law.plant, "--out", law.bag(use)),
            *("--trajectory", packaged("crane_trajectory", trajectory)),
            *("--periods", PERIODS, "--seed", seed),
        )

    with ThreadPoolExecutor() as pool:
        list(pool.map(make, (1, 2), ("train", "validate"), (EXCITATION, VALIDATION)))


def note_planted(law: Law) -> None:
    """Write what is planted in the machine beside its bags."""
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
