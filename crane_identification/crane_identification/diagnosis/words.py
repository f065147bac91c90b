"""The words of a diagnosis: findings.json as terminal and page tell it.

Each function takes the content of findings.json, or one entry of it.
"""

import re
from collections.abc import Iterable, Iterator, Mapping
from math import isnan, nan
from pathlib import Path
from typing import Any, NamedTuple

from crane_identification.diagnosis.candidates import NO_LOAD, WHOLE
from crane_identification.diagnosis.constants import SLIGHT_SHARE
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
from crane_model.result_file import QuestionKind

Content = Mapping[str, Any]

ANSWERS = {
    "named": "Something {is}, and these recordings show what",
    "named_and_more": "Something {is}, and these recordings show what; so {verb} something more",
    "ambiguous": "Something {is}; these recordings cannot show which of these effects it is",
    "none": "Nothing {is} that these recordings could show",
    "unknown": "Something {is}, and it is {not_in} an effect of the catalogue",
    "insufficient_data": "These recordings do not suffice for an answer",
}
MISSING = {"is": "is missing", "verb": "is", "not_in": "not"}
CHANGED = {
    "is": "has changed since the model was made",
    "verb": "has",
    "not_in": "neither a value of the model nor",
}
"""Words of the verdicts if the values of the model are kept."""
NOISE = {"none", "insufficient_data"}
"""Answers with which the residual is noise, as far as the recordings show."""
SMALLEST_CLOSED = 1e-4  # share of a model error, below which none of it is closed
CLEAR_SIGMAS = 3.0  # from which a recording differs from the others


class PrintedParameter(NamedTuple):
    """A parameter as it is printed, or why it has no number; `change` from the value before."""

    name: str
    value: str
    deviation: str
    unit: str
    change: str = ""

    def __str__(self) -> str:
        parts = (f"{self.name} =", self.value, self.deviation, self.unit)
        line = " ".join(part for part in parts if part)
        return f"{line} ({self.change})" if self.change else line


class PrintedError(NamedTuple):
    """The held-out error of a joint as it is printed; `after` is empty where nothing was added."""

    joint: str
    before: str
    after: str
    floor: str
    learner: str
    closed: str


# The answer and its proof.


def said(text: str, joints: Iterable[str]) -> str:
    """A sentence of the diagnosis as a person reads it: joints spoken, and a space before %."""
    names = "|".join(map(re.escape, joints))
    text = re.sub(rf"(?<![\w.])({names})\b", lambda match: spoken(match[1]), text)
    return re.sub(r"(?<=\d)%", f"{NARROW_SPACE}%", text)


def sentence(text: str) -> str:
    """The text with a capital letter, and a full stop unless it is a question."""
    return text[:1].upper() + text[1:] + ("" if text.endswith((".", "?")) else ".")


def answer(content: Content) -> str:
    """The verdict, in words."""
    said = CHANGED if content.get("values_kept") else MISSING
    return ANSWERS[content["verdict"]].format(**said)


def reason(content: Content) -> str:
    """The reason for the verdict."""
    return sentence(said(content["reason"], content["where"]))


def added(content: Content) -> bool:
    """Return whether the model of the force has something that it had not before."""
    return bool(content["model_error"]["before"] != content["model_error"]["after"])


def errors(content: Content) -> Iterator[PrintedError]:
    """The held-out error of each joint."""
    error = content["model_error"]
    for joint, old in error["before"].items():
        sides = old, error["after"][joint]
        before, after = (percent(_number(side["force_relative_error"])) for side in sides)
        closed = _number(error["closed"][joint])
        yield PrintedError(
            spoken(joint),
            before,
            after if added(content) else "",
            percent(_number(old["noise_floor"])),
            percent(_number(old["best_achievable"])),
            short_percent(closed) if closed > SMALLEST_CLOSED and before != after else NONE,
        )


def motion(content: Content, units: Mapping[str, str]) -> Iterator[list[str]]:
    """Errors of the simulated motion of each joint, before and after; coordinates have `units`."""
    error = content["model_error"]
    for joint, old in error["before"].items():
        sides = (plain(1e3 * _number(one["motion_error"])) for one in (old, error["after"][joint]))
        unit = f"{NARROW_SPACE}m{units[joint]}"
        yield [text + (unit if text != NONE else "") for text in sides]


def commanded(content: Content) -> Iterator[tuple[str, list[str]]]:
    """The horizon, and the error of each joint from commands over its path."""
    for one in content["model_error"].get("from_commands", ()):
        shares = []
        for joint, path in one["displacement"].items():
            errors = one["before"][joint], one["after"][joint]
            shares.append(_step(*(None if e is None or not path else e / path for e in errors)))
        yield f"{plain(one['horizon'])}{NARROW_SPACE}s", shares


def loads(content: Content) -> list[PrintedParameter]:
    """The loads that are estimated from held-out recordings, by the names of these."""
    return [
        estimate(one | {"name": one["recording"], "unit": "kg"})
        for one in content["model_error"].get("loads", ())
    ]


# One finding.


def place(joint: str) -> str:
    """A joint, or the whole machine."""
    return "the whole machine" if joint == WHOLE else spoken(joint)


def called(finding: Content) -> str:
    """An effect and its joint; of an ambiguity group, all its members."""
    places: dict[str, list[str]] = {}
    for one in (finding, *finding["ambiguity_group"]):
        places.setdefault(one["joint"], []).append(one["name"])
    return " or ".join(f"{listed(names, 'or')} ({place(joint)})" for joint, names in places.items())


def alone(one: Content) -> str:
    """An effect and its joint."""
    return f"{one['name']} ({place(one['joint'])})"


def estimate(parameter: Content) -> PrintedParameter:
    """A parameter of a finding."""
    unit, factor = human(parameter["unit"])
    value, deviation, minimum = (
        nan if number is None else factor * number
        for number in (parameter["value"], parameter["std_dev"], parameter.get("minimum"))
    )
    printed = shown(value, deviation, None if isnan(minimum) else minimum)
    none = printed.value.startswith(NOT_DETERMINED) or printed.std_dev == NONE
    deviated = "" if none else f"± {printed.std_dev}"
    change = ""
    if "before" in parameter:
        by, before = (
            " ± ".join(
                with_uncertainty(factor * parameter[key], factor * parameter[f"{key}_std_dev"])
            )
            for key in ("change", "before")
        )
        change = f"{'+' if parameter['change'] > 0.0 else ''}{by} from {before}"
    return PrintedParameter(parameter["name"], printed.value, deviated, unit, change)


def estimates(finding: Content) -> list[PrintedParameter]:
    """The parameters of a finding; none where they are the values of a curve."""
    return [] if finding["curves"] else [estimate(one) for one in finding["parameters"]]


def drawn(finding: Content) -> list[str]:
    """Its nonparametric curves: the values at the knots, and what they are multiplied by."""
    out = []
    deviation = finding.get("deviation", ())
    for one in (*finding["curves"], *deviation):
        (unit, factor), (force, size) = human(one["variable_unit"]), human(one["unit"])
        points = (
            f"{plain(size * value)} at {plain(factor * knot)}"
            for knot, value in zip(one["knots"], one["values"], strict=True)
        )
        times = "" if one["times"] == "1" else f", times {one['times']}"
        what = "its form lacks a curve" if one in deviation else "curve"
        units = f" [{force or '1'} at {unit or '1'}]"
        out.append(f"{what} over the {one['variable']}{times}{units}: {', '.join(points)}")
    return out


def carried(finding: Content) -> list[str]:
    """The recordings that carry each load, if the effect is one."""
    words = {NO_LOAD: "no load, from which masses count,"}
    return [
        f"{words.get(name, name)} in {listed(recordings)}"
        for name, recordings in finding.get("carried_in", {}).items()
        if recordings
    ]


def magnitude(finding: Content) -> str:
    """The size of an effect and of its visible part; empty if unknown."""
    if finding["visible_magnitude"] is None:
        return ""
    visible = short_percent(finding["visible_magnitude"])
    if finding["relative_magnitude"] is None:
        return f"{visible} of the flow"
    return (
        f"rms {short_percent(finding['relative_magnitude'])} of the drive force; {visible} visible"
    )


def evidence(finding: Content) -> str:
    """The score of an effect, against chance and the runner-up."""
    text = f"score {finding['score']:.0f}, threshold {finding['threshold']:.0f}"
    runner = finding["runner_up"]
    if not runner:
        return text
    text += f"; {finding['margin']:.0f} ahead of {alone(runner)}"
    member = any(alone(one) == alone(runner) for one in finding["ambiguity_group"])
    if member or finding["margin"] > finding["margin_needed"]:
        return f"{text}, {finding['margin_needed']:.0f} required"
    return f"{text}, which is the same with more freedom"


# Where the model errs, and what is left.


def region(one: Content) -> str:
    """A quantity and the range of it that carries most of a residual."""
    name = re.sub(r" of (\w+)", lambda match: f" of the {spoken(match[1])}", one["variable"])
    unit, factor = human(one["unit"])
    ends = [factor * value for value in one["range"]]
    low, high = (with_uncertainty(end, ends[1] - ends[0])[0] for end in ends)
    return f"{name} from {low} to {high} {unit}".rstrip()


def disagrees(content: Content) -> Iterator[tuple[str, str]]:
    """Each joint whose residual exceeds the noise, and where that residual sits."""
    if content["verdict"] in NOISE:
        return
    for joint, one in content["where"].items():
        if one["energy_share"] > SLIGHT_SHARE:
            where = one["region"] and (
                f", {short_percent(one['region']['share'])} of it with the {region(one['region'])}"
            )
            share = short_percent(one["energy_share"])
            yield spoken(joint), f"{share} of what is unexplained{where or ''}"


def left(content: Content) -> str:
    """The kind of residual that is left, and the region of a systematic one."""
    systematic, errors = [], []
    for joint, one in content["left"].items():
        if one["systematic"]:
            where = f", most with the {region(one['region'])}" if one["region"] else ""
            share = short_percent(one["learnable_share"])
            systematic.append(
                f"a systematic residual on the {spoken(joint)} ({share} of the energy there{where})"
            )
        elif one["beyond_noise"]:
            errors.append(f"the {spoken(joint)}")
    kinds = systematic + ([f"more than noise on {listed(errors)}"] if errors else [])
    return listed(kinds) if kinds else "noise"


def named_from(content: Content) -> list[str]:
    """The relative magnitude from which effects are named, of each joint."""
    return [
        f"{short_percent(_number(least))} on the {spoken(joint)}"
        for joint, least in content["named_from"].items()
    ]


def partly_seen(content: Content) -> list[str]:
    """Friction that may be there unseen, if no effect is named."""
    if content["verdict"] not in NOISE:
        return []
    return [
        f"{alone(one)}: as little as {short_percent(one['seen_share'])} of its energy is in the "
        "used rows"
        for one in content.get("partly_seen", ())
    ]


# What is not named.


def nearest(content: Content) -> list[str]:
    """The nearest effects if nothing is named, what they explain, and what speaks against them."""
    return [] if content["nearest"] is None else _tried(content["nearest"], content)


def own_terms(content: Content) -> list[str]:
    """The user's terms that are not named, and why."""
    out = []
    for one in content.get("own_terms", ()):
        if one["tried"]:
            out += _tried(one["tried"], content)
        else:
            objection = said(one["objection"], content["where"])
            out.append(f"{alone(one)}: not named, because {objection}")
    return out


def _tried(near: Content, content: Content) -> list[str]:
    names = listed([alone(one) for one in near["effects"]])
    joints = {one["joint"] for one in near["effects"]}
    moved = [
        f"held-out error of the {spoken(joint)} {_step(one['before'], one['after'])}"
        for joint, one in near["model_error"].items()
        if one["after"] is not None and joints & {joint, WHOLE}
    ]
    first = near["effects"][0]
    explained = short_percent(near["explained_share"])
    return [
        f"{names}: score {first['score']:.0f}, threshold {first['threshold']:.0f}",
        "; ".join([f"explains {explained} of the residual of the training recordings", *moved]),
        f"not named, because {said(near['objection'], content['where'])}",
    ]


def unknown_title(content: Content) -> str:
    """The joint and size of an unknown force; empty if nothing is unknown."""
    unknown = content.get("unknown")
    if unknown is None:
        return ""
    size = short_percent(unknown["relative_magnitude"])
    what = "What the remaining error" if content["findings"] else "What it"
    return f"{what} may depend on ({spoken(unknown['joint'])}, rms {size} of the drive force)"


def unknown(content: Content) -> list[str]:
    """The signatures of an unknown force with objections, differing recordings, the formula."""
    one = content.get("unknown")
    return [] if one is None else [*_signatures(one), *_recordings(one), *_formula(one)]


def nearest_drawn(unknown: Content) -> Content | None:
    """The nearest signature that has a nonparametric curve; None if no signature has one."""
    return next((one for one in unknown["signatures"] if one["curves"]), None)


def _signatures(unknown: Content) -> Iterator[str]:
    nearest = nearest_drawn(unknown)
    for one in unknown["signatures"]:
        yield (
            f"{one['signature']}: its best curve explains "
            f"{short_percent(one['explained_share'])}, and helps to predict {one['better']} of "
            f"{one['asked']} recordings that it is not fitted to; "
            f"{_against(one, unknown['signatures'][0])}"
        )
        if nearest is not None and one is nearest:
            yield from drawn(nearest)


def _against(one: Content, first: Content) -> str:
    """Objections to a signature, beside the first of the list."""
    against = []
    rest = 1.0 - (one["explained_share"] or 0.0)
    if rest > SLIGHT_SHARE:
        against.append(f"{short_percent(rest)} are left")
    if one["better"] < one["asked"]:
        against.append(f"it predicts {one['asked'] - one['better']} recordings worse")
    shares = (short_percent(each["explained_share"] or 0.0) for each in (one, first))
    if len(set(shares)) > 1:
        against.append("the first explains more")
    if not one["effects"]:
        against.append("no effect of the catalogue depends on that")
    return f"against it: {listed(against)}" if against else "only its form speaks against it"


def _recordings(unknown: Content) -> Iterator[str]:
    differing = [f"{name} ({ratio:.1f} times)" for name, ratio in unknown["recordings"].items()]
    if differing:
        yield f"it is far larger than in most recordings in {listed(differing)}"
    if one := unknown["difference"]:
        unit, factor = human(one["unit"])
        changes = [
            f"{' ± '.join(with_uncertainty(factor * change, factor * std_dev))} in {name}"
            for name, change in one["changes"].items()
            if abs(change) > CLEAR_SIGMAS * (std_dev := one["std_devs"][name])
        ]
        yield (
            f"recordings differ from each other: {one['parameter']} of each by itself explains "
            f"{short_percent(one['explained_share'])}; it differs from the common value by "
            f"{listed(changes)} {unit}".rstrip()
        )


def _formula(unknown: Content) -> Iterator[str]:
    if one := unknown.get("formula"):
        values = ", ".join(str(estimate(each)) for each in one["parameters"])
        yield (
            f"a short formula: {one['equation']} with {values}; held-out error "
            f"{_step(one['before'], one['after'])}, {short_percent(one['closed_share'])} of the "
            f"explainable error removed; name it with --terms {formula_file(unknown)}"
        )


def formula_file(unknown: Content) -> str:
    """The name of the Python file that holds the formula of an unknown force."""
    return f"formula_of_{unknown['joint']}.py"


def questions(content: Content) -> list[str]:
    """Each open question, and what is known to discriminate between its answers."""
    return [_question(one) for one in content["open"]["questions"]]


def _question(question: Content) -> str:
    members = question["members"]
    names = listed([alone(one) for one in members], "or")
    if question["kind"] == QuestionKind.UNDETERMINED:
        return f"{names}: is it there at all?"
    known = dict.fromkeys(one["discriminated_by"] for one in members)
    return f"{names}: discriminated by {'; or '.join(known)}"


def discriminating_command(content: Content, folder: Path) -> str:
    """The command that designs the experiment for a folder; empty where nothing is open."""
    if not content["open"]["questions"]:
        return ""
    out = folder / "discriminate.yaml"
    return f"ros2 run crane_trajectory design --discriminate {folder} --out {out}"


# A diagnosis as text: the answer, its proof, then the rest.


def lines(content: Content) -> list[str]:
    """The answer, the errors that prove it, what was found, and what is left."""
    names = "; ".join(map(called, content["findings"]))
    first = answer(content) + (f": {names}." if names else ".")
    out = [first, f"  {reason(content)}", *_error_lines(content)]
    for number, finding in enumerate(content["findings"], start=1):
        out += _finding_lines(number, finding)
    for title, block in (
        ("Nearest effects of the catalogue", nearest(content)),
        ("Your own terms that are not named", own_terms(content)),
        (unknown_title(content), unknown(content)),
        ("Friction that may be invisible at rest and at reversals", partly_seen(content)),
        ("Where the model disagrees", [f"{one}: {text}" for one, text in disagrees(content)]),
    ):
        out += [f"{title}:", *(f"  {line}" for line in block)] if block else []
    out.append(f"Remaining: {left(content)}.")
    for name, key in (
        ("Not determined by these recordings", "undetermined"),
        ("In counts; units needed", "needs_units"),
        ("Excluded", "without"),
    ):
        if content[key]:
            out.append(f"{name}: {', '.join(content[key])}")
    if content["clock"]:
        out.append(f"No session time: {content['clock']}")
    counted = (
        ("effects that the parameters of the model absorb", content["not_testable"]),
        ("effects that are not observable in these recordings", content["not_observable"]),
        ("joints with a flow balance", content["flow"]),
    )
    rest = ["errors of the simulated motion"]
    rest += [f"{what} ({len(found)})" for what, found in counted if found]
    return [*out, f"Not printed: {', '.join(rest)}; see report.html or findings.json."]


def next_step(content: Content, folder: Path) -> list[str]:
    """The command that designs the experiment for what is open in a folder; none if nothing is."""
    command = discriminating_command(content, folder)
    return [f"Experiment to discriminate the remaining candidates: {command}"] if command else []


def _error_lines(content: Content) -> Iterator[str]:
    both = ", before → after" if added(content) else ""
    yield f"Held-out error of the force{both} (scatter between periods, flexible learner):"
    for one in errors(content):
        change = f" → {one.after}" if one.after else ""
        closed = f", {one.closed} of the explainable error removed" if one.closed != NONE else ""
        yield f"  {one.joint}: {one.before}{change} ({one.floor}, {one.learner}){closed}"
    if carried := ", ".join(map(str, loads(content))):
        yield f"  each with its own load, estimated from it: {carried}"
    joints = [spoken(joint) for joint in content["model_error"]["before"]]
    for ahead, shares in commanded(content):
        told = (f"{joint} {share}" for joint, share in zip(joints, shares, strict=True))
        yield (
            f"Motion from valve commands alone, {ahead} ahead, error over the displacement: "
            + ", ".join(told)
        )


def _finding_lines(number: int, finding: Content) -> list[str]:
    out = [f"{number}. {called(finding)}: {magnitude(finding)}".rstrip(": ")]
    values = ", ".join(map(str, estimates(finding)))
    if finding["ambiguity_group"]:
        out.append(f"   as {alone(finding)}: {values}")
        out.append(f"   discriminated by {finding['discriminated_by']}")
    elif values:
        out.append(f"   {values}")
    return [
        *out,
        *(f"   {line}" for line in (*drawn(finding), *carried(finding), evidence(finding))),
    ]


def _step(before: float | None, after: float | None) -> str:
    """A change of a share; one number if both are printed alike."""
    return " → ".join(dict.fromkeys(percent(_number(share)) for share in (before, after)))


def _number(value: float | None) -> float:
    return nan if value is None else value
