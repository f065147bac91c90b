"""Results of a bring-up step: a numbered folder with a YAML file and a picture."""

import re
from collections.abc import Callable, Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any, Generic, TypeVar

import yaml
from ruamel.yaml import YAML

from crane_driver.operator.bringup.estimates import (
    DeadBandResult,
    EncoderResult,
    FirstGains,
    PolarityResult,
    PressureResult,
)
from crane_model.configuration import load
from crane_model.errors import DataError
from crane_model.result_file import ResultPart

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SIGNIFICANT_DIGITS = 6  # significant, of what is written

RESULT_FILE, MAPPING_FILE, CONTROLLER_FILE = "result.yaml", "mapping.yaml", "controller.yaml"
Entry = TypeVar("Entry")


class DeadBands(ResultPart):
    """The dead bands of a valve."""

    positive: DeadBandResult
    """Dead band of positive commands."""
    negative: DeadBandResult
    """Dead band of negative commands."""


class Result(ResultPart, Generic[Entry]):
    """`result.yaml`: what a step has measured."""

    step: str
    """Its name."""
    date: str
    """When, UTC."""
    mapping: str
    """File of the mapping that the driver ran with."""
    protocol: dict[str, float]
    """Options by which it was measured, in the units of these [unit]."""
    results: dict[str, Entry]
    """By joint; of `pressures`, by transducer."""


RESULTS: dict[str, type[Result[Any]]] = {
    "encoders": Result[EncoderResult],
    "pressures": Result[PressureResult],
    "valves": Result[PolarityResult],
    "dead_band": Result[DeadBands],
    "gains": Result[FirstGains],
}
"""Results of the steps, in their order."""
STEPS = tuple(RESULTS)


class Series:
    """All steps so far, in `folder`."""

    def __init__(self, folder: Path):
        self.folder = folder

    @property
    def runs(self) -> list[Path]:
        found = [(_number(path), path) for path in self.folder.glob("[0-9]*_*") if path.is_dir()]
        return [path for _, path in sorted(found)]

    def newest(self, name: str, step: str = "") -> Path | None:
        """The newest file called `name` [of a step]; None if there is none."""
        runs = [run for run in self.runs if run.name.endswith(step) and (run / name).is_file()]
        return runs[-1] / name if runs else None

    def dead_bands(self) -> dict[str, DeadBands]:
        """By joint, the newest of each; `DataError` if none was measured."""
        bands: dict[str, DeadBands] = {}
        for run in self.runs:
            if run.name.endswith("dead_band"):
                bands |= load(run / RESULT_FILE, Result[DeadBands]).results
        if not bands:
            raise DataError(f"{self.folder}: no dead bands; first: bringup dead_band")
        return bands

    def write(
        self,
        step: str,
        mapping: Path,
        protocol: Mapping[str, float],
        results: Mapping[str, Any],
        figure: "Figure",
    ) -> Path:
        """A new folder with result and picture; returns it."""
        number = max((_number(path) for path in self.runs), default=0) + 1
        run = self.folder / f"{number:02d}_{step}"
        run.mkdir(parents=True)
        content = RESULTS[step](
            step=step,
            date=datetime.now(UTC).isoformat(timespec="seconds"),
            mapping=str(mapping),
            protocol=dict(protocol),
            results=dict(results),
        )
        (run / RESULT_FILE).write_text(
            yaml.safe_dump(_short(content.plain()), sort_keys=False), "utf-8"
        )
        figure.savefig(run / f"{step}.png", dpi=110)
        return run


def copy_changed(source: Path, target: Path, change: Callable[[Any], None], remark: str) -> None:
    """Copy a YAML file with some values changed; its comments and layout stay."""
    file = YAML()
    file.width = 1000
    content = file.load(source.read_text("utf-8"))
    change(content)
    with target.open("x", encoding="utf-8") as out:
        out.write(f"# {remark}\n")
        file.dump(content, out)


def significant(value: float) -> float:
    """The value as it is written to files."""
    return float(f"{value:.{SIGNIFICANT_DIGITS}g}")


def _number(path: Path) -> int:
    match = re.match(r"\d+", path.name)
    return int(match[0]) if match else 0


def _short(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {key: _short(entry) for key, entry in value.items() if entry is not None}
    return significant(value) if isinstance(value, float) else value
