"""The folder of a bring-up: one numbered folder a step that succeeded, none ever overwritten."""

import re
from collections.abc import Callable, Mapping
from dataclasses import asdict
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Generic, TypeVar

import yaml
from matplotlib.figure import Figure
from ruamel.yaml import YAML

from crane_driver.operator.bringup.dead_band import DeadBandResult
from crane_model.configuration import Schema, load
from crane_model.errors import DataError

STEPS = ("encoders", "pressures", "valves", "dead_band", "gains")
DIGITS = 6  # significant, of what is written

RESULT, MAPPING, CONTROLLER = "result.yaml", "mapping.yaml", "controller.yaml"
Entry = TypeVar("Entry")


class Result(Schema, Generic[Entry]):
    """`result.yaml`: what a step has measured, when, and on which mapping."""

    step: str
    date: str  # UTC
    mapping: str
    protocol: dict[str, float]  # options by which it was measured
    results: dict[str, Entry]


class DeadBands(Schema):
    """The dead bands of a valve."""

    positive: DeadBandResult
    negative: DeadBandResult


class Series:
    """All steps so far, in `folder`."""

    def __init__(self, folder: Path):
        self.folder = folder

    @property
    def runs(self) -> list[Path]:
        """Folders of the steps that have been done, oldest first."""
        found = [(_number(path), path) for path in self.folder.glob("[0-9]*_*") if path.is_dir()]
        return [path for _, path in sorted(found)]

    def newest(self, name: str, step: str = "") -> Path | None:
        """The newest file called `name` [of a step]; None if there is none."""
        runs = [one for one in self.runs if one.name.endswith(step) and (one / name).is_file()]
        return runs[-1] / name if runs else None

    def dead_bands(self) -> dict[str, DeadBands]:
        """By joint, the newest of each; `DataError` if none was measured."""
        bands: dict[str, DeadBands] = {}
        for run in self.runs:
            if run.name.endswith("dead_band"):
                bands |= load(run / RESULT, Result[DeadBands]).results
        if not bands:
            raise DataError(f"{self.folder}: no dead bands; first: bringup dead_band")
        return bands

    def write(
        self,
        step: str,
        mapping: Path,
        protocol: Mapping[str, float],
        results: Mapping[str, Any],
        figure: Figure,
    ) -> Path:
        """A new folder with result and picture; returns it."""
        number = max((_number(path) for path in self.runs), default=0) + 1
        run = self.folder / f"{number:02d}_{step}"
        run.mkdir(parents=True)
        content = {
            "step": step,
            "date": datetime.now(UTC).isoformat(timespec="seconds"),
            "mapping": str(mapping),
            "protocol": dict(protocol),
            "results": {name: _plain(one) for name, one in results.items()},
        }
        (run / RESULT).write_text(yaml.safe_dump(_short(content), sort_keys=False), "utf-8")
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
    return float(f"{value:.{DIGITS}g}")


def _number(path: Path) -> int:
    match = re.match(r"\d+", path.name)
    return int(match[0]) if match else 0


def _plain(one: Any) -> Any:
    if isinstance(one, Mapping):
        return {key: _plain(value) for key, value in one.items()}
    return asdict(one)


def _short(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {key: _short(one) for key, one in value.items() if one is not None}
    return significant(value) if isinstance(value, float) else value
