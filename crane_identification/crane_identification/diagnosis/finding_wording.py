"""What findings.json says of one effect, in the words that page and terminal share."""

from collections.abc import Mapping
from math import isnan, nan
from typing import Any, NamedTuple

from crane_identification.diagnosis.search.candidates import WHOLE
from crane_identification.diagnosis.search.loads import NO_LOAD
from crane_identification.notation import (
    NONE,
    NOT_DETERMINED,
    human,
    listed,
    plain,
    short_percent,
    shown,
    spoken,
    with_uncertainty,
)

Content = Mapping[str, Any]


class PrintedParameter(NamedTuple):
    """A parameter as it is printed: numbers in units that people read, or why there is none.

    `change`: what was added to the value before, and that one; empty where there was none.
    """

    name: str
    value: str
    std_dev: str
    unit: str
    change: str = ""

    @property
    def deviation(self) -> str:
        """The standard deviation behind the value; empty where there is none."""
        return "" if self.std_dev == NONE else f"± {self.std_dev}"

    def __str__(self) -> str:
        """In one line."""
        words = (f"{self.name} =", self.value, self.deviation, self.unit)
        said = " ".join(word for word in words if word)
        return f"{said} ({self.change})" if self.change else said


def place(joint: str) -> str:
    """A joint, or the whole machine."""
    return "the whole machine" if joint == WHOLE else spoken(joint)


def called(finding: Content) -> str:
    """An effect and its joint; of a class, all its members."""
    places: dict[str, list[str]] = {}
    for one in (finding, *finding["class_members"]):
        places.setdefault(one["joint"], []).append(one["name"])
    return " or ".join(f"{listed(names, 'or')} ({place(joint)})" for joint, names in places.items())


def alone(one: Content) -> str:
    """One effect and its joint."""
    return f"{one['name']} ({place(one['joint'])})"


def estimate(parameter: Content) -> PrintedParameter:
    """A parameter of a finding."""
    unit, factor = human(parameter["unit"])
    value, deviation, minimum = (
        nan if number is None else factor * number
        for number in (parameter["value"], parameter["std_dev"], parameter.get("minimum"))
    )
    printed = shown(value, deviation, None if isnan(minimum) else minimum)
    number = not printed.value.startswith(NOT_DETERMINED)
    deviated = printed.std_dev if number else NONE
    return PrintedParameter(
        parameter["name"], printed.value, deviated, unit, _change(parameter, factor)
    )


def estimates(finding: Content) -> list[PrintedParameter]:
    """The parameters of a finding; none where they are the values of a shape that is drawn."""
    return [] if finding["shapes"] else [estimate(one) for one in finding["parameters"]]


def drawn(finding: Content) -> list[str]:
    """Its law as it was drawn: the values at the knots, and what they are multiplied by."""
    out = []
    for one in finding["shapes"]:
        (unit, factor), (force, size) = human(one["variable_unit"]), human(one["unit"])
        points = (
            f"{plain(size * value)} at {plain(factor * knot)}"
            for knot, value in zip(one["knots"], one["values"], strict=True)
        )
        times = "" if one["times"] == "1" else f", times {one['times']}"
        out.append(
            f"law over the {one['variable']}{times} [{force} at {unit}]: {', '.join(points)}"
        )
    return out


def _change(parameter: Content, factor: float) -> str:
    """By how much a parameter has changed, and from what."""
    if "before" not in parameter:
        return ""
    by, before = (
        " ± ".join(with_uncertainty(factor * parameter[key], factor * parameter[f"{key}_std_dev"]))
        for key in ("change", "before")
    )
    return f"{'+' if parameter['change'] > 0.0 else ''}{by} from {before}"


def carried(finding: Content) -> list[str]:
    """Which recordings carry which load, where the effect is one."""
    words = {NO_LOAD: "no load, from which masses count,"}
    return [
        f"{words.get(name, name)} in {listed(recordings)}"
        for name, recordings in finding.get("carried_in", {}).items()
        if recordings
    ]


def strength(finding: Content) -> str:
    """How strong an effect is, and how much of that shows; empty where that is not known."""
    if finding["visible_strength"] is None:
        return ""
    visible = short_percent(finding["visible_strength"])
    if finding["strength"] is None:
        return f"{visible} of the flow"
    return (
        f"rms {short_percent(finding['strength'])} of that of the drive force; {visible} show "
        "beside the model"
    )


def evidence(finding: Content) -> str:
    """The score of an effect, against chance and the runner-up."""
    text = f"score {finding['score']:.0f}, threshold {finding['threshold']:.0f}"
    runner = finding["runner_up"]
    if not runner:
        return text
    text += f"; {finding['margin']:.0f} ahead of {alone(runner)}"
    member = any(alone(one) == alone(runner) for one in finding["class_members"])
    if member or finding["margin"] > finding["margin_needed"]:
        return f"{text}, {finding['margin_needed']:.0f} asked"
    return f"{text}, which is the same with more freedom"
