"""A diagnosis in twenty lines of text, from the findings.json that it wrote."""

import json
from pathlib import Path
from typing import Any

from crane_identification.discrepancy.loads import NO_LOAD
from crane_model.errors import DataError

ANSWERS = {
    "named": "Something is missing, and these recordings say what.",
    "named_and_more": "Something is missing, and these recordings say what; so is something more.",
    "class": "Something is missing; these recordings narrow it down to a class.",
    "none": "Nothing is missing that these recordings could show.",
    "unknown": "Something is missing, and no effect of the catalogue is it.",
    "insufficient_data": "These recordings do not suffice to say.",
}
CHANGES = ANSWERS | {
    "named": "Something has changed since the model was made, and these recordings say what.",
    "named_and_more": "Something has changed since the model was made, and these recordings say "
    "what; so has something more.",
    "class": "Something has changed since the model was made; these recordings narrow it down to a "
    "class.",
    "none": "Nothing has changed since the model was made that these recordings could show.",
    "unknown": "Something has changed since the model was made, and no value of it nor effect of "
    "the catalogue is it.",
}
DISAGREES = "Where the model disagrees"
NOISE = "What the model leaves, noise as far as these recordings tell"
WHERE = dict.fromkeys(ANSWERS, DISAGREES) | dict.fromkeys(("none", "insufficient_data"), NOISE)


def read(folder: Path) -> dict[str, Any]:
    """findings.json of a diagnosis; `DataError` if there is none."""
    path = folder / "findings.json"
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise DataError(
            f"{path}: no such file; name the folder that diagnose wrote with --out"
        ) from None
    except (OSError, ValueError) as error:
        raise DataError(f"{path}: not readable: {error}; diagnose again") from None


def answer(verdict: str, values_kept: bool) -> str:
    """The answer in one sentence."""
    return (CHANGES if values_kept else ANSWERS)[verdict]


def lines(content: dict[str, Any]) -> list[str]:
    """At most twenty lines."""
    out = [answer(content["verdict"], content.get("values_kept", False)), f"  {content['reason']}"]
    out.append(f"{WHERE[content['verdict']]}:")
    for joint, one in content["where"].items():
        region = one["region"]
        where = (
            f", most with {region['variable']} in {region['range'][0]:.3g} .. "
            f"{region['range'][1]:.3g}"
            if region and one["energy_share"] > 0.05
            else ""
        )
        out.append(f"  {joint}: {one['energy_share']:.0%} of what is unexplained{where}")
    if content["undetermined"]:
        out.append(f"Not determined, and left out: {', '.join(content['undetermined'])}")
    if content["needs_units"]:
        out.append(f"In counts, and need units: {', '.join(content['needs_units'])}")
    if content["without"]:
        out.append(f"Not asked for: {', '.join(content['without'])}")
    if reason := content.get("clock", {}).get("reason"):
        out.append(f"No time of a session: {reason}")
    for number, finding in enumerate(content["findings"], start=1):
        out += _finding(number, finding)
    out.append("Held-out force error, before -> after (noise floor, learner):")
    for joint, old in content["gap"]["before"].items():
        new, closed = content["gap"]["after"][joint], content["gap"]["closed"][joint]
        share = "" if closed is None else f", {closed:.0%} of the explainable gap closed"
        out.append(
            f"  {joint}: {_percent(old['force_relative_error'])} -> "
            f"{_percent(new['force_relative_error'])} ({_percent(old['noise_floor'])}, "
            f"{_percent(old['best_achievable'])}){share}"
        )
    loads = [
        f"{one['recording']} {one['value']:.4g} +- {one['std_dev']:.2g} kg"
        for one in content["gap"].get("loads", ())
    ]
    if loads:
        out.append(f"  each with its own load, estimated from it: {', '.join(loads)}")
    out.append(_left(content["left"]))
    return out[:20]


def _left(left: dict[str, Any]) -> str:
    """Of what kind what is left is."""
    law = [joint for joint, one in left.items() if one["law"]]
    coloured = [joint for joint, one in left.items() if not (one["white"] or one["law"])]
    said = [f"follows a law on {', '.join(law)}"] if law else []
    said += [f"is coloured noise on {', '.join(coloured)}"] if coloured else []
    return f"What is left {' and '.join(said)}." if said else "What is left is white noise."


def _finding(number: int, finding: dict[str, Any]) -> list[str]:
    values = ", ".join(map(_parameter, finding["parameters"]))
    out = [f"{number}. {finding['name']}, {finding['joint']}: {values}"]
    for name, recordings in finding.get("carried_in", {}).items():
        carried = "no load, from which masses count," if name == NO_LOAD else name
        out.append(f"   {carried} in {', '.join(recordings)}")
    evidence = f"   score {finding['score']:.0f}, threshold {finding['threshold']:.0f}"
    if finding["runner_up"]:
        runner = finding["runner_up"]
        evidence += (
            f"; {finding['margin']:.0f} ahead of {runner['name']}, {runner['joint']} "
            f"({finding['margin_needed']:.0f} asked)"
        )
    out.append(evidence)
    if finding["class_members"]:
        names = ", ".join(f"{one['name']} ({one['joint']})" for one in finding["class_members"][:3])
        out += [f"   not told from {names}", f"   settled by {finding['settled_by']}"]
    return out


def _parameter(one: dict[str, Any]) -> str:
    """The value, or what was added to the value before."""
    changed = "before" in one
    value, std_dev = (
        (one["change"], one["change_std_dev"]) if changed else (one["value"], one["std_dev"])
    )
    said = f"{value:{'+' if changed else ''}.4g} +- {std_dev or 0:.2g} {_shown(one['unit'])}"
    if changed:
        return f"{one['name']} {said.rstrip()}, from {one['before']:.4g} to {one['value']:.4g}"
    return f"{one['name']} = {said}".rstrip()


def _shown(unit: str) -> str:
    return "" if unit == "1" else unit


def _percent(value: float | None) -> str:
    return "?" if value is None else f"{value:.2%}"
