"""rehearsal.html: the report of a rehearsal, one file without network."""

import shlex
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from crane_benchmark.rehearsal.outcome import EXACT_SHARE, SIGMAS, Rehearsal, RehearsedParameter
from crane_benchmark.rehearsal.tried import OFF_WITHIN
from crane_driver.operator.bringup.rehearsed import NOT_CHECKED, REHEARSAL_FILE
from crane_identification.notation import percent, plain, spoken
from crane_identification.report.html import PageLink, part, rendered
from crane_identification.report.terminal import rounded
from crane_model.machine import Machine
from crane_trajectory.tune import SCALES, WANTED_SCALE

PAGE = "rehearsal.html"
NONE = "–"
STYLE = "crane_identification.report"
LINKED = {
    "report.html": "identification",
    "bringup": "results of bring-up",
    "bags": "recordings",
    "logs": "logs",
    REHEARSAL_FILE: "all numbers",
}


class ParameterRow(NamedTuple):
    """A parameter next to its true value."""

    name: str
    true: str
    value: str
    std_dev: str
    off: str  # in standard deviations
    unit: str
    recovered: bool


class PageRow(NamedTuple):
    """A row of another table; `good` marks it."""

    heading: str
    cells: tuple[str, ...]
    good: bool


def write(path: Path, outcome: Rehearsal, machine: Machine, name: str) -> None:
    """Write the page; `name` is how the user named the machine."""
    path.write_text(render(outcome, machine, name, path.parent), encoding="utf-8")


def render(outcome: Rehearsal, machine: Machine, name: str, folder: Path) -> str:
    """Return the page as HTML."""
    mechanics, hydraulics = _kinds(outcome, machine)
    words = ["--machine", name, "--out", str(folder)]
    return rendered(
        __package__,
        {},
        outcome=outcome,
        verdict=verdict(outcome, machine),
        valves=list(_valves(outcome)),
        mechanics=[_parameter(found) for found in mechanics],
        hydraulics=[_parameter(found) for found in hydraulics if not found.recovered],
        recovered=_recovered(hydraulics),
        forces=[
            PageRow(spoken(joint), (_share(error), _share(outcome.noise_floor.get(joint))), True)
            for joint, error in outcome.heldout_relative_error.items()
        ],
        control=list(_control(outcome, machine)),
        delay=f"{1e3 * outcome.margins[0].delay:.0f}" if outcome.margins else "",
        wanted=f"{WANTED_SCALE:g}",
        stopping=list(_stopping(outcome, machine)),
        lost=_lost(outcome),
        faults=list(_faults(outcome, machine)),
        off_within=f"{OFF_WITHIN:g}",
        sigmas=f"{SIGMAS:g}",
        share=percent(EXACT_SHARE),
        not_checked=NOT_CHECKED,
        command=shlex.join(["ros2", "run", "crane_benchmark", "rehearse", *words]),
        links=[PageLink(text, file) for file, text in LINKED.items() if (folder / file).exists()],
        style=part(STYLE, "page.css"),
    )


def verdict(outcome: Rehearsal, machine: Machine) -> list[str]:
    """Sentences that sum the rehearsal up."""
    if outcome.failed:
        return [f"Not complete: {', '.join(outcome.failed)} failed."]
    mechanics, hydraulics = _kinds(outcome, machine)
    far = [found for found in outcome.stopping if found.distance > found.allowed]
    named = sum(found.right for found in outcome.faults)
    weak = {
        spoken(found.joint)
        for found in outcome.margins
        if found.controller != next(iter(outcome.tracking)) and found.gain_margin < WANTED_SCALE
    }
    return [
        f"Complete. {_recovered(mechanics)} parameters of the mechanics and "
        f"{_recovered(hydraulics)} of the hydraulics were recovered.",
        f"The gain margin at the measured delay is below {WANTED_SCALE:g} on "
        f"{', '.join(sorted(weak))}."
        if weak
        else "All gain margins at the measured delay suffice.",
        "Each joint stops as safety.yaml assumes."
        if not far
        else f"{', '.join(sorted({spoken(found.joint) for found in far}))} needs more way to stop "
        "than safety.yaml assumes: lower its deceleration.",
        f"The sensor monitor named {named} of {len(outcome.faults)} injected faults.",
    ]


def _kinds(
    outcome: Rehearsal, machine: Machine
) -> tuple[list[RehearsedParameter], list[RehearsedParameter]]:
    """Parameters of mechanics and of hydraulics; identification lists them in this order."""
    from crane_model.hydraulics import JointHydraulics

    names = {f"{name}.{joint}" for joint in machine.joint_names for name in JointHydraulics.units}
    every = outcome.parameters
    return (
        [found for found in every if found.name not in names],
        [found for found in every if found.name in names],
    )


def _recovered(found: list[RehearsedParameter]) -> str:
    return f"{sum(one.recovered for one in found)} of {len(found)}"


def _parameter(found: RehearsedParameter) -> ParameterRow:
    true = plain(found.true_value, 4)
    if found.value is None or not found.std_dev:
        return ParameterRow(found.name, true, "not determined", "", NONE, found.unit, False)
    off = (found.value - found.true_value) / found.std_dev
    return ParameterRow(
        found.name,
        rounded(found.true_value, found.std_dev) if abs(found.true_value) >= 0.01 else true,
        rounded(found.value, found.std_dev) if abs(found.value) >= 0.01 else plain(found.value, 4),
        plain(found.std_dev, 2),
        f"{off:+.1f}",
        found.unit,
        found.recovered,
    )


def _valves(outcome: Rehearsal) -> Iterator[PageRow]:
    for found in outcome.valves:
        bands = [f"{band:.4f}" for band in (*found.dead_band, *found.true_dead_band)]
        sign = "as in can.yaml" if found.sign_stays else "to be changed"
        yield PageRow(spoken(found.joint), (sign, *bands), found.sign_stays)


def _control(outcome: Rehearsal, machine: Machine) -> Iterator[PageRow]:
    for found in outcome.margins:
        unit = machine.units[found.joint]
        live = outcome.tracking.get(found.controller, {}).get(found.joint)
        yield PageRow(
            spoken(found.joint),
            (
                found.controller,
                _milli(live, unit),
                _milli(found.error, unit),
                _margin(found.gain_margin),
                _margin(found.gain_margin_twice),
            ),
            found.gain_margin >= WANTED_SCALE,
        )


def _margin(margin: float) -> str:
    if not margin:
        return "oscillates"
    return f"{'at least ' if margin == SCALES[-1] else ''}{margin:g}"


def _stopping(outcome: Rehearsal, machine: Machine) -> Iterator[PageRow]:
    for found in outcome.stopping:
        unit = machine.units[found.joint]
        yield PageRow(
            f"{spoken(found.joint)} {'up' if found.direction > 0 else 'down'}",
            (
                f"{found.speed:.2f} {unit}/s",
                _milli(found.distance, unit),
                _milli(found.allowed, unit),
            ),
            found.distance <= found.allowed,
        )


def _lost(outcome: Rehearsal) -> str:
    lost = outcome.lost_encoder
    if lost is None:
        return ""
    return (
        f"The encoder of the {spoken(lost.joint)} froze in motion, with the driver running: "
        f"{lost.named_by} named it after {lost.seconds_to_name:.2f} s, and all valves were "
        f"commanded neutral after {lost.seconds_to_neutral:.2f} s."
    )


def _faults(outcome: Rehearsal, machine: Machine) -> Iterator[PageRow]:
    for found in outcome.faults:
        unit = machine.units.get(found.fault.partition(".")[0], "")
        seconds = NONE if found.seconds is None else f"{found.seconds:.1f} s"
        cells = (
            _milli(found.off, unit),
            _milli(found.usual, unit),
            found.named or "nothing",
            seconds,
        )
        yield PageRow(found.fault.replace(".", " ").replace("_", " "), cells, found.right)


def _milli(value: float | None, unit: str) -> str:
    return NONE if value is None else f"{plain(1e3 * value)} m{unit}"


def _share(value: float | None) -> str:
    return NONE if value is None else percent(value)
