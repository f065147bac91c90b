"""rehearsal.html: the report of a rehearsal, one file without network."""

import shlex
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import NamedTuple

from crane_benchmark.rehearsal.outcome import EXACT_SHARE, SIGMAS, Rehearsal, RehearsedParameter
from crane_benchmark.rehearsal.tried import OFF_WITHIN
from crane_driver.operator.bringup.rehearsed import NOT_CHECKED, REHEARSAL_FILE
from crane_identification.notation import percent, plain, spoken
from crane_identification.report.html import PageLink, part, rendered
from crane_model.hydraulics import JointHydraulics
from crane_model.machine import Machine
from crane_trajectory.control.choice import PD_DEAD_BAND
from crane_trajectory.tune import SCALES, WANTED_SCALE

PAGE = "rehearsal.html"
LINKED = {
    "report.html": "identification",
    "bringup": "bring-up",
    "bags": "recordings",
    "logs": "logs",
    REHEARSAL_FILE: "all numbers",
}


class PageRow(NamedTuple):
    """A row of a table."""

    heading: str
    cells: tuple[str, ...]
    good: bool = True


class PageTable(NamedTuple):
    """A table: the column `judged` is marked in rows that are not good, `texts` are no numbers."""

    heads: tuple[str, ...]
    rows: Sequence[PageRow]
    judged: int = 0
    texts: tuple[int, ...] = (0,)


class PageSection(NamedTuple):
    """A section of the page."""

    title: str
    text: str
    tables: Sequence[PageTable] = ()
    lines: Sequence[str] = ()


def render(outcome: Rehearsal, machine: Machine, name: str, folder: Path) -> str:
    """Return the page for a folder as HTML; `name` is how the user named the machine."""
    words = ["ros2", "run", "crane_benchmark", "rehearse", "--machine", name, "--out", str(folder)]
    return rendered(
        __package__,
        {},
        outcome=outcome,
        verdict=verdict(outcome, machine),
        sections=_sections(outcome, machine),
        command=shlex.join(words),
        links=[PageLink(text, file) for file, text in LINKED.items() if (folder / file).exists()],
        style=part("crane_identification.report", "page.css"),
    )


def verdict(outcome: Rehearsal, machine: Machine) -> list[str]:
    """Sentences that sum the rehearsal up."""
    if outcome.failed:
        return [f"Not complete: {', '.join(outcome.failed)} failed."]
    mechanics, hydraulics = _kinds(outcome, machine)
    far = {spoken(found.joint) for found in outcome.stopping if found.distance > found.allowed}
    weak = {
        spoken(found.joint)
        for found in outcome.margins
        if found.controller != PD_DEAD_BAND and found.gain_margin < WANTED_SCALE
    }
    return [
        f"Complete. {_recovered(mechanics)} parameters of the mechanics and "
        f"{_recovered(hydraulics)} of the hydraulics were recovered.",
        f"The gain margin at the measured delay is too small on {', '.join(sorted(weak))}."
        if weak
        else "The model-based controller has sufficient gain margins at the measured delay.",
        f"{', '.join(sorted(far))}: the stopping distance is longer than safety.yaml assumes; "
        "lower the deceleration there."
        if far
        else "Each joint stops as safety.yaml assumes.",
        f"The sensor monitor named {sum(found.right for found in outcome.faults)} of "
        f"{len(outcome.faults)} injected faults.",
    ]


def _kinds(
    outcome: Rehearsal, machine: Machine
) -> tuple[list[RehearsedParameter], list[RehearsedParameter]]:
    names = {f"{name}.{joint}" for joint in machine.joint_names for name in JointHydraulics.units}
    every = outcome.parameters
    return (
        [found for found in every if found.name not in names],
        [found for found in every if found.name in names],
    )


def _recovered(found: Sequence[RehearsedParameter]) -> str:
    return f"{sum(one.recovered for one in found)} of {len(found)}"


def _sections(outcome: Rehearsal, machine: Machine) -> list[PageSection]:
    mechanics, hydraulics = _kinds(outcome, machine)
    delay = f"{1e3 * outcome.margins[0].delay:.0f} ms" if outcome.margins else "not known"
    lost = outcome.lost_encoder
    noticed = "" if lost is None else (
        f"With the driver running, the encoder of the {spoken(lost.joint)} froze in motion: "
        f"{lost.named_by} named it after {lost.seconds_to_name:.2f} s, and all valves were "
        f"commanded neutral after {lost.seconds_to_neutral:.2f} s. "
    )  # fmt: skip
    return [
        PageSection(
            "Bring-up",
            "The steps pressures, valves, dead_band and gains, with one repeat. The step encoders "
            "needs a person who moves the joints and was left out.",
            [_valves(outcome)] if outcome.valves else [],
        ),
        PageSection(
            "Parameters",
            f"An estimate counts as recovered within {SIGMAS:g} σ or {100.0 * EXACT_SHARE:g} % "
            f"of the true value. Of the hydraulics, {_recovered(hydraulics)} were recovered; the "
            "last table shows only the others.",
            [
                _parameters("Mechanics", mechanics),
                _forces(outcome),
                _parameters("Hydraulics", [one for one in hydraulics if not one.recovered]),
            ]
            if mechanics
            else [],
        ),
        PageSection(
            "Control and margins",
            "The tracking error is measured with the driver, and simulated with the identified "
            "model. The gain margin is the largest factor of the gains without oscillation; it "
            f"should be at least {WANTED_SCALE:g}. The measured delay of the loop is {delay}.",
            [_control(outcome, machine)] if outcome.margins else [],
        ),
        PageSection(
            "Stopping distances",
            "Each joint is brought towards its largest speed; then its command falls to neutral "
            "within the ramp time of safety.yaml. The driver keeps the distance of the last column "
            "before a limit, by the deceleration and the reaction time in safety.yaml.",
            [_stopping(outcome, machine)] if outcome.stopping else [],
        ),
        PageSection(
            "Sensor faults",
            f"{noticed}The other faults begin in mid-motion, each in a recording of its own "
            "without the safety functions of the driver. The table shows the largest distance of "
            f"the joint from its reference within {OFF_WITHIN:g} s, with and without the fault, "
            "and the first finding of the sensor monitor.",
            [_faults(outcome, machine)] if outcome.faults else [],
        ),
        PageSection("What a rehearsal does not check", "", lines=NOT_CHECKED),
    ]


def _valves(outcome: Rehearsal) -> PageTable:
    rows = []
    for found in outcome.valves:
        sign = "as in can.yaml" if found.sign_stays else "to be changed"
        bands = (f"{band:.4f}" for band in (*found.dead_band, *found.true_dead_band))
        rows.append(PageRow(spoken(found.joint), (sign, *bands), found.sign_stays))
    heads = ("Joint", "sign of the command", "dead band +", "dead band −", "true +", "true −")
    return PageTable(heads, rows, judged=1, texts=(0, 1))


def _parameters(title: str, parameters: Iterable[RehearsedParameter]) -> PageTable:
    rows = []
    for found in parameters:
        value, std_dev, off = "not determined", "", "–"
        if found.value is not None and found.std_dev:
            value, std_dev = plain(found.value, 5), plain(found.std_dev, 2)
            off = f"{(found.value - found.true_value) / found.std_dev:+.1f}"
        cells = plain(found.true_value, 5), value, std_dev, found.unit, off
        rows.append(PageRow(found.name, cells, found.recovered))
    heads = (title, "true", "identified", "± σ", "unit", "off by [σ]")
    return PageTable(heads, rows, judged=5, texts=(0, 4))


def _forces(outcome: Rehearsal) -> PageTable:
    rows = [
        PageRow(spoken(joint), (_share(error), _share(outcome.noise_floor.get(joint))))
        for joint, error in outcome.heldout_relative_error.items()
    ]
    return PageTable(("Joint", "force unexplained, validation", "noise floor"), rows)


def _control(outcome: Rehearsal, machine: Machine) -> PageTable:
    rows = []
    for found in outcome.margins:
        joint, unit = found.joint, machine.units[found.joint]
        live = outcome.tracking.get(found.controller, {}).get(joint)
        errors = _milli(live, unit), _milli(found.error, unit)
        gains = _margin(found.gain_margin), _margin(found.gain_margin_twice)
        good = found.gain_margin >= WANTED_SCALE
        rows.append(PageRow(spoken(joint), (found.controller, *errors, *gains), good))
    heads = ("Joint", "controller", "error, driver", "simulated", "gain margin", "twice the delay")
    return PageTable(heads, rows, judged=4, texts=(0, 1))


def _stopping(outcome: Rehearsal, machine: Machine) -> PageTable:
    rows = []
    for found in outcome.stopping:
        unit = machine.units[found.joint]
        heading = f"{spoken(found.joint)} {'up' if found.direction > 0 else 'down'}"
        distances = _milli(found.distance, unit), _milli(found.allowed, unit)
        cells = (f"{found.speed:.2f} {unit}/s", *distances)
        rows.append(PageRow(heading, cells, found.distance <= found.allowed))
    return PageTable(("Joint", "speed", "stops within", "safety.yaml assumes"), rows, judged=2)


def _faults(outcome: Rehearsal, machine: Machine) -> PageTable:
    rows = []
    for found in outcome.faults:
        unit = machine.units.get(found.fault.partition(".")[0], "")
        seconds = "–" if found.seconds is None else f"{found.seconds:.1f} s"
        off = _milli(found.off, unit), _milli(found.usual, unit)
        heading = found.fault.replace(".", " ").replace("_", " ")
        rows.append(PageRow(heading, (*off, found.named or "nothing", seconds), found.right))
    heads = ("Fault", "joint off by", "without it", "the monitor named", "after")
    return PageTable(heads, rows, judged=3, texts=(0, 3))


def _margin(margin: float) -> str:
    if not margin:
        return "oscillates"
    return f"{'at least ' if margin == SCALES[-1] else ''}{margin:g}"


def _milli(value: float | None, unit: str) -> str:
    return "–" if value is None else f"{plain(1e3 * value)} m{unit}"


def _share(value: float | None) -> str:
    return "–" if value is None else percent(value)
