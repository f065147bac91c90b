"""What the act without an encoder showed: who named it and when, the estimate, the load."""

from typing import NamedTuple

import numpy as np
from bags import first_stamp
from following import AFTER, BEFORE
from laws import OUT, Law
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from outcome import Unplugged
from rich.table import Table
from unplugged import LOAD, USE, Pulled

from crane_bags.clocks import NANOSECONDS
from crane_bags.fields import Place, read_fields
from crane_bags.reader import TopicData
from crane_bags.types import (
    DRIVER_STATE,
    JOINT_STATES,
    POSITION_ESTIMATE,
    SENSOR_FINDINGS,
    TIP_LOAD,
    VALVE_OUTPUT,
)
from crane_identification.report.terminal import plain_table
from crane_interfaces.msg import DriverState
from crane_model.machine import load_machine

PICTURE = OUT / "unplugged.png"
BEFORE_S = 6.0  # shown before the plug is pulled


class Heard(NamedTuple):
    """The joint's encoder, its estimate, the spool commands and the load, of the bag."""

    encoder: TopicData
    estimate: TopicData
    valves: TopicData
    load: TopicData


def heard(law: Law, pulled: Pulled) -> Heard:
    """Of the act."""
    wanted = {
        JOINT_STATES: [Place("position", pulled.joint)],
        POSITION_ESTIMATE: [Place("position", pulled.joint), Place("std_dev", pulled.joint)],
        VALVE_OUTPUT: [Place("command", one) for one in load_machine(law.machine).joint_names],
        TIP_LOAD: [Place("load"), Place("std_dev")],
    }
    found = read_fields(
        law.bag(USE),
        {topic.name: places for topic, places in wanted.items()},
        {topic.name: topic.msgtype for topic in wanted},
    )
    return Heard(*(found[topic.name] for topic in wanted))


def measured(law: Law, pulled: Pulled) -> Unplugged:
    """From the bag of the act."""
    encoder, estimate, valves, load = heard(law, pulled)
    joint = pulled.joint
    named = {
        "sensor_monitor": first_stamp(
            law.bag(USE), SENSOR_FINDINGS, pulled.at, lambda told: joint in told.joint
        ),
        "driver": first_stamp(
            law.bag(USE),
            DRIVER_STATE,
            pulled.at,
            lambda told: told.state == DriverState.STATE_FAULT and told.source == joint,
        ),
    }
    by = min(named, key=lambda one: named[one])
    commands = np.stack(list(valves.fields.values()), axis=1)
    neutral = valves.stamp[(valves.stamp > pulled.at) & ~commands.any(axis=1)][0]
    (position,), (guess, _) = encoder.fields.values(), estimate.fields.values()
    at_last = encoder.stamp > pulled.home
    plugged_in = position[at_last & np.isfinite(position)]
    weighed, sure = load.fields.values()
    home = np.searchsorted(load.stamp, pulled.home) - 1
    return Unplugged(
        joint=joint,
        named_by=by,
        seconds_to_name=(named[by] - pulled.at) / NANOSECONDS,
        seconds_to_neutral=(neutral - pulled.at) / NANOSECONDS,
        estimate_error=float(
            guess[np.searchsorted(estimate.stamp, pulled.home) - 1] - plugged_in[-1]
        ),
        planted_load=LOAD,
        load=float(weighed[home]),
        load_std_dev=float(sure[home]),
    )


def table(law: Law, found: Unplugged) -> Table:
    """The same in words."""
    unit = load_machine(law.machine).units[found.joint]
    result = plain_table(f"The encoder of {found.joint} unplugged in motion, its counters going on")
    result.add_column("what", no_wrap=True)
    result.add_column("", justify="right")
    result.add_row(f"named by {found.named_by} after", f"{found.seconds_to_name:.2f} s")
    result.add_row("valves neutral after", f"{found.seconds_to_neutral:.2f} s")
    error = 1e3 * found.estimate_error
    result.add_row("home by the estimate; plugged in again, off by", f"{error:.1f} m{unit}")
    weighed = f"{found.load:.1f} ± {found.load_std_dev:.1f} kg"
    result.add_row(f"weighed on the way, of {found.planted_load:g} kg", weighed)
    return result


def draw(law: Law, pulled: Pulled, found: Unplugged) -> None:
    """Write encoder and estimate of the joint, and the load, over time as a picture."""
    encoder, estimate, _, load = heard(law, pulled)
    figure = Figure(figsize=(11.0, 6.0), layout="constrained")
    figure.suptitle(f"The encoder of {found.joint} is unplugged in motion: home by pressures alone")
    upper, lower = figure.subplots(2, 1, sharex=True, height_ratios=(2, 1))
    (position,) = encoder.fields.values()
    upper.plot(_seconds(encoder, pulled), position, color=BEFORE, lw=1.2, label="encoder")
    _banded(upper, estimate, pulled, "estimate, ± 2 σ")
    unit = load_machine(law.machine).units[found.joint]
    upper.set_ylabel(f"{found.joint.replace('_', ' ')} [{unit}]")
    _banded(lower, load, pulled, "weighed, ± 2 σ")
    lower.axhline(found.planted_load, color="0.5", lw=0.8, ls="--", label="hangs at the tip")
    lower.set_ylabel("load [kg]")
    lower.set_ylim(0.0, 2.0 * found.planted_load)
    lower.set_xlabel("time since the plug was pulled [s]")
    home = (pulled.home - pulled.at) / NANOSECONDS
    marks = {"unplugged": 0.0, "neutral": found.seconds_to_neutral, "home": home}
    for panel in (upper, lower):
        panel.spines[["top", "right"]].set_visible(False)
        panel.set_xlim(left=-BEFORE_S)
        for when in marks.values():
            panel.axvline(when, color="0.8", lw=0.8, zorder=0)
        panel.legend(loc="best", frameon=False)
    for name, when in marks.items():
        place = {"xycoords": ("data", "axes fraction"), "textcoords": "offset points"}
        upper.annotate(
            name, (when, 1.0), xytext=(3, -2), rotation=90, va="top", color="0.4", **place
        )
    figure.savefig(PICTURE, dpi=130)


def _seconds(data: TopicData, pulled: Pulled) -> np.ndarray:
    return (data.stamp - pulled.at) / NANOSECONDS


def _banded(panel: Axes, data: TopicData, pulled: Pulled, name: str) -> None:
    value, deviation = data.fields.values()
    time = _seconds(data, pulled)
    panel.plot(time, value, color=AFTER, lw=1.2, label=name)
    panel.fill_between(time, value - 2 * deviation, value + 2 * deviation, color=AFTER, alpha=0.2)
