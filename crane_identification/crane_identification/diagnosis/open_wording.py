"""What a diagnosis leaves open and which experiment settles it, in words."""

from pathlib import Path

from crane_identification.diagnosis.finding_wording import Content, alone
from crane_identification.notation import listed
from crane_model.open_question import QuestionKind


def lines(content: Content) -> list[str]:
    """Each question, and what is known to tell its answers apart."""
    return [_line(question) for question in content["open"]["questions"]]


def command(content: Content, folder: Path) -> str:
    """What designs the experiment for the findings in a folder; empty where nothing is open."""
    if not content["open"]["questions"]:
        return ""
    return f"ros2 run crane_trajectory design --settle {folder} --out {folder / 'settle.yaml'}"


def _line(question: Content) -> str:
    members = question["members"]
    names = listed([alone(one) for one in members], "or")
    if question["kind"] == QuestionKind.UNDETERMINED:
        return f"{names}: is it there at all?"
    known = dict.fromkeys(one["settled_by"] for one in members)
    return f"{names}: told apart by {'; or '.join(known)}"
