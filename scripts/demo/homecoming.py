"""Results of the demo's encoder fault: who found it and when, the estimate, the payload."""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from following import AFTER, BEFORE
from laws import OUT
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from outcome import Unplugged
from rich.table import Table
from unplugged import LOAD, USE, Pulled

from crane_bags.clocks import NANOSECONDS
from crane_bags.types import JOINT_STATES, POSITION_ESTIMATE, TIP_LOAD
from crane_benchmark.rehearsal.crane_run import CraneRun
from crane_benchmark.rehearsal.operator_node import Told, fault_answer, told
from crane_identification.report.terminal import plain_table
from crane_model import load_machine

PICTURE = OUT / "unplugged.png"
BEFORE_S, AFTER_S = 6.0, 3.0  # shown before the plug is pulled, and after the crane is home


class Heard(NamedTuple):
    """Readings of the bag: the joint's encoder, its estimate with σ, the payload with σ."""

    encoder: Told
    estimate: Told
    load: Told


def heard(law: CraneRun, pulled: Pulled) -> Heard:
    """Return the readings of the joint whose encoder was unplugged."""
    bag = law.bag(USE)

    def of_joint(*fields: str) -> Callable[[Any], list[float]]:
        def values(message: Any) -> list[float]:
            at = list(message.name).index(pulled.joint)
            return [getattr(message, field)[at] for field in fields]

        return values

    return Heard(
        told(bag, JOINT_STATES, of_joint("position")),
        told(bag, POSITION_ESTIMATE, of_joint("position", "std_dev")),
        told(bag, TIP_LOAD, lambda message: (message.load, message.std_dev)),
    )


def measured(law: CraneRun, pulled: Pulled) -> Unplugged:
    """Return delays and errors from the bag of the fault."""
    answer = fault_answer(law.bag(USE), pulled.joint, pulled.at)
    encoder, estimate, load = heard(law, pulled)
    read = encoder.values[np.isfinite(encoder.values[:, 0]), 0]
    home = _before(estimate, pulled.home)[0]
    mass, deviation = _before(load, pulled.home)
    return Unplugged(
        **dict(answer),
        estimate_error=float(home - read[-1]),
        true_load=LOAD,
        load=float(mass),
        load_std_dev=float(deviation),
    )


def _before(of: Told, when: int) -> np.ndarray:
    """Return the last values until a stamp."""
    values: np.ndarray = of.values[of.stamp <= when][-1]
    return values


def table(law: CraneRun, found: Unplugged) -> Table:
    """Return the results as a table for the terminal."""
    unit = load_machine(law.machine).units[found.joint]
    result = plain_table(f"The encoder of the {_plain(found.joint)}, unplugged in motion")
    result.add_column("result", no_wrap=True)
    result.add_column("", justify="right")
    result.add_row(f"found by {found.named_by} after", f"{found.seconds_to_name:.2f} s")
    result.add_row("valves neutral after", f"{found.seconds_to_neutral:.2f} s")
    error = 1e3 * found.estimate_error
    result.add_row("at home: estimate minus encoder, plugged in again", f"{error:.1f} m{unit}")
    load_shown = f"{found.load:.1f} ± {found.load_std_dev:.1f} kg"
    result.add_row(f"payload estimated in motion, true {found.true_load:g} kg", load_shown)
    return result


def draw(law: CraneRun, pulled: Pulled, found: Unplugged) -> None:
    """Draw encoder and estimate of the joint, and the payload, over time."""
    encoder, estimate, load = heard(law, pulled)
    figure = Figure(figsize=(11.0, 6.0), layout="constrained")
    figure.suptitle(
        f"The encoder of the {_plain(found.joint)} fails in motion; the crane returns without it"
    )
    upper, lower = figure.subplots(2, 1, sharex=True, height_ratios=(2, 1))
    upper.plot(_seconds(encoder, pulled), encoder.values, color=BEFORE, lw=1.2, label="encoder")
    _banded(upper, estimate, pulled, "estimate, ± 2 σ")
    unit = load_machine(law.machine).units[found.joint]
    upper.set_ylabel(f"{_plain(found.joint)} [{unit}]")
    _banded(lower, load, pulled, "estimate, ± 2 σ")
    lower.axhline(found.true_load, color="0.5", lw=0.8, ls="--", label="true payload")
    lower.set_ylabel("payload [kg]")
    lower.set_ylim(0.0, 2.0 * found.true_load)
    lower.set_xlabel("time since the plug was pulled [s]")
    home = (pulled.home - pulled.at) / NANOSECONDS
    for panel in (upper, lower):
        panel.spines[["top", "right"]].set_visible(False)
        panel.set_xlim(-BEFORE_S, home + AFTER_S)
        for when in (0.0, home):
            panel.axvline(when, color="0.8", lw=0.8, zorder=0)
    upper.legend(loc="center right", frameon=False)
    lower.legend(loc="upper right", frameon=False, ncols=2)
    above = upper.get_xaxis_transform()  # the axes, clear of the curves
    for name, when in {"unplugged": 0.0, "home": home}.items():
        upper.text(when, 1.0, name, transform=above, ha="center", va="bottom", color="0.4")
    figure.savefig(PICTURE, dpi=130)


def _plain(joint: str) -> str:
    return joint.replace("_", " ")


def _seconds(data: Told, pulled: Pulled) -> np.ndarray:
    seconds: np.ndarray = (data.stamp - pulled.at) / NANOSECONDS
    return seconds


def _banded(panel: Axes, data: Told, pulled: Pulled, name: str) -> None:
    value, deviation = data.values.T
    time = _seconds(data, pulled)
    panel.plot(time, value, color=AFTER, lw=1.2, label=name)
    panel.fill_between(time, value - 2 * deviation, value + 2 * deviation, color=AFTER, alpha=0.2)
