"""A diagnosis as text, from the findings.json that it wrote: the answer, its proof, then the rest.

Whatever is not printed is said to be elsewhere.
"""

from pathlib import Path
from typing import Any

from crane_identification.diagnosis import finding_wording, open_wording, unknown_wording, wording
from crane_identification.diagnosis.findings_file import Findings
from crane_identification.notation import spoken


def read(folder: Path) -> dict[str, Any]:
    """findings.json of a diagnosis; `DataError` if there is none, or none of this version."""
    return Findings.read(folder / "findings.json").plain()


def lines(content: dict[str, Any]) -> list[str]:
    """The answer, the gap that proves it, what was found, and what is left."""
    out = [_answer(content), f"  {wording.reason(content)}", *_gap(content)]
    for number, finding in enumerate(content["findings"], start=1):
        out += _finding(number, finding)
    out += _block("Nearest of the catalogue:", wording.nearest(content))
    out += _block("Your own terms that are not named:", wording.own_terms(content))
    out += _block(f"{unknown_wording.title(content)}:", unknown_wording.lines(content))
    where = [f"{joint}: {said}" for joint, said in wording.disagrees(content)]
    out += _block("Where the model disagrees:", where)
    out.append(f"What is left: {wording.left(content)}.")
    for name, key in (
        ("Not determined by these recordings", "undetermined"),
        ("In counts, and need units", "needs_units"),
        ("Not asked for", "without"),
    ):
        if content[key]:
            out.append(f"{name}: {', '.join(content[key])}")
    if reason := content.get("clock", {}).get("reason"):
        out.append(f"No time of a session: {reason}")
    return out + _elsewhere(content)


def next_step(content: dict[str, Any], folder: Path) -> list[str]:
    """The command that designs the experiment for what is open in a folder; none if nothing is."""
    command = open_wording.command(content, folder)
    return [f"What is open, an experiment settles: {command}"] if command else []


def _answer(content: dict[str, Any]) -> str:
    """The verdict, and what it names."""
    names = "; ".join(finding_wording.called(finding) for finding in content["findings"])
    return wording.answer(content) + (f": {names}." if names else ".")


def _gap(content: dict[str, Any]) -> list[str]:
    """The held-out errors."""
    both = ", before → after" if wording.added(content) else ""
    out = [f"Held-out error of the force{both} (scatter between periods, flexible learner):"]
    for one in wording.errors(content):
        change = f" → {one.after}" if one.after else ""
        closed = f", {one.closed} of what could be closed" if one.closed != wording.NONE else ""
        out.append(f"  {one.joint}: {one.before}{change} ({one.floor}, {one.learner}){closed}")
    loads = ", ".join(map(str, wording.loads(content)))
    out += [f"  each with its own load, estimated from it: {loads}"] if loads else []
    return out + _from_commands(content)


def _from_commands(content: dict[str, Any]) -> list[str]:
    """The motion that valve commands alone bring about, where it was simulated."""
    joints = [spoken(joint) for joint in content["gap"]["before"]]
    return [
        f"Motion from valve commands alone, {ahead} ahead, error over the way: "
        + ", ".join(f"{joint} {share}" for joint, share in zip(joints, shares, strict=True))
        for ahead, shares in wording.commanded(content)
    ]


def _finding(number: int, finding: dict[str, Any]) -> list[str]:
    out = [
        f"{number}. {finding_wording.called(finding)}: {finding_wording.strength(finding)}".rstrip(
            ": "
        )
    ]
    values = ", ".join(str(one) for one in finding_wording.estimates(finding))
    if finding["class_members"]:
        out.append(f"   as {finding['name']} ({finding_wording.place(finding['joint'])}): {values}")
        out.append(f"   told apart by {finding['settled_by']}")
    elif values:
        out.append(f"   {values}")
    out += [f"   {line}" for line in finding_wording.drawn(finding)]
    out += [f"   {line}" for line in finding_wording.carried(finding)]
    return [*out, f"   {finding_wording.evidence(finding)}"]


def _block(title: str, said: list[str]) -> list[str]:
    """Indented under a title; nothing where nothing is said."""
    return [title, *(f"  {line}" for line in said)] if said else []


def _elsewhere(content: dict[str, Any]) -> list[str]:
    """What is not printed."""
    counted = (
        ("effects that hide behind the parameters of the model", content["not_testable"]),
        ("effects that are not observable in these recordings", content["not_observable"]),
        ("joints with a balance of the flow", content["flow"]),
    )
    said = [f"{what} ({len(found)})" for what, found in counted if found]
    said.insert(0, "errors of the simulated motion")
    return [f"Not printed: {', '.join(said)}; see report.html or findings.json."]
