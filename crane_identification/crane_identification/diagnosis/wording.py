"""What findings.json says, in the words that page and terminal share."""

import re
from collections.abc import Iterable, Iterator, Mapping
from math import isnan, nan
from typing import Any, NamedTuple

from crane_identification.diagnosis.search.candidates import WHOLE
from crane_identification.diagnosis.search.loads import NO_LOAD
from crane_identification.notation import (
    NARROW_SPACE,
    NONE,
    NOT_DETERMINED,
    human,
    listed,
    percent,
    plain,
    short_percent,
    shown,
    spoken,
    with_uncertainty,
)

Content = Mapping[str, Any]

ANSWERS = {
    "named": "Something is missing, and these recordings say what",
    "named_and_more": "Something is missing, and these recordings say what; so is something more",
    "class": "Something is missing; these recordings narrow it down to a class",
    "none": "Nothing is missing that these recordings could show",
    "unknown": "Something is missing, and no effect of the catalogue is it",
    "insufficient_data": "These recordings do not suffice to say",
}
CHANGES = ANSWERS | {
    "named": "Something has changed since the model was made, and these recordings say what",
    "named_and_more": "Something has changed since the model was made, and these recordings say "
    "what; so has something more",
    "class": "Something has changed since the model was made; these recordings narrow it down to a "
    "class",
    "none": "Nothing has changed since the model was made that these recordings could show",
    "unknown": "Something has changed since the model was made, and no value of it nor effect of "
    "the catalogue is it",
}
"""What the verdicts say where the values of the model are kept."""
NOISE = {"none", "insufficient_data"}
"""Answers with which what the model leaves is noise, as far as recordings tell: it sits nowhere."""
SMALL_SHARE = 0.05  # share of what is unexplained, below which a joint says nothing


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


class Error(NamedTuple):
    """The held-out error of a joint as it is printed; `after` is empty where nothing was added."""

    joint: str
    before: str
    after: str
    floor: str
    learner: str
    closed: str


def said(text: str, joints: Iterable[str]) -> str:
    """A sentence of the diagnosis as a person reads it: joints spoken, and a space before %."""
    names = "|".join(map(re.escape, joints))
    text = re.sub(rf"(?<![\w.])({names})\b", lambda match: spoken(match[1]), text)
    return re.sub(r"(?<=\d)%", f"{NARROW_SPACE}%", text)


def sentence(text: str) -> str:
    """With a capital letter and a full stop."""
    return text[:1].upper() + text[1:] + ("" if text.endswith(".") else ".")


def answer(content: Content) -> str:
    """The verdict, in words."""
    return (CHANGES if content.get("values_kept") else ANSWERS)[content["verdict"]]


def reason(content: Content) -> str:
    """Why the verdict is what it is."""
    return sentence(said(content["reason"], content["where"]))


def place(joint: str) -> str:
    """A joint, or the whole crane."""
    return "the whole crane" if joint == WHOLE else spoken(joint)


def called(finding: Content) -> str:
    """An effect and its joint; of a class, all its members."""
    places: dict[str, list[str]] = {}
    for one in (finding, *finding["class_members"]):
        places.setdefault(one["joint"], []).append(one["name"])
    return " or ".join(f"{listed(names, 'or')} ({place(joint)})" for joint, names in places.items())


def _alone(one: Content) -> str:
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


def loads(content: Content) -> list[PrintedParameter]:
    """The loads that are estimated from held-out recordings, by the names of these."""
    return [
        estimate(one | {"name": one["recording"], "unit": "kg"})
        for one in content["gap"].get("loads", ())
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
    text += f"; {finding['margin']:.0f} ahead of {_alone(runner)}"
    member = any(_alone(one) == _alone(runner) for one in finding["class_members"])
    if member or finding["margin"] > finding["margin_needed"]:
        return f"{text}, {finding['margin_needed']:.0f} asked"
    return f"{text}, which is the same with more freedom"


def region(one: Content) -> str:
    """A quantity and the range of it that carries most of a residual."""
    name = re.sub(r" of (\w+)", lambda match: f" of the {spoken(match[1])}", one["variable"])
    unit, factor = human(one["unit"])
    ends = [factor * value for value in one["range"]]
    low, high = (with_uncertainty(end, ends[1] - ends[0])[0] for end in ends)
    return f"{name} in {low} to {high} {unit}".rstrip()


def disagrees(content: Content) -> Iterator[tuple[str, str]]:
    """Each joint on which the model leaves more than noise, and where that sits."""
    if content["verdict"] in NOISE:
        return
    for joint, one in content["where"].items():
        if one["energy_share"] > SMALL_SHARE:
            where = one["region"] and (
                f", {short_percent(one['region']['share'])} of it with {region(one['region'])}"
            )
            share = short_percent(one["energy_share"])
            yield spoken(joint), f"{share} of what is unexplained{where or ''}"


def added(content: Content) -> bool:
    """Whether the model of the force has something that it had not before."""
    return content["gap"]["before"] != content["gap"]["after"]


def errors(content: Content) -> Iterator[Error]:
    """The held-out error of each joint."""
    gap = content["gap"]
    for joint, old in gap["before"].items():
        new, closed = gap["after"][joint], gap["closed"][joint]
        yield Error(
            spoken(joint),
            percent(_number(old["force_relative_error"])),
            percent(_number(new["force_relative_error"])) if added(content) else "",
            percent(_number(old["noise_floor"])),
            percent(_number(old["best_achievable"])),
            short_percent(closed) if closed is not None and closed > 0.0 else NONE,
        )


def motion(content: Content, units: Mapping[str, str]) -> Iterator[tuple[str, str]]:
    """Errors of the simulated motion of each joint, before and after; coordinates have `units`."""
    gap = content["gap"]
    for joint, old in gap["before"].items():
        unit = f"{NARROW_SPACE}m{units[joint]}"
        before, after = (
            plain(1e3 * _number(side["motion_error"])) for side in (old, gap["after"][joint])
        )
        yield (
            before + (unit if before != NONE else ""),
            after + (unit if after != NONE else ""),
        )


def commanded(content: Content) -> Iterator[tuple[str, list[str]]]:
    """How far ahead, and of each joint the error of the motion from commands over its way."""
    for one in content["gap"].get("from_commands", ()):
        shares = [
            _step(*(_over(one[side][joint], way) for side in ("before", "after")))
            for joint, way in one["way"].items()
        ]
        yield f"{plain(one['horizon'])}{NARROW_SPACE}s", shares


def _over(error: float | None, way: float | None) -> float | None:
    return error / way if error is not None and way else None


def left(content: Content) -> str:
    """Of what kind what is left is, and where a law in it sits."""
    laws, errors, colours = [], [], []
    for joint, one in content["left"].items():
        if one["law"]:
            where = f", most with {region(one['region'])}" if one["region"] else ""
            share = short_percent(one["learnable_share"])
            laws.append(f"a law on the {spoken(joint)} ({share} of the energy there{where})")
        elif one["beyond_noise"]:
            errors.append(f"the {spoken(joint)}")
        elif not one["white"]:
            colours.append(f"the {spoken(joint)}")
    kinds = laws + ([f"more than noise on {listed(errors)}"] if errors else [])
    kinds += [f"coloured noise on {listed(colours)}"] if colours else []
    return listed(kinds) if kinds else "white noise"


def nearest(content: Content) -> list[str]:
    """What comes closest where nothing is named, what it explains, and why that does not do."""
    near = content["nearest"]
    if near is None:
        return []
    names = listed([_alone(one) for one in near["effects"]])
    own = {one["joint"] for one in near["effects"]}
    moved = [
        f"held-out error of the {spoken(joint)} {_step(one['before'], one['after'])}"
        for joint, one in near["gap"].items()
        if one["after"] is not None and own & {joint, WHOLE}
    ]
    first = near["effects"][0]
    explained = short_percent(near["explained_share"])
    return [
        f"{names}: score {first['score']:.0f}, threshold {first['threshold']:.0f}",
        "; ".join(
            [f"explains {explained} of what the training recordings leave where it acts", *moved]
        ),
        f"no name: {said(near['objection'], content['where'])}",
    ]


def _step(before: float | None, after: float | None) -> str:
    """From one share to another, once if both are printed alike."""
    return " → ".join(dict.fromkeys(percent(_number(share)) for share in (before, after)))


def _number(value: float | None) -> float:
    """NaN for what JSON has no number for."""
    return nan if value is None else value
