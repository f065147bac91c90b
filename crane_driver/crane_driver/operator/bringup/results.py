"""Results of a bring-up step: a numbered folder with a YAML file and a picture."""

import re
from collections.abc import Callable, Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Generic, NamedTuple, TypeVar

import numpy as np
import yaml
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from ruamel.yaml import YAML
from scipy.ndimage import gaussian_filter1d

from crane_driver.operator.bringup.estimates import (
    DeadBandFit,
    DeadBandResult,
    EncoderResult,
    FirstGains,
    PolarityResult,
    PressureResult,
    RampFit,
    StepResponse,
    Trace,
)
from crane_model.configuration import load
from crane_model.errors import DataError
from crane_model.result_file import ResultPart

SIGNIFICANT_DIGITS = 6  # significant, of what is written

RESULT_FILE, MAPPING_FILE, CONTROLLER_FILE = "result.yaml", "mapping.yaml", "controller.yaml"
Entry = TypeVar("Entry")

MEASURED, FITTED, COMMAND, SOFT = "#1f5fa8", "#d1495b", "#7a8691", "#c9d1d9"
STYLE: Any = {
    "font.size": 9,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.color": "#e8ebee",
    "axes.titlesize": 9,
    "axes.titlelocation": "left",
    "legend.frameon": False,
}
PANEL_INCHES = (4.6, 2.9)  # inch
SMOOTHING_SAMPLES = 8.0  # samples, of the speed that is drawn
BAR_PA = 1e5  # Pa


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
        figure: Figure,
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


class EncoderTrace(NamedTuple):
    """Readings of one encoder over time."""

    time: np.ndarray  # (n,) s
    readings: np.ndarray  # (n,) rad, m


@rc_context(STYLE)
def draw_encoders(
    traces: Mapping[str, EncoderTrace],
    results: Mapping[str, EncoderResult],
    units: Mapping[str, str],
) -> Figure:
    """traces: of each joint from the known pose on."""
    figure, panels = _figure(len(traces))
    for axes, (joint, (time, readings)) in zip(panels, traces.items(), strict=True):
        unit, size = _shown_unit(units[joint])
        result = results[joint]
        axes.plot(time - time[0], readings * size, color=MEASURED)
        axes.axhline(readings[0] * size, color=SOFT, zorder=0)
        axes.set_title(f"{joint}: sign {result.sign:+d}, zero at {result.zero * size:.4g} {unit}")
        axes.set_xlabel("t [s], moved in the positive direction")
        axes.set_ylabel(f"reading [{unit}]")
    return figure


@rc_context(STYLE)
def draw_pressures(
    readings: Mapping[str, np.ndarray], results: Mapping[str, PressureResult]
) -> Figure:
    """readings: (n,) of each vented transducer [Pa]."""
    figure = Figure(figsize=(7.0, 0.9 + 0.38 * len(readings)), layout="constrained")
    axes = figure.subplots()
    names = list(readings)
    for row, name in enumerate(names):
        values = readings[name] / BAR_PA
        spread = np.linspace(-0.22, 0.22, len(values))
        axes.plot(values, row + spread, ".", markersize=2, color=SOFT, zorder=1)
        result = results[name]
        axes.plot(result.offset / BAR_PA, row, "o", color=MEASURED)
        axes.annotate(
            f"{result.offset / BAR_PA:+.3f} ± {result.spread / BAR_PA:.3f}",
            (result.offset / BAR_PA, row),
            xytext=(0, 11),
            textcoords="offset points",
            ha="center",
            fontsize=8,
        )
    axes.axvline(0.0, color=COMMAND, linewidth=0.8)
    axes.set_yticks(range(len(names)), names)
    axes.set_ylim(len(names) - 0.5, -0.7)
    axes.margins(x=0.12)
    axes.grid(False, axis="y")
    axes.set_xlabel("reading with vented chambers [bar]: mean ± standard deviation of a reading")
    return figure


@rc_context(STYLE)
def draw_valves(
    traces: Mapping[str, Trace], results: Mapping[str, PolarityResult], units: Mapping[str, str]
) -> Figure:
    """traces: both nudges of each joint."""
    figure, panels = _figure(len(traces))
    for axes, (joint, trace) in zip(panels, traces.items(), strict=True):
        unit, size = _small_unit(units[joint])
        time = trace.time - trace.time[0]
        axes.plot(time, (trace.position - trace.position[0]) * size, color=MEASURED)
        axes.set_ylabel(f"displacement [{unit}]", color=MEASURED)
        axes.set_xlabel("t [s]")
        twin = axes.twinx()
        twin.plot(time, trace.command, color=COMMAND, linewidth=1.0, drawstyle="steps-post")
        twin.set_ylabel("command", color=COMMAND)
        twin.grid(False)
        _same_zero(axes, twin)
        result = results[joint]
        axes.set_title(
            f"{joint}: polarity {result.polarity:+d}, moves at "
            f"{result.up.command:+.3f} and {result.down.command:+.3f}"
        )
    return figure


@rc_context(STYLE)
def draw_dead_bands(
    fits: Mapping[str, Mapping[int, Sequence[RampFit]]],
    results: Mapping[str, Mapping[int, DeadBandResult]],
    units: Mapping[str, str],
) -> Figure:
    """fits: the triangles of each joint and direction."""
    figure, panels = _figure(len(fits))
    for axes, (joint, directions) in zip(panels, fits.items(), strict=True):
        unit = units[joint]
        for direction, runs in directions.items():
            for trace, fit in runs:
                command, speed, used = _speed(trace, fit)
                axes.plot(command, speed, ".", markersize=1.5, color=SOFT, zorder=1)
                axes.plot(command[used], speed[used], ".", markersize=2, color=MEASURED, zorder=2)
            result = results[joint][direction]
            edge = direction * result.dead_band
            peak = max(float(np.abs(trace.command).max()) for trace, _ in runs)
            axes.plot(
                [edge, direction * peak],
                [0.0, direction * result.gain * (peak - result.dead_band)],
                color=FITTED,
                zorder=3,
            )
            axes.plot(edge, 0.0, "o", color=FITTED, markersize=5, zorder=4)
        up, down = results[joint][1], results[joint][-1]
        axes.set_title(
            f"{joint}: +{up.dead_band:.4f} ± {up.dead_band_std:.4f}, "
            f"−{down.dead_band:.4f} ± {down.dead_band_std:.4f}"
        )
        axes.set_xlabel("command, shifted by the fitted lag")
        axes.set_ylabel(f"speed [{unit}/s]")
    return figure


@rc_context(STYLE)
def draw_gains(
    fits: Mapping[str, Sequence[StepResponse]],
    results: Mapping[str, FirstGains],
    units: Mapping[str, str],
) -> Figure:
    """fits: the steps of each joint."""
    figure, panels = _figure(len(fits))
    for axes, (joint, runs) in zip(panels, fits.items(), strict=True):
        unit, size = _small_unit(units[joint])
        for trace, fit in runs:
            time = trace.time - trace.time[0]
            origin = trace.position[0]
            axes.plot(time, (trace.position - origin) * size, color=MEASURED, linewidth=2.4)
            axes.plot(time, (fit.fitted - origin) * size, "--", color=FITTED, linewidth=1.2)
        worst = max((run.fit for run in runs), key=lambda fit: fit.gain)
        result = results[joint]
        axes.set_title(
            f"{joint}: kp {result.kp:.3g}, kd {result.kd:.3g}, "
            f"closed loop {result.time_constant:.2f} s\n"
            f"K = {worst.gain:.3g} {units[joint]}/s, L = {1e3 * worst.dead_time:.0f} ms, "
            f"T = {1e3 * worst.lag:.0f} ms"
        )
        axes.set_xlabel("t [s] since the step")
        axes.set_ylabel(f"displacement [{unit}]")
        axes.plot([], [], color=MEASURED, linewidth=2.4, label="measured")
        axes.plot([], [], "--", color=FITTED, label="fitted")
        axes.legend(loc="upper left")
    return figure


def _figure(count: int) -> tuple[Figure, list[Axes]]:
    columns = min(count, 2)
    rows = -(-count // columns)
    figure = Figure(
        figsize=(PANEL_INCHES[0] * columns, PANEL_INCHES[1] * rows), layout="constrained"
    )
    panels = figure.subplots(rows, columns, squeeze=False).ravel()
    for unused in panels[count:]:
        unused.remove()
    return figure, list(panels[:count])


def _speed(trace: Trace, fit: DeadBandFit) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    step = float(np.median(np.diff(trace.time)))
    speed = gaussian_filter1d(trace.position, SMOOTHING_SAMPLES, order=1, mode="nearest") / step
    command = np.interp(trace.time - fit.lag, trace.time, trace.command)
    return command, speed, np.isfinite(fit.fitted) & (np.abs(command) > fit.dead_band)


def _same_zero(left: Axes, right: Axes) -> None:
    for axes in (left, right):
        most = max(abs(edge) for edge in axes.get_ylim())
        axes.set_ylim(-most, most)


def _shown_unit(unit: str) -> tuple[str, float]:
    return ("m", 1.0) if unit == "m" else ("°", 180.0 / np.pi)


def _small_unit(unit: str) -> tuple[str, float]:
    return f"m{unit}", 1e3
