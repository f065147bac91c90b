"""What findings.json says, in the words that page and terminal share."""

import re
from collections.abc import Iterable, Iterator, Mapping
from math import nan
from typing import NamedTuple

from crane_identification.diagnosis.finding_wording import (
    Content,
    PrintedParameter,
    alone,
    estimate,
)
from crane_identification.diagnosis.search.candidates import WHOLE
from crane_identification.notation import (
    NARROW_SPACE,
    NONE,
    human,
    listed,
    percent,
    plain,
    short_percent,
    spoken,
    with_uncertainty,
)

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
SMALLEST = 1e-4  # share of a gap, below which none of it is closed
SMALL_SHARE = 0.05  # share of what is unexplained, below which a joint says nothing


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
    """With a capital letter, and a full stop where no question ends it."""
    return text[:1].upper() + text[1:] + ("" if text.endswith((".", "?")) else ".")


def answer(content: Content) -> str:
    """The verdict, in words."""
    return (CHANGES if content.get("values_kept") else ANSWERS)[content["verdict"]]


def reason(content: Content) -> str:
    """Why the verdict is what it is."""
    return sentence(said(content["reason"], content["where"]))


def loads(content: Content) -> list[PrintedParameter]:
    """The loads that are estimated from held-out recordings, by the names of these."""
    return [
        estimate(one | {"name": one["recording"], "unit": "kg"})
        for one in content["gap"].get("loads", ())
    ]


def named_from(content: Content) -> list[str]:
    """From which strength on effects are named, of each joint."""
    return [
        f"{short_percent(_number(least))} on the {spoken(joint)}"
        for joint, least in content["named_from"].items()
    ]


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
            short_percent(closed) if closed is not None and closed > SMALLEST else NONE,
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
    return [] if content["nearest"] is None else _tried(content["nearest"], content)


def own_terms(content: Content) -> list[str]:
    """What terms of the user's do that are not named, and why they are not."""
    out = []
    for one in content.get("own_terms", ()):
        if one["tried"]:
            out += _tried(one["tried"], content)
        else:
            out.append(f"{alone(one)}: no name: {said(one['objection'], content['where'])}")
    return out


def _tried(near: Content, content: Content) -> list[str]:
    names = listed([alone(one) for one in near["effects"]])
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
