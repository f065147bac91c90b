"""Pictures of what the steps of a bring-up measured."""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure
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
